"""The packages only figures and clips need; without them everything else works."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from lanewise.errors import LanewiseError

_HINT = 'pip install "lanewise[report]"'


@contextmanager
def needed_for(purpose: str) -> Iterator[None]:
    """Around imports: turn a missing package into one line that says what to install.

    Raises:
        LanewiseError: if an import inside fails.
    """
    try:
        yield
    except ImportError as error:
        raise LanewiseError(f"{purpose} needs {error.name or error}: {_HINT}") from error


def check() -> None:
    """Fail now rather than after minutes of training.

    Raises:
        LanewiseError: if a package of the `report` extra is missing.
    """
    for module in ("matplotlib", "PIL", "imageio_ffmpeg"):
        if find_spec(module) is None:
            raise LanewiseError(f"reports need {module}: {_HINT}")
