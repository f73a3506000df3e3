"""Settings of the documentation site: ``python -m sphinx -W --keep-going -b html docs site``."""

import inspect
import re
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

from docutils.nodes import SkipNode
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

from lanewise.system.version import __version__

project = "Lanewise"
copyright = "The Lanewise authors, MIT licence"
version = release = __version__
html_title = f"Lanewise {__version__}"
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sphinx = False
pygments_dark_style = "github-dark"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
# README.md is for those who write these pages; the site begins with index.md.
exclude_patterns = ["README.md"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
html_math_renderer = "mathml"

autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "undoc-members": True}
# A name alone in backticks is code, and a link where it names something of Lanewise.
default_role = "py:obj"
python_maximum_signature_line_length = 88
toc_object_entries_show_parents = "hide"

REPORTS = {
    "results/standard/report.md": "reports/standard",
    "results/paper/report.md": "reports/paper",
    "results/ranges/wide/map.md": "reports/map",
    "results/ranges/wide-traffic/map.md": "reports/map-traffic",
    "benchmarks/README.md": "reports/benchmarks",
    "examples/README.md": "reports/examples",
}
"""Files beside ``docs`` that the site shows, and the pages that include them."""

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


def inline(translator: HTML5Translator, node: Any) -> None:
    """A formula within a line, as MathML: no script and no font from elsewhere."""
    translator.body.append(tex2mathml(node.astext()))
    raise SkipNode


def block(translator: HTML5Translator, node: Any) -> None:
    """A formula of its own, which scrolls where it is wider than the page."""
    formula = tex2mathml(node.astext(), as_block=True)
    translator.body.append(f'<div class="math">{formula}</div>')
    raise SkipNode


def setup(app: Sphinx) -> None:
    """Connect it all."""
    # Before napoleon, which turns sections of a docstring into markup.
    app.connect("autodoc-process-docstring", plain, priority=400)
    app.connect("autodoc-process-signature", without_signature)
    app.connect("source-read", links)
    app.connect("include-read", included)
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
