"""The pages say what the program does: settings, defaults, links, commands."""

import re
import shlex
from pathlib import Path

import ages
import make_results
import make_settings
import make_trust
import pytest

from lanewise import config
from lanewise.cli.command_line import parse
from lanewise.cli.main import COMMANDS, command_class
from lanewise.evaluation.metrics import PUBLISHED_TRAINING
from lanewise.system import version

ROOT = Path(__file__).parents[1]
PAGES = (
    *(
        ROOT / name
        for name in (
            *("README.md", "CHANGELOG.md", "benchmarks/README.md", "campaigns/README.md"),
            *("examples/README.md", "results/README.md"),
        )
    ),
    *sorted((ROOT / "docs").rglob("*.md")),
)
SECTIONS = {name.split(".")[0] for name in config.field_types()}


@pytest.fixture(scope="module")
def written():
    """The pages as they must be."""
    return make_results.pages()


def test_results_come_from_the_stored_files(written):
    for path, text in written.items():
        assert path.read_text() == text, f"{path.name}: run python docs/make_results.py"
    assert make_trust.PAGE.read_text() == make_trust.page(), "run python docs/make_trust.py"


def test_the_published_training_stands_whole_beside_ours():
    """Not the one figure that matches; and whose success is meant is said."""
    text = make_results.training("paper/report.json")
    rows = {line.split("|")[1].strip(): line for line in text.splitlines() if line[:1] == "|"}
    for name, figures in PUBLISHED_TRAINING.items():
        row = rows[f"*{name}, published*"]
        *plain, rate = figures.values()
        for figure in (*plain, 100 * rate):
            assert re.search(rf" {figure:.2f} | {figure:.1f} ", row), (row, figure)
        assert any(name in title and "published" not in title for title in rows)


@pytest.mark.parametrize(
    ("page", "result"),
    [
        ("README.md", "results/standard/report.json"),
        ("docs/speed.md", "results/bench.json"),
        ("docs/results.md", "results/outside"),
        ("docs/results.md", "results/standard/report.json"),
        ("docs/results.md", "results/paper/report.json"),
        ("docs/results.md", "results/readings/report.json"),
        ("docs/hierarchical.md", "results/standard/report.json"),
        ("docs/paper.md", "results/paper-literal/report.json"),
        ("docs/ranges.md", "results/ranges/wide/map.json"),
        ("docs/ranges.md", "results/ranges/wide-traffic/map.json"),
        ("docs/ranges.md", "results/search.json"),
        ("docs/quick-preset.md", "results/search.json"),
        ("examples/README.md", "results/outside/brief"),
        ("results/standard/report.md", "results/standard/report.json"),
        ("results/paper/report.md", "results/paper/report.json"),
        ("results/reproduce-quick/report.md", "results/reproduce-quick/report.json"),
        ("results/ranges/wide/map.md", "results/ranges/wide/map.json"),
        ("results/ranges/wide-traffic/map.md", "results/ranges/wide-traffic/map.json"),
    ],
)
def test_figures_of_trainings_stand_beside_their_age(written, page, result):
    found = ages.MARKED.findall(written[ROOT / page])
    notes = [note for _, name, what, note, _ in found if name == result]
    assert notes
    for note in notes:
        assert note.startswith(("**Stale**", "Commit ", "No commit recorded, ")), note


NOW = {"commit": "a" * 40, "clean_tree": True, "training": version.training()}
BEFORE = {"commit": "b" * 40, "clean_tree": False, "training": "0" * 12}
MADE = {"command": "lanewise bench", "date": "2026-11-28T20:00:00+00:00"}


def report(*sources):
    """A stored report: what trained its seeds counts, and not what wrote it."""
    seeds = [{"trained_by": source, "effort": {}} for source in sources]
    reference = {"trained_by": None, "effort": None}
    return MADE | NOW | {"arms": [{"seeds": [*seeds, reference]}]}


OLD_REPORT = {"arms": [{"seeds": [{"effort": {}}]}]}


@pytest.mark.parametrize(
    ("stored", "note"),
    [
        ([MADE | NOW], "Commit aaaaaaa, 2026-11-28."),
        (
            [MADE | BEFORE],
            "**Stale**: made before training changed (commit bbbbbbb with changes, 2026-11-28); "
            "make it anew with `lanewise bench`.",
        ),
        (
            [report(NOW, BEFORE)],
            "**Stale**: made before training changed (commit aaaaaaa, commit bbbbbbb with "
            "changes, 2026-11-28); make it anew with `lanewise bench`.",
        ),
        (
            [MADE | NOW | OLD_REPORT],
            "**Stale**: made before results named their training (no commit recorded, "
            "2026-11-28); make it anew with `lanewise bench`.",
        ),
        (
            [{"date": "2026-11-22"}],
            "**Stale**: made before results named their training (no commit recorded, "
            "2026-11-22); results/README.md says how to make it anew.",
        ),
    ],
)
def test_a_result_says_whether_training_has_changed_since(stored, note):
    assert ages.note(stored) == note


