"""The report as one page that opens offline."""

import base64
from html.parser import HTMLParser

import pytest

from lanewise.report import html_page


class Reader(HTMLParser):
    """What a browser would load, run and show."""

    def __init__(self):
        super().__init__()
        self.tags, self.sources, self.text = [], [], []

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.sources += [value for name, value in attributes if name in ("src", "href")]

    def handle_data(self, data):
        self.text.append(data)


def read(html):
    reader = Reader()
    reader.feed(html)
    return reader


def test_pictures_are_inside(tmp_path):
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "a.png").write_bytes(b"\x89PNG picture")
    found = read(html_page.render("# T\n\n![what it shows](figures/a.png)\n", "T", tmp_path))
    (source,) = found.sources
    head, data = source.split(",")
    assert head == "data:image/png;base64"
    assert base64.b64decode(data) == b"\x89PNG picture"


@pytest.mark.parametrize("target", ["../secret.png", "/etc/hostname"])
def test_nothing_outside_the_folder_gets_in(tmp_path, target):
    out = tmp_path / "out"
    (out / "figures").mkdir(parents=True)
    (tmp_path / "secret.png").write_bytes(b"secret")
    (source,) = read(html_page.render(f"![x]({target})", "T", out)).sources
    assert source.endswith("base64,")


def test_tables_and_titles_are_shown_and_markup_in_them_is_text(tmp_path):
    markdown = (
        "# <script>alert(1)</script>\n\n| arm | success |\n|---|---:|\n"
        "| <b onmouseover=x>a</b> | **99.9** |\n\n[paper](https://arxiv.org/abs/2501.14992)\n"
    )
    html = html_page.render(markdown, "<title></title>", tmp_path)
    found = read(html)
    assert {"table", "th", "td", "strong", "h1"} <= set(found.tags)
    assert not {"script", "b", "iframe", "link"} & set(found.tags)
    assert "<script>alert(1)</script>" in "".join(found.text)
    assert found.tags.count("title") == 1
    assert "http" not in html.replace('href="https://arxiv.org', "")  # nothing is fetched
