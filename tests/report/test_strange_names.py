"""Names and titles of a stranger's choice stay text: in Markdown, the page, JSON, a terminal."""

import json
import unicodedata
from html.parser import HTMLParser

import pytest
from fabricate import make_episodes
from markdown_it import MarkdownIt

from lanewise import config
from lanewise.errors import LanewiseError, SettingsError, brief
from lanewise.experiments import experiment, jobs, reporting, results, stored_tests
from lanewise.report.markup import cell, code, line
from lanewise.system.folder_io import OpenFolder
from untrusted_files import store_test

STRANGE = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "</title></style><script>x</script>",
    "a | b | c",
    r"back\slash \| pipe",
    "[click](javascript:alert(1))",
    "&lt;b&gt; &#x3c;b>",
    "```\nfence\n```",
    "*bold* _it_ ~~no~~ $x^2$ # head",
    "one\ntwo\r\n# three\n\n| a |",
    "\u202egnp.exe\u2066 turned\u200f",
    "\x1b[2J\x1b]0;owned\x07\x9b31m",
    "x" * 190,
)
ALLOWED = {
    "html": {"lang"},
    "meta": {"charset", "name", "content"},
    "div": {"class"},
    "img": {"src", "alt"},
    "th": {"style"},
    "td": {"style"},
    **dict.fromkeys(("head", "title", "style", "body", "h1", "h2", "h3", "p", "em"), frozenset()),
    **dict.fromkeys(("strong", "code", "ul", "li", "table", "thead", "tbody", "tr"), frozenset()),
}
"""Every tag and attribute that a page may have."""


class Reader(HTMLParser):
    """What a browser would make of a page."""

    def __init__(self):
        super().__init__()
        self.found, self.text = [], []

    def handle_starttag(self, tag, attributes):
        self.found.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text.append(data)

    def handle_comment(self, data):
        raise AssertionError(data)


def check_page(page):
    reader = Reader()
    reader.feed(page)
    for tag, attributes in reader.found:
        assert attributes.keys() <= ALLOWED[tag], (tag, attributes)
        assert attributes.get("src", "data:image/").startswith("data:image/")
        assert attributes.get("style", "text-align:right") in (
            "text-align:right",
            "text-align:left",
        )
    check_plain(page)
    return reader


def check_plain(text):
    """Nothing in it steers a terminal or turns writing around."""
    assert not [c for c in text if c != "\n" and unicodedata.category(c) in ("Cc", "Cf", "Cs")]


def quoted(text):
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


@pytest.fixture
def made(tmp_path, monkeypatch):
    """The report of an experiment with a strange title and one reference driver a strange name."""
    parts = [f"title = {quoted(STRANGE[0] + STRANGE[3] + STRANGE[10])}"]
    parts.append("seeds = 1\nepisodes = 300\nhighway_env_episodes = 0")
    for number, title in enumerate(STRANGE):
        head = f"[arms.{'single-level' if number == 0 else f'arm-{number}'}]"
        parts.append(f'{head}\ntitle = {quoted(title)}\ncontroller = "rule-based"')
    found = experiment.parse("strange", "\n".join(parts))
    every = jobs.of_experiment(found, tmp_path, 0, "trap-10", {})
    for job in every:
        job.path.mkdir(parents=True)
        (job.path / stored_tests.SETTINGS).write_text(config.dump_toml(job.settings))
        store_test(job, make_episodes())
    monkeypatch.setattr(reporting.clip, "render", lambda recording, path: None)
    monkeypatch.setattr(reporting.drives, "write", lambda out, results: None)
    monkeypatch.setattr(results.SeedResult, "record", lambda self, episode=0: None)
    monkeypatch.setattr(
        reporting.figures, "write", lambda out, arms: [reporting.figures.Drawn("x", STRANGE[5])]
    )
    command = "lanewise reproduce --out '" + "".join(STRANGE) + "\udce4'"
    collected = results.collect(found, every)
    path, text = reporting.write(
        OpenFolder(tmp_path), found, collected, command, {"everything": 1.0}
    )
    return path.parent, text


def test_an_experiment_of_strange_names_stays_text(made):
    folder, text = made
    reader = check_page((folder / "report.html").read_text("utf-8"))
    tags = [tag for tag, _ in reader.found]
    assert tags.count("title") == 1
    assert tags.count("h1") == 1
    shown = "".join(reader.text)
    # They are all there, to be read.
    assert "<script>alert(1)</script>" in shown
    assert "[click](javascript:alert(1))" in shown
    assert "\\u202egnp.exe" in shown
    check_plain((folder / "report.md").read_text("utf-8"))
    check_plain(text)
    stored = json.loads((folder / "report.json").read_text("utf-8"))
    assert [arm["title"] for arm in stored["arms"]] == list(STRANGE)
    # Values keep their types, and say whether the published figures may stand beside an arm's.
    settings = stored["arms"][0]["settings"]
    assert settings["scenario.missing_target_speed"] is True
    assert settings["scenario.training_front_distance"] == [14.8, 16.44]
    assert stored["arms"][0]["unlike_published"] == {"test": "", "training": ""}


@pytest.mark.parametrize("title", STRANGE)
def test_markdown_of_a_name_is_its_text(title):
    for written in (cell(title), code(title)):
        tokens = MarkdownIt("commonmark").enable("table").parse(f"| a |\n|---|\n| {written} |\n")
        inline = [token for token in tokens if token.type == "inline"]
        assert len(inline) == 2
        children = inline[1].children
        assert {child.type for child in children} <= {"text", "code_inline", "text_special"}
        assert "".join(child.content for child in children) == line(title)


@pytest.mark.parametrize("name", STRANGE)
def test_errors_do_not_steer_a_terminal(name):
    check_plain(str(LanewiseError(name)))
    assert "\n" not in brief(name)
    assert len(brief("\x1b" * 500)) == 4 * 80
    with pytest.raises(SettingsError) as caught:
        experiment.parse("x", f'preset = {quoted(name)}\n[arms.a]\ncontroller = "rule-based"')
    check_plain(str(caught.value))
    assert len(str(caught.value).splitlines()) <= 2