def test_marks_are_filled_and_stay():
    page = "a\n<!-- age: results/search.json -->\nold\n<!-- /age -->\nb\n"
    filled = ages.filled(page)
    assert "old" not in filled
    assert "ommit" in filled
    assert ages.filled(filled) == filled
    assert filled.startswith("a\n<!-- age: results/search.json -->\n")
    assert filled.endswith("\n<!-- /age -->\nb\n")


def commands(page):
    """Every `lanewise …` line of the shell examples, comments and continuation lines resolved."""
    for block in re.findall(r"```sh\n(.*?)```", page.read_text(), re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            if line.startswith("lanewise "):
                yield shlex.split(line, comments=True)[1:]


def test_settings_page_is_up_to_date():
    assert (ROOT / "docs" / "settings.md").read_text() == make_settings.page()


def test_the_readings_come_from_their_file():
    assert (ROOT / "docs" / "paper.md").read_text() == make_settings.paper_page()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_quoted_defaults_readings_and_metrics_are_up_to_date(page):
    assert make_settings.up_to_date(page.read_text()) == page.read_text()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_settings_exist(page):
    known = set(config.field_types())
    sections = {name.rpartition(".")[0] for name in known} | SECTIONS
    for name in re.findall(r"`([a-z_]+(?:\.[a-z_]+)+)(?: = [^`]*)?`", page.read_text()):
        if name.split(".")[0] in SECTIONS and not name.endswith((".py", ".toml", ".json")):
            assert name in known or name in sections, name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_flags_exist(page):
    known = {f"--{name.replace('_', '-')}": kind for name, kind in config.field_types().items()}
    for flag, value in re.findall(r"`(--[a-z_.-]+\.[a-z.-]+) ([^`]+)`", page.read_text()):
        known[flag].parse(flag, value.split())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)[^)]*\)", page.read_text()):
        assert (page.parent / target).exists(), target


NOT_HERE = {
    "campaigns/costs.py",  # of an older commit, which the page names
    "src/lanewise/controllers/remembering.py",  # which the reader writes
    "tests/WORLD.json",  # in a run folder
}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_files_exist(page):
    """Files in backticks stand below the root, the package or the page's own folder."""
    text = page.read_text() if page.name != "CHANGELOG.md" else ""  # which has old names
    for name in re.findall(r"`((?:[\w.-]+/)+[\w.-]+\.(?:py|toml|json|md))`", text):
        places = (ROOT, ROOT / "src" / "lanewise", page.parent)
        assert name in NOT_HERE or any((place / name).exists() for place in places), name


def test_commands_are_understood(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("[scenario]\ntrap_speed = 9.5\n")
    found = [words for page in PAGES for words in commands(page)]
    for words in found:
        if "--help" not in words and "--version" not in words:
            parse(command_class(words[0]), words[1:])
    assert {words[0] for words in found} >= set(COMMANDS)


def test_readme_has_two_set_up_commands():
    lines = re.findall(r"^python3 -m venv .*$", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert len(lines) == 2


@pytest.mark.parametrize("room", ["world", "scenario", "driving", "controllers", "learning"])
def test_the_reference_shows_every_module(room):
    shown = (ROOT / "docs" / "api" / f"{room}.md").read_text()
    for module in (ROOT / "src" / "lanewise" / room).glob("*.py"):
        if module.stem != "__init__":
            assert f"lanewise.{room}.{module.stem}\n" in shown


def test_the_way_of_data_has_no_way_back():
    """Each step of the table is a file that imports none of a later step."""
    text = (ROOT / "docs" / "architecture.md").read_text()
    way = text.partition("## The way of data")[2].partition("\n## ")[0]
    assert len(way.splitlines()) <= 40
    files = re.findall(r"^\| [a-z]+ \| `([a-z_/]+)\.py`", way, re.MULTILINE)
    assert len(files) == 11
    modules = [file.replace("/", ".") for file in files]
    for number, file in enumerate(files):
        source = (ROOT / "src" / "lanewise" / f"{file}.py").read_text()
        names = re.sub(r"from lanewise\.?([a-z_.]*) import (\w+)", r"from \1.\2", source)
        for later in modules[number + 1 :]:
            assert later not in names, (file, later)
