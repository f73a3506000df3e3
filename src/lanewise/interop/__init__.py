"""Bridges to other simulators; the only room that imports highway-env."""

from types import ModuleType

from lanewise.system.extras import install, needed_for


def evaluation_in_highway_env() -> ModuleType:
    """`highway_env_evaluation`, imported only where it is wanted.

    Raises:
        LanewiseError: highway-env is not installed.
    """
    with needed_for("driving in highway-env", install("highway")):
        from lanewise.interop import highway_env_evaluation
    return highway_env_evaluation
