"""What of the decision process may be replaced by a user's functions."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from lanewise.driving import observation, reward
from lanewise.driving.settings import DrivingSettings, ObservationSettings, RewardSettings
from lanewise.errors import LanewiseError, SettingsError, brief
from lanewise.fields.ranges import show
from lanewise.scenario import trap
from lanewise.scenario.settings import TrapSettings
from lanewise.system import pinned
from lanewise.world.state import Drivers, World

LONGEST = 65_536
"""Numbers that may be observed, as many as a network's layer may be wide."""


@dataclass(frozen=True)
class TaskFunctions:
    """How an episode starts, and what is observed, rewarded and counted as success. Static.

    Each is a pure function written for one world, to be traced by JAX and batched by ``jax.vmap``:
    a function, a `functools.partial`, or an object that can be called and hashed. They are compared
    by ``==``, plain functions by identity: name them once, at a module's top, and programs compiled
    with them are found again.

    Raises:
        SettingsError: one of them cannot be called, or cannot be hashed.
    """

    start: Callable[[TrapSettings, Array, str], World] = trap.sample
    """(scenario, random key, split) to the world at the start; the number of vehicles and lanes
    must be the same for every key. Vehicle 0 is the ego; trap cars are those that keep their
    commands (``CONSTANT``), the others are traffic."""
    observe: Callable[[ObservationSettings, World], Array] = observation.features
    """(settings, world) to what the controller observes, float32 [n]."""
    reward: Callable[[RewardSettings, World, Array, Array], Array] = reward.decision_reward
    """(settings, world after a decision, steering angle in rad, bool [] whether an accident ended
    it) to the reward of the decision, []."""
    success: Callable[[World], Array] = trap.escaped
    """World after a decision to whether the episode has succeeded by now, bool []; once true it
    stays so, and an accident takes it away."""

    def __post_init__(self) -> None:
        for part in fields(self):
            function = getattr(self, part.name)
            if not callable(function):
                raise SettingsError(f"{part.name}: expected a function, got {show(function)}")
            try:
                hash(function)
            except TypeError:
                raise SettingsError(
                    f"{self.called(part.name)} cannot be hashed; give its class __hash__, or make "
                    "it @dataclass(frozen=True) with fields that can"
                ) from None

    def names(self) -> tuple[str, ...]:
        """Which are a user's own, and what they are called there: ``reward: mine.hurry``.

        Plain arguments of a `functools.partial`, and fields of a dataclass, are part of the name:
        ``reward: mine.hurry(weight=0.5)``.
        """
        return tuple(
            f"{part.name}: {_module(own)}.{_name(own)}"
            for part in fields(self)
            if (own := getattr(self, part.name)) is not part.default
        )

    @pinned.switches()
    def validate(
        self, scenario: TrapSettings, driving: DrivingSettings, split: str = "training"
    ) -> int:
        """Length of the observation; tries the user's own functions, each traced alone.

        So a mistake shows at once, under its name.

        Raises:
            SettingsError: one of them fails, or returns something else than it must.
        """
        if not self.names():
            return driving.observation.size
        key = jax.eval_shape(lambda: pinned.key(0))
        world = self._tried("start", lambda key: self.start(scenario, key, split), key)
        self._check_world(world)
        seen = self._tried("observe", partial(self.observe, driving.observation), world)
        if not (_is_array(seen, 1) and seen.dtype == jnp.float32):
            raise self._wrong("observe", "a float32 vector", _kind(seen))
        if not 1 <= seen.size <= LONGEST:
            raise self._wrong("observe", f"from 1 to {LONGEST:,} numbers", f"{seen.size:,}")
        angle = jax.eval_shape(lambda: jnp.zeros((), world.vehicles.x.dtype))
        yes = jax.eval_shape(lambda: jnp.bool_(True))
        given = self._tried("reward", partial(self.reward, driving.reward), world, angle, yes)
        real = (jnp.integer, jnp.floating)
        if not (_is_array(given, 0) and any(jnp.issubdtype(given.dtype, kind) for kind in real)):
            raise self._wrong("reward", "one real number", _kind(given))
        escaped = self._tried("success", self.success, world)
        if not (_is_array(escaped, 0) and escaped.dtype == jnp.bool_):
            raise self._wrong("success", "one bool", _kind(escaped))
        self._check_trap(scenario, split)
        return int(seen.size)

    def _check_world(self, world: Any) -> None:
        """Refuses a start that is not as many numbers of their types as there are vehicles."""
        if not isinstance(world, World):
            raise self._wrong("start", "a World", _kind(world))
        sample = partial(trap.sample, TrapSettings(), split="test")
        model: Any = jax.eval_shape(sample, jax.random.key(0))
        # Nobody need drive by the linear model, and no speed need swing.
        if isinstance(world.drivers, Drivers):
            world = replace(world, drivers=replace(world.drivers, linear=None, waves=None))
        if str(jax.tree.structure(world)) != str(jax.tree.structure(model)):
            raise self._wrong("start", "a World of arrays", "of anything else")
        found = jax.tree_util.tree_leaves_with_path(world)
        for (path, array), wanted in zip(found, jax.tree.leaves(model), strict=True):
            name = jax.tree_util.keystr(path, simple=True, separator=".")
            size = (world.road.centre if name.startswith("road") else world.vehicles.x).size
            if array.shape != (size,) or array.dtype != wanted.dtype:
                what = f"{name} as {wanted.dtype} of shape ({size},)"
                raise self._wrong("start", what, _kind(array))

    def _check_trap(self, scenario: TrapSettings, split: str) -> None:
        """Refuses the paper's success in a world without trap cars."""
        if self.start is PAPER_TASK.start or self.success is not PAPER_TASK.success:
            return
        with named(self.called("start")):
            cars = _trap_cars(self.start, scenario, split, jax.random.key(0))
        if not cars.any():
            raise SettingsError(
                f"{self.called('start')} places no trap car (a CONSTANT driver), and the paper's "
                "success is to get past them; give success= too"
            )

    def _tried(self, part: str, call: Callable[..., Any], *given: Any) -> Any:
        """What a function returns for one world, as shapes; traced for two, as it will be."""
        two = jax.tree.map(lambda leaf: leaf.update(shape=(2, *leaf.shape)), given)
        with named(self.called(part)):
            found = jax.eval_shape(jax.vmap(call), *two)
        return jax.tree.map(lambda leaf: leaf.update(shape=leaf.shape[1:]), found)

    def _wrong(self, part: str, wanted: str, found: str) -> SettingsError:
        return SettingsError(f"{self.called(part)} must return {wanted}, not {found}")

    def called(self, part: str) -> str:
        """A part and the function in its place, for messages."""
        return f"{part}: {_name(getattr(self, part))}"


