"""The pages say what the program does: settings, defaults, links, commands; their code runs."""

import json
import re
import shlex
from pathlib import Path

import ages
import make_results
import make_settings
import pytest

from lanewise import config
from lanewise.cli.command_line import parse
from lanewise.cli.main import COMMANDS, command_class
from lanewise.evaluation.metrics import PUBLISHED_TRAINING
from lanewise.system import version

ROOT = Path(__file__).parents[1]
PAGES = (
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "results/README.md")),
    *(ROOT / name / "README.md" for name in ("benchmarks", "campaigns", "examples")),
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


AGED = {
    "README.md": ["standard/report.json"],
    "docs/speed.md": ["bench.json"],
    "docs/results.md": [
        "outside",
        *(f"{r}/report.json" for r in ("standard", "paper", "readings")),
    ],
    "docs/hierarchical.md": ["standard/report.json"],
    "docs/findings.md": ["paper-literal", "standard/report.json"],
    "docs/ranges.md": ["ranges/wide/map.json", "ranges/wide-traffic/map.json", "search.json"],
    "docs/quick-preset.md": ["search.json"],
    "examples/README.md": ["outside/brief"],
}
"""Pages with figures of trainings, and which results; stored reports and maps have their own."""
for stored in ("standard", "paper", "reproduce-quick"):
    AGED[f"results/{stored}/report.md"] = [f"{stored}/report.json"]
for stored in ("ranges/wide", "ranges/wide-traffic"):
    AGED[f"results/{stored}/map.md"] = [f"{stored}/map.json"]


def test_figures_of_trainings_stand_beside_their_age(written):
    for page, results in AGED.items():
        found = ages.MARKED.findall(written[ROOT / page])
        for result in results:
            notes = [note for _, name, what, note, _ in found if name == f"results/{result}"]
            assert notes, (page, result)
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
            [{"date": "2026-11-22"}],
            "**Stale**: made before results named their training (no commit recorded, "
            "2026-11-22); results/README.md says how to make it anew.",
        ),
        (
            [report(NOW, BEFORE)],
            "**Stale**: made before training changed (commit aaaaaaa, commit bbbbbbb with "
            "changes, 2026-11-28); make it anew with `lanewise bench`.",
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


def test_settings_and_readings_come_from_the_code():
    assert (ROOT / "docs" / "settings.md").read_text() == make_settings.page()
    assert (ROOT / "docs" / "paper.md").read_text() == make_settings.paper_page()


@pytest.fixture(params=PAGES, ids=lambda page: page.name)
def page(request):
    return request.param


def test_quoted_defaults_readings_and_metrics_are_up_to_date(page):
    assert make_settings.up_to_date(page.read_text()) == page.read_text()


def test_named_settings_exist(page):
    known = set(config.field_types())
    sections = {name.rpartition(".")[0] for name in known} | SECTIONS
    for name in re.findall(r"`([a-z_]+(?:\.[a-z_]+)+)(?: = [^`]*)?`", page.read_text()):
        if name.split(".")[0] in SECTIONS and not name.endswith((".py", ".toml", ".json")):
            assert name in known or name in sections, name


def test_named_flags_exist(page):
    known = {f"--{name.replace('_', '-')}": kind for name, kind in config.field_types().items()}
    for flag, value in re.findall(r"`(--[a-z_.-]+\.[a-z.-]+) ([^`]+)`", page.read_text()):
        known[flag].parse(flag, value.split())


def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)[^)]*\)", page.read_text()):
        assert (page.parent / target).exists(), target


NOT_HERE = {
    "campaigns/costs.py",  # of an older commit, which the page names
    "src/lanewise/controllers/remembering.py",  # which the reader writes
    "tests/WORLD.json",  # in a run folder
}


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


def test_the_reference_shows_every_module():
    for room in ("world", "scenario", "driving", "controllers", "learning"):
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


BLOCK = re.compile(r"^```(?:python|py)\b[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)
QUICK = ("algorithms.md", "trap.md")
"""Pages that take a few seconds; the others compile whole environments."""
NOTEBOOK = ROOT / "examples" / "first_hour.ipynb"
ELSEWHERE = ("usage.md",)
"""Pages whose blocks want exported files, and are run by `tests/export/test_visited_states.py`."""
WITH_CODE = [
    pytest.param(page, id=page.name, marks=() if page.name in QUICK else pytest.mark.slow)
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if BLOCK.search(page.read_text()) and page.name not in ELSEWHERE
]


@pytest.mark.parametrize("page", WITH_CODE)
def test_code_runs(page, unoptimised, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = page.read_text()
    names = {"__name__": page.stem}
    for block in BLOCK.finditer(text):
        # Empty lines before the code, so that a traceback tells the page's line.
        before = "\n" * text.count("\n", 0, block.start(1))
        exec(compile(before + block[1], str(page), "exec"), names)


@pytest.mark.slow
def test_the_notebook_runs(unoptimised, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    names = {"__name__": NOTEBOOK.stem}
    for number, cell in enumerate(cells):
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), f"{NOTEBOOK} cell {number}", "exec"), names)
    assert (tmp_path / "escape.gif").stat().st_size > 10_000


def test_the_notebook_is_small_and_its_links_lead_somewhere():
    assert NOTEBOOK.stat().st_size < 200_000
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", "".join(cell["source"])):
            assert (NOTEBOOK.parent / target).exists(), target


def test_blocks_that_make_our_environments_import_what_registers_them():
    """Here something has imported it already; in a reader's new interpreter nothing has."""
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        for block in BLOCK.findall(page.read_text()):
            # A block that begins with Gymnasium stands alone; others go on from one before.
            if "import gymnasium" in block and '("lanewise/' in block:
                assert re.search(r"^(import|from) lanewise", block, re.MULTILINE), page.name


def test_no_block_is_left_out():
    fences = re.compile(r"^\s*```\s*(?:python|py)\b", re.MULTILINE)
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        text = page.read_text()
        assert len(fences.findall(text)) == len(BLOCK.findall(text)), page.name
