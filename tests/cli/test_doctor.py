"""What is installed and what is missing, told with one line of advice each."""

import json
import re
from pathlib import Path

from lanewise.cli.main import main
from lanewise.report import installation, provenance


def test_all_is_well(capsys):
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["machine"]["backend"] in ("cpu", "gpu")
    findings = [installation.InstallationFinding(**each) for each in found["features"]]
    by_feature = {each.feature: each for each in findings}
    assert by_feature["training, tests, environments"].packages["optax"]
    said = installation.text(found["machine"], findings)
    for part in ("jax", "highway-env 1.12.1"):
        assert part in said
    assert "broken" not in said
    assert all(len(line) < 200 for line in said.splitlines())


def test_what_is_missing(monkeypatch, capsys):
    def version(name):
        if name == "matplotlib":
            raise provenance.PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(provenance, "version", version)
    assert main(["doctor"]) == 1  # highway-env 1.0 is another than ours speaks of
    said = capsys.readouterr().out
    assert 'pip install ".[report]" in your clone brings matplotlib' in said
    assert "highway-env 1.12.1 is needed, 1.0 is here" in said


def test_a_gpu_that_jax_does_not_use(monkeypatch):
    monkeypatch.setattr(installation, "devices", lambda: {"backend": "cpu"})
    for here in (False, True):
        monkeypatch.setattr(installation.shutil, "which", lambda name, here=here: here or None)
        *_, gpu = installation.examine()
        assert (".[cuda13]" in gpu.advice) == here


def test_a_package_that_does_not_import(monkeypatch):
    def broken(name):
        raise OSError("libpng.so: cannot open")

    monkeypatch.setattr(installation, "import_module", broken)
    found = {one.feature: one for one in installation.examine()}
    report = found["pictures, clips, report pages"]
    assert report.status == "broken"
    assert "does not import (libpng.so: cannot open)" in report.advice


def test_nobody_is_sent_to_a_registry_for_lanewise():
    """There the name may be somebody else's; extras of ours come from the clone."""
    package = Path(installation.__file__).parents[1]
    sent = [
        path.name
        for path in package.rglob("*.py")
        if re.search(r"lanewise\[|pip install[^\n]* lanewise\b", path.read_text("utf-8"))
    ]
    assert sent == []
