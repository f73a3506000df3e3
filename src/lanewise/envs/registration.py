"""Makes the environments known to Gymnasium, whichever of the two is imported first."""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

ENVIRONMENTS = {
    "lanewise/Trap-v0": ("single:TrapEnv", "vector:TrapVectorEnv"),
    "lanewise/TrapGoal-v0": ("single:TrapGoalEnv", "vector:TrapGoalVectorEnv"),
    "lanewise/TrapContinuous-v0": ("single:TrapContinuousEnv", "vector:TrapContinuousVectorEnv"),
    "lanewise/TrapHighwayEnv-v0": ("trap_highway_env:TrapHighwayEnv", None),
}
"""By id, where in this package one environment and many of them are made."""


def register() -> None:
    """Register the environments; called once more, it does nothing."""
    from gymnasium.envs.registration import register as add
    from gymnasium.envs.registration import registry

    for name, (one, many) in ENVIRONMENTS.items():
        if name not in registry:
            package = "lanewise.envs."
            add(name, entry_point=package + one, vector_entry_point=many and package + many)


def with_gymnasium() -> None:
    """Register now if Gymnasium is imported already, and whenever it is imported from now on.

    Gymnasium itself is not imported: it would double the time that ``lanewise --help`` takes. Its
    plugins, which it loaded by itself, are gone since 1.0.
    """
    sys.meta_path.insert(0, _Watch())
    if "gymnasium" in sys.modules:
        register()


class _Watch(MetaPathFinder):
    """Registers whenever Gymnasium has been executed; finding it is left to the finders behind.

    It remembers nothing and stays: Gymnasium may be looked for without being imported, fail to be
    imported, or be imported anew.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "gymnasium":
            return None
        behind = sys.meta_path[sys.meta_path.index(self) + 1 :]
        found = (finder.find_spec(fullname, path, target) for finder in behind)
        spec = next((spec for spec in found if spec is not None), None)
        if spec is None or spec.loader is None:
            return spec
        execute = spec.loader.exec_module

        def execute_and_register(module: ModuleType) -> None:
            execute(module)
            register()

        spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec
