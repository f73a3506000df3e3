"""Pages: one that opens offline, that of a sweep, and names of a stranger's choice in each."""

import base64
import json
import re
import unicodedata
from html.parser import HTMLParser

import pytest
from markdown_it import MarkdownIt

from fabricate import make_episodes, make_sweep
from lanewise import config
from lanewise.errors import LanewiseError, SettingsError, brief
from lanewise.evaluation.grid import Grid
from lanewise.experiments import experiment, jobs, reporting, results, stored_tests
from lanewise.report import html_page, sweep_page
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
"""Every tag and attribute that a report may have."""


class Reader(HTMLParser):
    """What a browser would load, run and show."""

    def __init__(self, page):
        super().__init__()
        self.found, self.text = [], ""
        self.feed(page)
        self.tags = [tag for tag, _ in self.found]

    def handle_starttag(self, tag, attributes):
        self.found.append((tag, dict(attributes)))

    def handle_data(self, data):
        self.text += data

    def handle_comment(self, data):
        raise AssertionError(data)


@pytest.mark.parametrize(
    ("target", "inside"),
    [("figures/a.png", b"\x89PNG picture"), ("../secret.png", b""), ("/etc/hostname", b"")],
)
def test_pictures_below_the_folder_are_inside_the_page(tmp_path, target, inside):
    (tmp_path / "out" / "figures").mkdir(parents=True)
    (tmp_path / "out" / "figures" / "a.png").write_bytes(b"\x89PNG picture")
    (tmp_path / "secret.png").write_bytes(b"secret")
    page = Reader(html_page.render(f"![what it shows]({target})", "T", tmp_path / "out"))
    (source,) = [attributes["src"] for _, attributes in page.found if "src" in attributes]
    head, data = source.split(",")
    assert head.startswith("data:")
    assert base64.b64decode(data) == inside


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
    monkeypatch.setattr(reporting.figures, "write", lambda out, arms: {"x": STRANGE[5]})
    command = "lanewise reproduce --out '" + "".join(STRANGE) + "\udce4'"
    collected = results.collect(found, every)
    path, text = reporting.write(
        OpenFolder(tmp_path), found, collected, command, {"everything": 1.0}
    )
    return path.parent, text


def test_an_experiment_of_strange_names_stays_text(made):
    folder, text = made
    html = (folder / "report.html").read_text("utf-8")
    check_plain(html)
    page = Reader(html)
    for tag, attributes in page.found:
        assert attributes.keys() <= ALLOWED[tag], (tag, attributes)
        assert attributes.get("src", "data:image/").startswith("data:image/")
        style = attributes.get("style", "text-align:right")
        assert style in ("text-align:right", "text-align:left")
    assert page.tags.count("title") == page.tags.count("h1") == 1
    assert {"table", "th", "td", "strong"} <= set(page.tags)
    # They are all there, to be read.
    for name in ("<script>alert(1)</script>", "[click](javascript:alert(1))", "\\u202egnp.exe"):
        assert name in page.text
    check_plain((folder / "report.md").read_text("utf-8"))
    check_plain(text)
    stored = json.loads((folder / "report.json").read_text("utf-8"))
    assert [arm["title"] for arm in stored["arms"]] == list(STRANGE)
    # Values keep their types, and say whether the published figures may stand beside an arm's.
    settings = stored["arms"][0]["settings"]
    assert settings["scenario.missing_target_speed"] is True
    assert settings["scenario.training_front_distance"] == [14.8, 16.44]
    assert stored["arms"][0]["unlike_published"] == {"test": "", "training": ""}


def test_markdown_of_a_name_is_its_text():
    for written, title in [(write(title), title) for write in (cell, code) for title in STRANGE]:
        tokens = MarkdownIt("commonmark").enable("table").parse(f"| a |\n|---|\n| {written} |\n")
        _, inline = (token for token in tokens if token.type == "inline")
        assert {child.type for child in inline.children} <= {"text", "code_inline", "text_special"}
        assert "".join(child.content for child in inline.children) == line(title)


def test_errors_do_not_steer_a_terminal():
    assert len(brief("\x1b" * 500)) == 4 * 80
    for name in STRANGE:
        check_plain(str(LanewiseError(name)))
        assert "\n" not in brief(name)
        with pytest.raises(SettingsError) as caught:
            experiment.parse("x", f'preset = {quoted(name)}\n[arms.a]\ncontroller = "rule-based"')
        check_plain(str(caught.value))
        assert len(str(caught.value).splitlines()) <= 2


@pytest.fixture
def drawn(monkeypatch):
    """Names of the maps that a page would draw."""
    names = []
    monkeypatch.setattr(sweep_page, "save", lambda figure, path: names.append(path.name))
    return names


def test_a_sweep_on_disk(tmp_path, drawn):
    sweep = make_sweep(Grid((8.0, 13.0), (8.0, 9.0), (3,), (14.8, 16.44), (4.06,), (17.0, 25.0)))
    page = sweep_page.write(tmp_path, sweep)
    assert drawn == list(sweep_page.MAPS)
    document = json.loads((tmp_path / "map.json").read_text())
    rows = [dict(zip(document["columns"], row, strict=True)) for row in document["cells"]]
    assert [[row["successes_25"]] for row in rows] == [c.outcome.successes for c in sweep.cells]
    assert [row["spacing"] for row in rows] == [cell.place.spacing for cell in sweep.cells]
    totals = document["totals"]["25"]
    assert totals["all"]["cells"] == 16
    assert totals["all"]["escapes"] == sum(c.outcome.escapes[0] for c in sweep.cells)
    # 13 behind 8: none of 4; 13 behind 9: the two with the longer D1, without clearance.
    assert totals["winnable"]["cells"] == 10
    assert totals["winnable_with_clearance"]["cells"] == 8
    assert document["axes"]["spacing"] == [17.0, 25.0]
    assert document["trained_by"] == sweep.trained_by
    assert document["settings"]["scenario.trap_speed"] == 10.0
    text = page.read_text()
    assert re.findall(r"\]\((.*?)\)", text) == [f"{name}.png" for name in drawn]
    assert "| over | starts | episodes | success (paper) | success | accidents |" in text
    assert "| winnable starts | 10 | 200 |" in text
    assert "spacing: 17, 25" in text


def test_a_map_of_one_traffic_has_no_panel_for_it(tmp_path, drawn):
    sweep_page.write(tmp_path, make_sweep(Grid((8.0,), (8.0,), (3,), (14.8,), (4.06, 5.0))))
    assert drawn == ["map", "map-distances"]
