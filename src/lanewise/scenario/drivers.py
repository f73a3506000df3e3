"""Who drives the vehicles of a start: the ego, the trap cars, and traffic of some populations."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from lanewise.scenario.populations import POPULATIONS, Population
from lanewise.scenario.settings import TrapSettings
from lanewise.world import build
from lanewise.world.settings import DriverSettings
from lanewise.world.state import CONSTANT, EXTERNAL, RULE_BASED, Drivers, Waves
from lanewise.world.steering import slip_sine


def of_traffic(settings: TrapSettings, key: Array, count: int, speed: ArrayLike) -> Drivers:
    """Drivers of ``count`` traffic vehicles at a traffic speed, m/s.

    Without populations all drive by the settings' driver.
    """
    traffic = settings.traffic
    same = build.make_drivers([traffic.driver] * count, [RULE_BASED] * count)
    if not traffic.populations:
        return replace(same, waves=calm(same.target_speed) if has_waves(settings) else None)
    kinds = [POPULATIONS[name] for name in traffic.populations]
    which = jax.random.randint(jax.random.fold_in(key, 0), (count,), 0, len(kinds), jnp.int32)
    names = build.NUMBERS
    shares = jax.random.uniform(jax.random.fold_in(key, 1), (len(names) + 4, count), jnp.float32)

    def drawn(ranges: list[tuple[float, float]], share: Array) -> Array:
        low, high = jnp.asarray(ranges, jnp.float32)[which].T
        found: Array = low + (high - low) * share
        return found

    numbers: dict[str, Any] = {
        name: drawn([_range(kind, name) for kind in kinds], share)
        for name, share in zip(names, shares, strict=False)
    }
    desired, wave, period, phase = shares[len(names) :]
    target = drawn([kind.desired_speed for kind in kinds], desired) * speed
    # One driver of each population, of whom each vehicle takes that of its own.
    models = build.make_drivers([kind.driver for kind in kinds], [RULE_BASED] * len(kinds))
    numbers |= {
        "target_speed": target,
        "slip_limit": slip_sine(numbers.pop("steering_limit")),
        "changes_lanes": models.changes_lanes[which],
        "linear": jax.tree.map(lambda values: values[which], models.linear),
    }
    if has_waves(settings):
        amplitude = target * drawn([kind.wave for kind in kinds], wave)
        numbers["waves"] = Waves(target, amplitude, drawn([k.period for k in kinds], period), phase)
    return replace(same, **numbers)


def of_first_three(settings: TrapSettings, key: Array, speed: Array, wave: ArrayLike) -> Drivers:
    """Drivers of the ego and both trap cars, by their speeds, m/s [3].

    The trap cars' speeds swing by ``wave``, m/s, each from a phase of its own.
    """
    by_rules = settings.ego_driver == "rule-based"
    drivers = build.make_drivers(
        [settings.traffic.driver if by_rules else DriverSettings(), *[DriverSettings()] * 2],
        [RULE_BASED if by_rules else EXTERNAL, CONSTANT, CONSTANT],
        missing_target_speed=settings.missing_target_speed,
    )
    if not settings.missing_target_speed:
        wanted = speed.at[0].set(drivers.target_speed[0]) if by_rules else speed
        drivers = replace(drivers, target_speed=wanted)
    if has_waves(settings):
        phase = jax.random.uniform(key, (3,), jnp.float32)
        period = jnp.full(3, settings.trap_wave_period, jnp.float32)
        swings = jnp.asarray([0.0, 1.0, 1.0], jnp.float32) * wave
        drivers = replace(drivers, waves=Waves(speed, swings, period, phase))
    return drivers


def has_waves(settings: TrapSettings) -> bool:
    """Whether any speed of such a start may swing."""
    return settings.trap_speed_wave > 0 or any(
        POPULATIONS[name].waves for name in settings.traffic.populations
    )


def calm(mean: Array) -> Waves:
    """Waves of speeds that do not swing."""
    return Waves(mean, jnp.zeros_like(mean), jnp.ones_like(mean), jnp.zeros_like(mean))


def _range(kind: Population, name: str) -> tuple[float, float]:
    value = float(getattr(kind.driver, name))
    return kind.ranges.get(name, (value, value))
