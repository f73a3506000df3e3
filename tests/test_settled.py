"""Facts about the package that break easily and are seen late."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest

import lanewise

ROOT = Path(__file__).parents[1]
LIGHT = (
    "lanewise",
    "lanewise.cli.main",
    "lanewise.config",
    "lanewise.controllers.registry",
    "lanewise.runs.run_folder",
    *(
        f"lanewise.{path.parent.name}.settings"
        for path in sorted((ROOT / "src" / "lanewise").glob("*/settings.py"))
    ),
)


@pytest.mark.parametrize("module", LIGHT)
def test_imports_without_jax(module):
    program = f"import sys, {module}; sys.exit(bool({{'jax', 'optax'}} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", program]).returncode == 0


def test_every_part_with_settings_is_looked_at():
    assert len(LIGHT) == 13


def test_version_is_one():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert project["version"] == citation[1] == lanewise.__version__ == version("lanewise")


def test_types_are_shipped():
    assert (Path(lanewise.__file__).parent / "py.typed").exists()


def test_highway_env_version_is_the_one_we_speak_of():
    assert version("highway-env") == "1.12.1"
