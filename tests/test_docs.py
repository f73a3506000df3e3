"""The pages say what the program does: settings, defaults, links, commands."""

import re
import shlex
from pathlib import Path

import make_results
import make_settings
import make_trust
import pytest

from lanewise import cli, config
from lanewise.commands.arguments import parse
from lanewise.evaluation.metrics import PUBLISHED_TRAINING

ROOT = Path(__file__).parents[1]
PAGES = (
    *(
        ROOT / name
        for name in ("README.md", "CHANGELOG.md", "benchmarks/README.md", "examples/README.md")
    ),
    *sorted((ROOT / "docs").rglob("*.md")),
)
SECTIONS = {name.split(".")[0] for name in config.kinds()}


def test_results_come_from_the_stored_files():
    for path, text in make_results.pages().items():
        assert path.read_text() == text, f"{path.name}: run python docs/make_results.py"
    assert make_trust.PAGE.read_text() == make_trust.page(), "run python docs/make_trust.py"


def test_the_published_training_stands_whole_beside_ours():
    """Not the one figure that matches; and whose success is meant is said."""
    text = make_results._at_the_papers_size(make_results._read(make_results.PAPER))
    rows = {line.split("|")[1].strip(): line for line in text.splitlines() if line[:1] == "|"}
    for name, figures in PUBLISHED_TRAINING.items():
        row = rows[f"*{name}, published*"]
        *plain, rate = figures.values()
        for figure in (*plain, 100 * rate):
            assert re.search(rf" {figure:.2f} | {figure:.1f} ", row), (row, figure)
        assert any(name in title and "published" not in title for title in rows)
    assert "accident" in text
    assert "(docs/paper.md#what-was-fitted)" in text


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
    known = set(config.kinds())
    sections = {name.rpartition(".")[0] for name in known} | SECTIONS
    for name in re.findall(r"`([a-z_]+(?:\.[a-z_]+)+)(?: = [^`]*)?`", page.read_text()):
        if name.split(".")[0] in SECTIONS and not name.endswith((".py", ".toml")):
            assert name in known or name in sections, name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_named_flags_exist(page):
    known = {f"--{name.replace('_', '-')}": kind for name, kind in config.kinds().items()}
    for flag, value in re.findall(r"`(--[a-z_.-]+\.[a-z.-]+) ([^`]+)`", page.read_text()):
        known[flag].parse(flag, value.split())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\((?!https?:)([^)#]+)[^)]*\)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_commands_are_understood(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("[scenario]\ntrap_speed = 9.5\n")
    found = [words for page in PAGES for words in commands(page)]
    for words in found:
        if "--help" not in words and "--version" not in words:
            parse(cli.COMMANDS[words[0]], words[1:])
    assert {words[0] for words in found} >= set(cli.COMMANDS)


def test_readme_has_two_set_up_commands():
    lines = re.findall(r"^python3 -m venv .*$", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert len(lines) == 2
