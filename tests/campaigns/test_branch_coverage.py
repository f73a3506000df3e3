"""The gate of branch coverage: what is counted, and where it is red."""

import json
import sys

import branch_coverage
import pytest


def file(branches, missing):
    summary = {"num_statements": 9, "missing_lines": 1}
    summary |= {"num_branches": branches, "missing_branches": len(missing)}
    return {"summary": summary, "missing_branches": missing}


REPORT = {
    "totals": {
        "num_statements": 27,
        "missing_lines": 3,
        "num_branches": 40,
        "missing_branches": 2,
        "covered_branches": 38,
    },
    "files": {
        "src/lanewise/world/idm.py": file(10, []),
        "src/lanewise/world/mobil.py": file(10, [[3, 4]]),
        "/elsewhere/src/lanewise/cli.py": file(20, [[5, -1]]),
    },
}


def test_rooms_add_up():
    found = branch_coverage.figures(REPORT)
    assert found["share_of_branches"] == 0.95
    assert found["rooms"]["world"]["num_branches"] == 20
    assert found["rooms"]["world"]["share_of_branches"] == 0.95
    assert found["rooms"]["lanewise"]["missing_branches"] == 1
    assert found["branches_not_taken"]["src/lanewise/world/mobil.py"] == [[3, 4]]
    assert "src/lanewise/world/idm.py" not in found["branches_not_taken"]


@pytest.mark.parametrize(("covered", "status"), [(38, 0), (37, 1)])
def test_below_95_per_cent_is_red(covered, status, tmp_path, monkeypatch, capsys):
    path = tmp_path / "coverage.json"
    path.write_text(json.dumps({"totals": REPORT["totals"] | {"covered_branches": covered}}))
    monkeypatch.setattr(sys, "argv", ["branch_coverage.py", "--judge", str(path)])
    with pytest.raises(SystemExit) as ended:
        branch_coverage.main()
    assert ended.value.code == status
    assert f"{covered / 0.4:.1f} % of branches" in capsys.readouterr().out
