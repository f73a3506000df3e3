"""Writes the table of the page on trust from the stored results of the campaigns.

python docs/make_trust.py
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "trust.md"
RESULTS = ROOT / "results" / "trust"
BEGIN, END = "<!-- campaigns -->", "<!-- /campaigns -->"


def main() -> None:
    """Write the page."""
    PAGE.write_text(page())


def page() -> str:
    """What the page must hold."""
    text = PAGE.read_text()
    rows = [_row(name, say) for name, say in SAYINGS.items()]
    table = "\n".join(["| command | made with | what it found |", "|---|---|---|", *rows])
    head, rest = text.split(BEGIN)
    return f"{head}{BEGIN}\n\n{table}\n\n{END}{rest.split(END)[1]}"


def _row(name: str, say: Callable[[Any], str]) -> str:
    """A campaign's row."""
    path = RESULTS / f"{name}.json"
    if not path.exists():
        return f"| {name} | - | not finished yet |"
    found = json.loads(path.read_text())
    made = f"commit {found['commit'][:7]}, " if found.get("commit") else ""
    return f"| `{found['command']}` | {made}{found['date'][:10]} | {say(found)} |"


def _resumes(found: Any) -> str:
    return (
        f"{found['trials']} trainings stopped {found['stops']} times: "
        f"{found['inside_an_episode']} inside episodes, {found['inside_a_goal']} inside goals, "
        f"{found['epsilon_is_falling']} while epsilon fell; "
        f"{len(found['differences'])} files differ"
    )


def _kills(found: Any) -> str:
    others = sum(found["moments"].values()) - found["kills"]
    return (
        f"{found['kills']} kills and {others} failed writes while saving: "
        f"{len(found['wrong'])} times something else than the old or the new checkpoint was left"
    )


def _soak(found: Any) -> str:
    first, *rest = (each["largest_memory_mib"] for each in found["rounds"])
    return (
        f"{len(found['rounds'])} reproductions in {found['minutes']} min, stopped "
        f"{sum(found['stops'].values())} times: {len(found['differences'])} files differ; memory "
        f"of a process at most {first:,} MiB in the first, which compiles, "
        f"{', '.join(map(str, rest))} MiB in the others"
    )


def _faults(found: Any) -> str:
    return f"{found['caught']} of {found['faults']} deliberate faults caught"


SAYINGS: dict[str, Callable[[Any], str]] = {
    "resumes": _resumes,
    "kills": _kills,
    "soak": _soak,
    "faults": _faults,
}
"""By file in `results/trust`, what it says in one line."""


if __name__ == "__main__":
    main()
