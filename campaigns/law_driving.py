"""Laws of the decision process: what the ego sees, is paid and counts as success."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from law_symmetries import mirrored, shifted
from law_worlds import Found, Law, lane_distances, taken, vehicles_with

from lanewise.driving import accidents, observation, reward
from lanewise.driving.settings import DrivingSettings, ObservationSettings, RewardSettings
from lanewise.world.state import World

SCALINGS = {"fine": 2.0, "highway-env": 1.0}
"""Scalings of the observation, and what each is clipped to."""
EGO_X, EGO_Y = 1, 2
"""Places of the ego's own, absolute position among the features."""
ACROSS = np.array([2, 4, 5, *(8, 10), *(13, 15), *(18, 20), *(23, 25)])
"""Features across the road: y and vy of the ego, the lane offset, y and vy of the others."""
DRIVING, REWARD = DrivingSettings(), RewardSettings()
ROUNDING = 1e-12


@jax.jit
def _seen(worlds, steering):
    def one(world, steering):
        code = accidents.of_ego(world, DRIVING.stopped_speed)
        views = [
            observation.features(ObservationSettings(scaling=name), world) for name in SCALINGS
        ]
        pay = reward.of_decision(REWARD, world, steering, code != accidents.NONE)
        return views, pay, code

    return jax.vmap(one)(worlds, steering)


def seen(worlds, steering):
    """What the ego sees by each scaling, [W, 26] each, its reward and its accident, [W]."""
    with jax.enable_x64(True):
        return jax.tree.map(np.array, _seen(worlds, jnp.asarray(steering)))


def _egos(worlds, rng):
    """Worlds whose ego is not exactly between two lanes, and a steering for each."""
    present = worlds.vehicles.present.copy()
    present[:, 0] = True
    nearest = np.sort(lane_distances(worlds), axis=-1)
    tied = nearest[..., 0] == nearest[..., 1]
    y = np.where(tied, worlds.vehicles.y + 1e-3, worlds.vehicles.y)
    steering = rng.choice([-1.0, 0.0, 1.0], present.shape[0]) * DRIVING.actions.steering
    return vehicles_with(worlds, present=present, y=y), steering


def bounds(worlds, rng):
    """What is seen and paid lies within its bounds.

    |feature| <= 2 in the fine scaling and 1 in highway-env's, presence 0 or 1, nothing of who is
    not there; the reward is the penalty after an accident and else, by eq. (3) to (6), between
    -w_theta |sin theta| / (w_v + w_theta + w_y) and 1.
    """
    worlds, steering = _egos(worlds, rng)
    views, pay, code = seen(worlds, steering)
    found, every = Found(len(pay)), np.ones((len(pay), 1), bool)
    for view, limit in zip(views, SCALINGS.values(), strict=True):
        found.require("limit", np.abs(view) <= limit, np.ones_like(view, bool))
        others = view[:, 6:].reshape(len(pay), 4, 5)
        found.require("presence", np.isin(others[..., 0], (0, 1)), every.repeat(4, 1))
        empty = (others == 0).all(axis=-1)
        found.require("absent", empty, others[..., 0] == 0)
    weights = REWARD.speed_weight + REWARD.steering_weight + REWARD.centring_weight
    least = -REWARD.steering_weight * np.abs(np.sin(steering)) / weights
    driving = (code == accidents.NONE)[:, None]
    inside = (pay >= least - ROUNDING) & (pay <= 1 + ROUNDING)
    found.require("reward", inside[:, None], driving)
    found.require("penalty", (pay == -REWARD.accident_penalty)[:, None], ~driving)
    return found


def shift(worlds, rng):
    """Further along the road the ego sees, is paid and suffers the same, to the bit.

    But for its own x, which is absolute and soon at its limit (`absolute-ego-place`).
    """
    worlds, steering = _egos(worlds, rng)
    along = rng.uniform(-1e4, 1e4, len(steering)).astype(np.float32).astype(float)
    rounded = shifted(shifted(worlds, along), -along)
    return _compare(rounded, shifted(rounded, along), steering, steering, [EGO_X], [])


def mirror(worlds, rng):
    """Mirrored, the ego sees the mirrored road, and is paid the same, to the bit.

    With y counted from the middle of the road; highway-env counts the ego's from the leftmost lane
    (`absolute-ego-place`). An ego between two lanes is moved by 1 mm (`ties-between-lanes`).
    """
    worlds, steering = _egos(worlds, rng)
    return _compare(worlds, mirrored(worlds), steering, -steering, [], ACROSS)


def reorder(worlds, rng):
    """The order of the others does not matter, to the bit.

    Others at equal distance are moved apart by millimetres (`ties-between-neighbours`).
    """
    worlds, steering = _egos(worlds, rng)
    count, size = worlds.vehicles.x.shape
    nudge = 1e-3 * rng.permuted(np.tile(np.arange(size), (count, 1)), axis=1) * (1 + 1e-3)
    worlds = vehicles_with(worlds, x=worlds.vehicles.x + np.where(np.arange(size) > 0, nudge, 0))
    order = rng.permuted(np.tile(np.arange(1, size), (count, 1)), axis=1)
    order = np.concatenate([np.zeros((count, 1), int), order], axis=1)
    other = World(worlds.road, taken(worlds.drivers, order), taken(worlds.vehicles, order))
    return _compare(worlds, other, steering, steering, [], [])


def far(worlds, rng):
    """Who is not seen does not matter, to the bit: beyond 200 m, or 10 m and more behind."""
    worlds, steering = _egos(worlds, rng)
    x = worlds.vehicles.x
    hidden = rng.random(x.shape) < 0.5
    hidden[:, 0] = False
    away = rng.choice([1.0, -1.0], x.shape) * 10 ** rng.uniform(2.4, 5, x.shape)
    worlds = vehicles_with(worlds, x=np.where(hidden, x[:, :1] + away, x))
    gone = replace(worlds.vehicles, present=worlds.vehicles.present & ~hidden)
    other = World(worlds.road, worlds.drivers, gone)
    return _compare(worlds, other, steering, steering, [], [])


def _compare(worlds, other, steering, turned, but, negated):
    """Hold what is seen in two worlds against one another, to the bit."""
    (views, pay, code), (others, theirs, accident) = seen(worlds, steering), seen(other, turned)
    found, every = Found(len(pay)), np.ones((len(pay), 1), bool)
    for mine, its in zip(views, others, strict=True):
        its[:, negated] = -its[:, negated]
        compared = np.ones_like(mine, bool)
        compared[:, but] = False
        found.expect("features", mine - its, 0.0, compared)
    found.expect("reward", (pay - theirs)[:, None], 0.0, every)
    found.require("accident", (code == accident)[:, None], every)
    return found


LAWS = (
    Law("bounds-of-driving", "What is seen and paid lies within its bounds",
        "|feature| <= 2 (highway-env's scaling: 1); reward in [-0.002, 1] or -10", bounds),
    Law("shift-of-driving", "Shifted along the road, the ego sees and is paid the same",
        "equal to the bit, but for its own x", shift),
    Law("mirror-of-driving", "Mirrored, the ego sees the mirrored and is paid the same",
        "equal to the bit", mirror),
    Law("reorder-of-driving", "The order of the others does not matter to the ego",
        "equal to the bit", reorder),
    Law("unseen-of-driving", "Who is not seen does not matter", "equal to the bit", far),
)  # fmt: skip
