"""Bridges to other simulators; the only room that imports highway-env."""

from contextlib import AbstractContextManager
from types import ModuleType

from lanewise.extras import install, needed_for


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


def _needed() -> AbstractContextManager[None]:
    return needed_for("driving in highway-env", install("highway"))
