"""Lanewise: teaching a car to get out of slow traffic with hierarchical reinforcement learning."""

from typing import TYPE_CHECKING, Any

from lanewise.envs import registration
from lanewise.system import process
from lanewise.system.version import __version__

if TYPE_CHECKING:
    from lanewise.api import Evaluation, TaskFunctions, evaluate, train

__all__ = ["Evaluation", "TaskFunctions", "__version__", "evaluate", "train"]

process.watch_forks()
registration.with_gymnasium()


def __dir__() -> list[str]:
    """What is there for people, whether imported yet or not."""
    return __all__


def __getattr__(name: str) -> Any:
    """The public names of `lanewise.api`, imported when first used: JAX takes half a second."""
    if name in __all__:
        from lanewise import api

        return getattr(api, name)
    raise AttributeError(f"module 'lanewise' has no attribute {name!r}")
