"""``lanewise doctor``: what is installed, what is missing for which feature, and what to do."""

import json
import sys
from dataclasses import asdict, dataclass, field

from lanewise.commands.arguments import Parsed


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Tell what is installed, what is missing for which feature, and what to do about it."""

    json: bool = field(default=False, metadata={"switch": True})
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
