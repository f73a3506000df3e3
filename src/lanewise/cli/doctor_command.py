"""``lanewise doctor``: what is installed, what is missing for which feature, and what to do."""

import json
import sys
from dataclasses import asdict, dataclass

from lanewise.cli.command_line import Parsed


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Show what is installed, what is missing for which feature, and what to do."""

    json: bool = False
    """Print one JSON object instead of lines."""


def run(parsed: Parsed[Doctor]) -> int:
    """Looks; returns 1 if something that is installed does not work, else 0."""
    from lanewise.report import installation, provenance

    findings = list(installation.examine())
    machine = provenance.machine() | installation.devices()
    if parsed.command.json:
        found = {"versions": provenance.versions(), "machine": machine}
        sys.stdout.write(json.dumps(found | {"features": list(map(asdict, findings))}) + "\n")
    else:
        sys.stdout.write(installation.text(machine, findings))
    return 1 if any(one.status == installation.BROKEN for one in findings) else 0
