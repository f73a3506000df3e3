"""The result file of a campaign: what was done, how, with what, and what came out."""

import argparse
import hashlib
import json
import shlex
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

from lanewise.report.provenance import origin, versions
from lanewise.system.folder_io import OpenFolder, write_atomically

ROOT = Path(__file__).parents[1]


def parse(description: str, name: str, **sizes: float) -> argparse.Namespace:
    """Read a campaign's command line; ``sizes`` are the defaults of its own options."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    for option, default in sizes.items():
        parser.add_argument(f"--{option}", type=type(default), default=default)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "trust" / f"{name}.json")
    return parser.parse_args()


def store(path: Path, figures: dict, seed: int | None = None, packages=()) -> None:
    """Write a result file; ``packages`` are those whose versions matter beside the usual ones."""
    made = origin()
    made["versions"] |= {name: version(name) for name in packages}
    document = {
        "command": shlex.join(["python", *sys.argv]),
        "seed": seed,
        **made,
        **figures,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with OpenFolder(path.parent) as place:
        write_atomically(place, {path.name: (json.dumps(document, indent=1) + "\n").encode()})


def state(*more, within=(), packages=(), root=ROOT) -> str:
    """Digest of all that what a campaign keeps depends on: options, files, versions.

    The files are those ``within`` some folders; without, everything that git knows or would add,
    but what the campaigns themselves store.
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
