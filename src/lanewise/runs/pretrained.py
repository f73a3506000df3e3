"""Controllers called by name where a run folder is expected. Imports no JAX.

``pretrained/NAME`` is a trained one, stored as a run folder inside the package;
``reference/NAME`` one that needs no training. A run folder of that path comes first.
"""

from pathlib import Path

from lanewise.controllers.registry import REFERENCES
from lanewise.errors import RunError, brief
from lanewise.fields.suggestions import nearest
from lanewise.runs.run_folder import RunFolder, split

PRETRAINED = Path(__file__).parent / "pretrained"
"""Where the trained ones lie."""
DRIVER = Path("pretrained/driver")
"""Who is tested and drawn where no run is named."""


def names() -> tuple[str, ...]:
    """Names of the trained controllers in the package."""
    return tuple(sorted(path.parent.name for path in PRETRAINED.glob("*/run.json")))


def locate(path: Path) -> Path:
    """The run folder of ``path``, which may name a checkpoint in it (`run_folder.split`).

    ``pretrained/NAME`` leads into the package.
    """
    if path.exists() or len(path.parts) != 2 or path.parts[0] != "pretrained":
        return split(path)[0]
    return PRETRAINED / _known(path, names())


def reference_name(path: Path) -> str | None:
    """The name of the reference driver that ``path`` names, None where it names none."""
    if path.exists() or len(path.parts) != 2 or path.parts[0] != "reference":
        return None
    return _known(path, REFERENCES)


def controller_name(path: Path) -> str:
    """Name of the controller that ``path`` leads to; reads no weights."""
    return reference_name(path) or RunFolder.open(locate(path)).controller


def _known(path: Path, known: tuple[str, ...]) -> str:
    group, name = path.parts
    if name in known:
        return name
    hint = nearest(name, known) or f"known: {', '.join(known) or 'none'}"
    raise RunError(f'there is no {group} controller "{brief(name)}"; {hint}')
