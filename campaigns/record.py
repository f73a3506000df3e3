"""The result file of a campaign: what was done, how, with what, and what came out."""

import json
import shlex
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from lanewise.report.provenance import machine, versions
from lanewise.runs.files import write_atomically


def store(path: Path, figures: dict, seed: int | None = None, packages=()) -> None:
    """Write a result file.

    Args:
        path: of the file; its folder is made.
        figures: what came out.
        seed: of everything random, if anything was.
        packages: whose versions matter beside the usual ones.
    """
    document = {
        "command": shlex.join(["python", *sys.argv]),
        "seed": seed,
        "versions": versions() | {name: version(name) for name in packages},
        "machine": machine(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        **figures,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path.parent, {path.name: (json.dumps(document, indent=1) + "\n").encode()})
