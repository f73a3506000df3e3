"""How old the stored results on a page are: of which commit, and whether training changed since.

``make_results.py`` fills the marks of the pages with it::

    <!-- age: results/search.json -->
    **Stale**: made before training changed (commit 1234567, 2026-11-28); make it anew with `...`.
    <!-- /age -->

A mark names a result file, or a folder of them, from the root of the repository. Behind a comma it
may say which part of the result depends on training. Results of the world alone have no mark; those
of other people's learners have one and are never stale.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lanewise.report import provenance
from lanewise.system import version

ROOT = Path(__file__).resolve().parents[1]
MARKED = re.compile(
    r"(<!-- age: ([^,>\n]+?)(?:, ([^>\n]+?))? -->\n)(.*?)\n?(<!-- /age -->)", re.DOTALL
)
"""A mark: its begin, the result, the part that depends on training, what it holds, its end."""


def mark(result: str, what: str = "") -> str:
    """A mark, still empty."""
    return f"<!-- age: {result}{', ' if what else ''}{what} -->\n<!-- /age -->"


def below_title(page: str, result: str) -> str:
    """A page with the mark of a result below its title, once."""
    if MARKED.search(page):
        return page
    title, _, rest = page.partition("\n")
    return f"{title}\n\n{mark(result)}\n{rest}"


def filled(page: str) -> str:
    """A page with the age of each result that it marks."""

    def line(found: re.Match[str]) -> str:
        begin, result, what, _, end = found.groups()
        path = ROOT / result
        files = sorted(path.glob("*.json")) if path.is_dir() else [path]
        age = note([json.loads(file.read_text()) for file in files], what or "")
        return f"{begin}{age}\n{end}"

    return MARKED.sub(line, page)


def note(stored: Sequence[Any], what: str = "") -> str:
    """How old results are, in a line; ``what`` is the part that depends on training, if not all."""
    sources = [source for result in stored for source in _sources(result)]
    dates = sorted({result["date"][:10] for result in stored})
    made = f"{provenance.commits(sources)}, {' to '.join(dict.fromkeys((dates[0], dates[-1])))}"
    trainings = {source.get("training") for source in sources}
    others = all("learner" in result for result in stored)
    if others or trainings == {version.training()}:
        return f"{made[0].upper()}{made[1:]}."
    since = "results named their training" if None in trainings else "training changed"
    part = f" in {what}" if what else ""
    return f"**Stale**{part}: made before {since} ({made}); {_remedy(stored)}."


def _sources(result: Any) -> list[Any]:
    """The code behind a result: of a report or a map, that which trained what was tested."""
    if "arms" in result:
        seeds = [
            seed for arm in result["arms"] for seed in arm["seeds"] if seed["effort"] is not None
        ]
        return [seed.get("trained_by", {}) for seed in seeds]
    rows = [row["trained_by"] for row in result.get("rows", ()) if "trained_by" in row]
    return rows or [result.get("trained_by", result)]


def _remedy(stored: Sequence[Any]) -> str:
    """How to make results anew."""
    command, *others = {result.get("command") for result in stored}
    if others or command is None:
        return "results/README.md says how to make it anew"
    # Its name when peers were measured by the package.
    command = command.replace("lanewise bench --python", "python benchmarks/peers.py --python")
    if "training_seed" in stored[0]:
        return f"train the run anew, then `{command}`"
    return f"make it anew with `{command}`"
