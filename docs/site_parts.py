"""What the site needs beside Sphinx's own: docstrings, formulas, links, and nothing left out."""

import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from latex2mathml import converter
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

LOG = logging.getLogger(__name__)

REPORTS = {
    "results/standard/report.md": "reports/standard",
    "results/paper/report.md": "reports/paper",
    "results/ranges/wide/map.md": "reports/map",
    "results/ranges/wide-traffic/map.md": "reports/map-traffic",
    "benchmarks/README.md": "reports/benchmarks",
    "examples/README.md": "reports/examples",
}
"""Files beside ``docs`` that the site shows, and the pages that include them."""

ROOMS = ("world", "scenario", "driving", "controllers", "learning")
"""Rooms of which the reference shows every module."""

CODE = re.compile(r"(``[^`]*``|`[^`]*`|(?<!\S)\*\w[\w ]*\*(?![\w*]))")
"""What docstrings mean as markup: code, and words between stars."""
MARKUP = re.compile(r"([|*\\]|(?<=\w)_(?!\w))")
"""What docstrings mean literally and reStructuredText would take for markup."""


def plain(app: Sphinx, what: str, name: str, of: Any, options: Any, lines: list[str]) -> None:
    """Let bars, stars and trailing underscores of a docstring stand for themselves."""
    parts = CODE.split("\n".join(lines))
    parts[::2] = [MARKUP.sub(r"\\\1", part) for part in parts[::2]]
    for number in range(2, len(parts), 2):
        # `Vehicle`s: a letter right behind code.
        parts[number] = re.sub(r"^(?=\w)", r"\\ ", parts[number])
    lines[:] = "".join(parts).split("\n")
    if what in ("attribute", "data", "property"):
        # Napoleon would take what stands before a colon in the first line for a type; so that line
        # is an empty comment.
        lines[:0] = ["..", ""]


def without_signature(
    app: Sphinx, what: str, name: str, of: Any, options: Any, signature: str, returns: str
) -> tuple[str, str] | None:
    """Dataclasses and protocols without a signature: the members below say it all."""
    bare = inspect.isclass(of) and (is_dataclass(of) or getattr(of, "_is_protocol", False))
    return ("", "") if bare else None


def links(app: Sphinx, page: str, source: list[str]) -> None:
    """Point links to files beside ``docs`` to the pages that show them."""
    up = "../" * page.count("/")
    for file, shown in REPORTS.items():
        source[0] = source[0].replace(f"](../{file}", f"]({up}{shown}.md")


def included(app: Sphinx, file: Path, page: str, source: list[str]) -> None:
    """Point links of an included file, which is read as if it stood beside ``docs``, to pages."""
    source[0] = source[0].replace("](../docs/", "](../")


def formula(latex: str, display: str) -> str:
    """A formula as MathML, which browsers show without scripts or fonts from elsewhere."""
    found: str = converter.convert(latex, display=display)
    if "\\" in found:
        LOG.warning("a formula has a command that cannot be shown: %s", latex)
    return found


def inline(translator: HTML5Translator, node: Any) -> None:
    """A formula within a line."""
    translator.body.append(formula(node.astext(), "inline"))
    raise SkipNode


def block(translator: HTML5Translator, node: Any) -> None:
    """A formula of its own, which scrolls where it is wider than the page."""
    translator.body.append(f'<div class="math">{formula(node.astext(), "block")}</div>')
    raise SkipNode


def public_names(module: str) -> Iterator[str]:
    """Full names of the functions, classes, methods and fields that a module itself defines."""
    for name, value in vars(importlib.import_module(module)).items():
        own = getattr(value, "__module__", None) == module
        if name.startswith("_") or not own:
            continue
        if inspect.isclass(value):
            yield f"{module}.{name}"
            members = set(vars(value)) | set(inspect.get_annotations(value))
            yield from (f"{module}.{name}.{member}" for member in members if member[0] != "_")
        elif callable(value):
            yield f"{module}.{name}"


def complete(app: Sphinx, env: Any) -> None:
    """Warn of modules and public names that no page of the reference shows."""
    objects = list(env.domains["py"].get_objects())
    shown = {name for name, *_ in objects}
    modules = {name for name, _, kind, *_ in objects if kind == "module"}
    for room in ROOMS:
        place = importlib.import_module(f"lanewise.{room}").__path__
        for found in pkgutil.iter_modules(place, f"lanewise.{room}."):
            if found.name not in modules:
                LOG.warning("%s is not in the reference", found.name)
    for module in sorted(modules):
        for name in public_names(module):
            if name not in shown:
                LOG.warning("%s is not in the reference", name)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect it all."""
    # Before napoleon, which turns sections of a docstring into markup.
    app.connect("autodoc-process-docstring", plain, priority=400)
    app.connect("autodoc-process-signature", without_signature)
    app.connect("source-read", links)
    app.connect("include-read", included)
    app.connect("env-check-consistency", complete)
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
