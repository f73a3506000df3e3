"""Bridges to other simulators; the only room that imports highway-env."""

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from lanewise.errors import LanewiseError


def twin() -> ModuleType:
    """The module that drives our controllers in highway-env, imported only where it is wanted.

    Raises:
        LanewiseError: highway-env is not installed.
    """
    with _needed():
        from lanewise.interop import drive
    return drive


def twin_of_policies() -> ModuleType:
    """The module that drives anyone's policy in highway-env.

    Raises:
        LanewiseError: highway-env is not installed.
    """
    with _needed():
        from lanewise.interop import outside
    return outside


@contextmanager
def _needed() -> Iterator[None]:
    try:
        yield
    except ImportError as error:
        raise LanewiseError(
            'driving in highway-env needs its package: pip install "lanewise[highway]"'
        ) from error
