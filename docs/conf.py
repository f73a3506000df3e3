"""Settings of the documentation site: ``python -m sphinx -W --keep-going -b html docs site``."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

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

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "site_parts",
]
# README.md is for those who write these pages; the site begins with index.md.
exclude_patterns = ["README.md"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
html_math_renderer = "mathml"

autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "undoc-members": True}
# A name alone in backticks is code, and a link where it names something of ours.
default_role = "py:obj"
python_maximum_signature_line_length = 88
toc_object_entries_show_parents = "hide"
