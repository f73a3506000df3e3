"""Controllers that come with the package, called by name where a run folder is expected.

``pretrained/NAME`` is a trained one, stored as a run folder inside the package;
``reference/NAME`` one that needs no training. A run folder of that path comes first. No JAX.
"""

from pathlib import Path

from lanewise.controllers.registry import REFERENCES
from lanewise.errors import RunError, brief
from lanewise.fields.suggestions import nearest
from lanewise.runs.folder import RunFolder

PRETRAINED = Path(__file__).parent / "pretrained"
"""Where the trained ones lie."""


def pretrained() -> tuple[str, ...]:
    """Names of the trained controllers in the package."""
    return tuple(sorted(path.parent.name for path in PRETRAINED.glob("*/run.json")))


def locate(path: Path) -> Path:
    """The run folder of ``path``, in the package where it is called ``pretrained/NAME``.

    Raises:
        RunError: there is none of that name.
    """
    if path.exists() or len(path.parts) != 2 or path.parts[0] != "pretrained":
        return path
    return PRETRAINED / _known(path, pretrained())


def reference(path: Path) -> str | None:
    """The name of the reference driver that ``path`` calls, None where it calls none.

    Raises:
        RunError: there is none of that name.
    """
    if path.exists() or len(path.parts) != 2 or path.parts[0] != "reference":
        return None
    return _known(path, REFERENCES)


def controller(path: Path) -> str:
    """Name of the controller that ``path`` leads to; looks at no weights.

    Raises:
        RunError: there is no such run.
    """
    return reference(path) or RunFolder.open(locate(path)).controller


def _known(path: Path, names: tuple[str, ...]) -> str:
    group, name = path.parts
    if name in names:
        return name
    hint = nearest(name, names) or f"known: {', '.join(names) or 'none'}"
    raise RunError(f'there is no {group} controller "{brief(name)}"; {hint}')
