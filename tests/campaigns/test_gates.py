"""Gates: each of `.ci/run` is in the table, and the table tells red from green."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import gates
import pytest
from gates import Gate

ROOT = Path(__file__).parents[2]


def test_every_check_of_ci_is_a_gate():
    script = (ROOT / ".ci" / "run").read_text()
    checks = re.findall(
        r'"((?:python -m pytest|python -m sphinx|python campaigns|ruff|mypy|lint)[^"]*)"', script
    )
    assert len(checks) >= 7
    assert script.count('/pip" install -q --require-hashes -r requirements/ci.txt') == 1
    assert script.count('/pip" check') == 1
    checks += ["pip install --require-hashes", "pip check"]
    known = [gate.command for gate in gates.GATES]
    missing = [check for check in checks if not any(command.startswith(check) for command in known)]
    # The examples' gate names the one file that it needs.
    assert [check for check in missing if check != "python -m pytest --dist load examples"] == []
    assert any(command.startswith("python -m pytest --dist load examples") for command in known)


@pytest.mark.parametrize("gate", gates.GATES, ids=lambda gate: gate.name)
def test_violations_are_violations(gate):
    good = (ROOT / gate.file).read_text() if gate.good is None else gate.good
    assert gate.broken(good) != good
    assert gate.says


def test_red_and_green_are_told_apart(tmp_path):
    (tmp_path / "notes.txt").write_text("all is well\n")
    grep = Gate("words", "python -c 'x'", "notes.txt", "well", "lost", "lost")
    program = "import sys; text = open('notes.txt').read(); print(text); sys.exit('lost' in text)"
    command = [sys.executable, "-c", program]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gates, "program", lambda _: command)
        seen = [
            gates.try_gate(gate, tmp_path)[0]
            for gate in (
                grep,
                replace(grep, new="found", says="found"),
                replace(grep, says="something else"),
            )
        ]
        assert [(row["green_without"], row["red_with"]) for row in seen] == [
            (True, True),
            (True, False),
            (True, False),
        ]
        broken = replace(grep, good="lost\n", old="lost", new="lost again")
        assert not gates.try_gate(broken, tmp_path)[0]["green_without"]
    assert (tmp_path / "notes.txt").read_text() == "all is well\n"
    with pytest.raises(ValueError, match="does not stand once"):
        replace(grep, old="well\n\n").broken("all is well\n")
