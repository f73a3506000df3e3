"""The result file of a campaign: what was done, how, with what, and what came out."""

import hashlib
import json
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from lanewise.report.provenance import machine, source, versions
from lanewise.system.folder_io import write_atomically

ROOT = Path(__file__).parents[1]


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
        **source(),
        "machine": machine(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        **figures,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path.parent, {path.name: (json.dumps(document, indent=1) + "\n").encode()})


def state(*more, within=(), packages=(), root=ROOT) -> str:
    """Digest of all that what a campaign keeps depends on: files, versions, options.

    Args:
        more: options that matter.
        within: folders or files; without, everything that git knows or would add, but what the
            campaigns themselves store.
        packages: whose versions matter beside the usual ones.
        root: of the tree.
    """
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", *within],
        cwd=root, capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    found = versions() | {name: version(name) for name in packages}
    total = hashlib.sha256(repr((found, more)).encode())
    for name in sorted(filter(None, listing.split("\0"))):
        if (root / name).is_file() and not name.startswith("results/trust"):
            total.update(name.encode() + (root / name).read_bytes())
    return total.hexdigest()