@contextmanager
def named(functions: str) -> Iterator[None]:
    """Failures of a user's functions as a `SettingsError` that names them."""
    try:
        yield
    except LanewiseError:
        raise
    except Exception as error:
        reason = str(error).strip().partition("\n")[0][:200]
        if isinstance(error, jax.errors.ConcretizationTypeError):
            reason = "it asks for a value while JAX traces it; use jnp.where instead of if"
        raise SettingsError(f"{functions} fails: {reason}") from error


def _name(function: Any) -> str:
    """What a function is called in its module, with the arguments it brings along."""
    if isinstance(function, partial):
        given = [*map(_plain, function.args)]
        given += [f"{name}={_plain(value)}" for name, value in sorted(function.keywords.items())]
        return f"{_name(function.func)}({', '.join(given)})"
    if hasattr(function, "__qualname__"):
        return str(function.__qualname__)
    own = type(function).__qualname__
    if not is_dataclass(function):
        return own
    values = (f"{each.name}={_plain(getattr(function, each.name))}" for each in fields(function))
    return f"{own}({', '.join(values)})"


def _module(function: Any) -> str:
    while isinstance(function, partial):
        function = function.func
    name = str(getattr(function, "__module__", None) or type(function).__module__)
    if name not in ("__main__", "__mp_main__"):
        return name
    # A script's functions are called as they are where another script imports them.
    main = sys.modules["__main__"]
    spec, file = getattr(main, "__spec__", None), getattr(main, "__file__", None)
    return str(spec.name) if spec else Path(file).stem if file else "__main__"


def _plain(value: Any) -> str:
    if type(value) in (int, float, bool, str, type(None)):
        return brief(repr(value))
    return type(value).__name__


@partial(jax.jit, static_argnums=(0, 1, 2))
def _trap_cars(start: Any, scenario: TrapSettings, split: str, key: Array) -> Array:
    """Which vehicles of a start are trap cars, bool [N]."""
    return trap.trap_cars(start(scenario, key, split))


def _is_array(value: Any, dimensions: int) -> bool:
    return isinstance(value, jax.ShapeDtypeStruct) and value.ndim == dimensions


def _kind(value: Any) -> str:
    """A value for people: its type, for an array its numbers and shape."""
    if isinstance(value, jax.ShapeDtypeStruct):
        return f"{value.dtype} of shape {tuple(value.shape)}"
    return f"a {type(value).__name__}"


PAPER_TASK = TaskFunctions()
"""The paper's."""


def checked(task: Any) -> TaskFunctions:
    """Parts that a user gave; a `SettingsError` if they are something else."""
    if not isinstance(task, TaskFunctions):
        raise SettingsError(f"task: expected lanewise.TaskFunctions(...), got {str(task)[:80]}")
    return task
