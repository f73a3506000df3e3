"""The packages that only some features need; without them everything else works."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from lanewise.errors import LanewiseError


def install(*extras: str) -> str:
    """The command that brings some extras, or with none Lanewise itself, as the README has it.

    From the clone: what a package registry has under our name may be somebody else's.
    """
    what = f'".[{",".join(extras)}]"' if extras else "--force-reinstall ."
    return f"pip install {what} in your clone"


@contextmanager
def needed_for(purpose: str, remedy: str = install("report")) -> Iterator[None]:
    """Around imports: turn a missing package into one line that says what to install."""
    try:
        yield
    except ImportError as error:
        raise LanewiseError(f"{purpose} needs {error.name or error}: {remedy}") from error


def check() -> None:
    """Fail now rather than after minutes of training."""
    for module in ("matplotlib", "PIL", "imageio_ffmpeg"):
        if find_spec(module) is None:
            raise LanewiseError(f"reports need {module}: {install('report')}")
