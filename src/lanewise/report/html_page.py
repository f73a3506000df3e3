"""A Markdown report as one page that opens offline: pictures inside, no script, nothing fetched."""

import base64
import mimetypes
from html import escape
from pathlib import Path

from markdown_it import MarkdownIt
from markdown_it.token import Token

from lanewise.errors import printable

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem;
       color: #1a1a1a; background: #fff; }
h1, h2 { line-height: 1.2; } h2 { margin-top: 2.5rem; border-bottom: 1px solid #ccc; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.85rem; font-variant-numeric: tabular-nums; }
th, td { border-bottom: 1px solid #ddd; padding: 0.25rem 0.6rem; vertical-align: top; }
img { max-width: 100%; height: auto; } code { background: #f2f2f2; padding: 0 0.2em; }
"""


def render(markdown: str, title: str, folder: Path) -> str:
    """The page as HTML, with every picture below the folder as a data URI.

    HTML in the Markdown is shown as text; of a picture elsewhere only the text is left.
    """
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = reader.parse(markdown)
    for token in tokens:
        for inner in token.children or ():
            if inner.type == "image":
                _embed(inner, folder)
    body = reader.renderer.render(tokens, reader.options, {})
    body = body.replace("<table>", '<div class="wide"><table>')
    body = body.replace("</table>", "</table></div>")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(printable(title))}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n{body}</body>\n"
        "</html>\n"
    )


def _embed(image: Token, folder: Path) -> None:
    """Put a picture's bytes into the page."""
    path = (folder / str(image.attrs["src"])).resolve()
    inside = path.is_relative_to(folder.resolve()) and path.is_file()
    kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    data = base64.b64encode(path.read_bytes()).decode() if inside else ""
    image.attrs["src"] = f"data:{kind};base64,{data}"
