"""How vehicles move: a bicycle model, as ``highway_env.vehicle.kinematics.Vehicle.step``."""

from dataclasses import replace

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from lanewise.world.materialize import rounded
from lanewise.world.motion import HeadingTrig
from lanewise.world.settings import TOP_SPEED
from lanewise.world.state import World
from lanewise.world.steering import slip_sine


def command(world: World, acceleration: ArrayLike, steering: ArrayLike, vehicle: int = 0) -> World:
    """Give an external vehicle, static, its commands, to be kept until the next.

    The acceleration in m/s^2, and the angle of the front wheels in rad, positive to the right.
    """
    vehicles = world.vehicles
    dtype = vehicles.x.dtype
    chosen = jnp.arange(vehicles.x.shape[0]) == vehicle
    slip = slip_sine(jnp.asarray(steering, dtype))
    return replace(
        world,
        vehicles=replace(
            vehicles,
            acceleration=jnp.where(chosen, jnp.asarray(acceleration, dtype), vehicles.acceleration),
            slip_sine=jnp.where(chosen, slip, vehicles.slip_sine),
        ),
    )


def _limited(world: World) -> tuple[Array, Array]:
    """Commands as carried out: crashed vehicles brake with -v, and nobody passes the top speed.

    They stay stored in this form (`clipped-command-persists`).
    """
    vehicles = world.vehicles
    speed = vehicles.speed
    slip = jnp.where(vehicles.crashed, 0, vehicles.slip_sine)
    acceleration = jnp.where(vehicles.crashed, -speed, vehicles.acceleration)
    slowest = jnp.minimum(acceleration, TOP_SPEED - speed)
    fastest = jnp.maximum(acceleration, -TOP_SPEED - speed)
    acceleration = jnp.where(speed > TOP_SPEED, slowest, acceleration)
    acceleration = jnp.where(speed < -TOP_SPEED, fastest, acceleration)
    return slip, acceleration


def move(world: World, trig: HeadingTrig, duration: ArrayLike) -> World:
    """Move every present vehicle for one tick, which spends its impact.

    Position moves with the old speed along heading + slip, then by the displacement of a
    predicted hit, which makes the vehicle crash; then heading += v sin(slip) / (L / 2) dt, then
    speed += a dt. ``trig`` is from before the move.
    """
    vehicles, present = world.vehicles, world.vehicles.present
    slip, acceleration = _limited(world)
    slip_cosine = jnp.sqrt(1 - slip * slip)
    cosine, sine = trig
    x = vehicles.x + vehicles.speed * (cosine * slip_cosine - sine * slip) * duration
    y = vehicles.y + vehicles.speed * (sine * slip_cosine + cosine * slip) * duration
    x = jnp.where(vehicles.impacted, x + vehicles.impact_x, x)
    y = jnp.where(vehicles.impacted, y + vehicles.impact_y, y)
    heading = vehicles.heading + vehicles.speed * slip / (world.drivers.length / 2) * duration
    speed = vehicles.speed + rounded(present, lambda: acceleration * duration)

    def moved(new: Array, old: Array) -> Array:
        return jnp.where(present, new, old)

    return replace(
        world,
        vehicles=replace(
            vehicles,
            x=moved(x, vehicles.x),
            y=moved(y, vehicles.y),
            heading=moved(heading, vehicles.heading),
            speed=moved(speed, vehicles.speed),
            slip_sine=moved(slip, vehicles.slip_sine),
            acceleration=moved(acceleration, vehicles.acceleration),
            crashed=vehicles.crashed | (present & vehicles.impacted),
            impacted=jnp.zeros_like(vehicles.impacted),
            impact_x=jnp.zeros_like(vehicles.impact_x),
            impact_y=jnp.zeros_like(vehicles.impact_y),
        ),
    )
