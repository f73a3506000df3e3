"""Every Python block of the README, the pages and the notebook runs, from top to bottom."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```(?:python|py)\b[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)
QUICK = ("algorithms.md", "trap.md")
"""Pages that take a few seconds; the others compile whole environments."""
NOTEBOOK = ROOT / "examples" / "first_hour.ipynb"
ELSEWHERE = ("usage.md",)
"""Pages whose blocks want exported files, and are run by `tests/export/test_visited_states.py`."""
PAGES = [
    pytest.param(page, id=page.name, marks=() if page.name in QUICK else pytest.mark.slow)
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if BLOCK.search(page.read_text()) and page.name not in ELSEWHERE
]


@pytest.mark.parametrize("page", PAGES)
def test_code_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = page.read_text()
    names = {"__name__": page.stem}
    for block in BLOCK.finditer(text):
        # Empty lines before the code, so that a traceback tells the page's line.
        before = "\n" * text.count("\n", 0, block.start(1))
        exec(compile(before + block[1], str(page), "exec"), names)


@pytest.mark.slow
def test_the_notebook_runs(tmp_path, monkeypatch):
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
