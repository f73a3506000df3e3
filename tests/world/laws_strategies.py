"""Small worlds that Hypothesis makes, and makes smaller where a law breaks."""

import numpy as np
from hypothesis import strategies as st
from law_worlds import LANES_MAX, fit, random_drivers, random_road, random_vehicles, stack

from lanewise.world.state import World

SIZE, BATCH = 5, 16
"""Vehicles in a world and worlds in a batch: one shape, so that one compilation serves all."""

speeds = st.sampled_from([0.0, 0.5, 1.0, 10.0, 12.5, 41.0, -3.0]) | st.floats(-5, 42)
asides = st.sampled_from([0.0, 0.0, 2.0, -2.0, 3.0]) | st.floats(-3.5, 3.5)
headings = st.just(0.0) | st.floats(-0.5, 0.5) | st.sampled_from([3.0, -7.0])
rows = st.tuples(
    st.integers(0, LANES_MAX - 1),
    st.integers(0, 12).map(lambda step: 5.0 * step) | st.floats(-20, 220),
    asides,
    headings,
    speeds,
    st.integers(0, LANES_MAX - 1),
    st.sampled_from([0.0, 0.5, 1.0, 1.5]),
    st.booleans(),
)


@st.composite
def worlds(draw):
    """A batch of one world, over and over; its drivers and road come from a seed."""
    rng = np.random.default_rng(draw(st.integers(0, 200)))
    vehicles = draw(st.lists(rows, min_size=1, max_size=SIZE))
    count, road = len(vehicles), random_road(rng)
    lane, x, aside, heading, speed, target, timer, crashed = map(np.array, zip(*vehicles))  # noqa: B905
    lanes = int(road.present.sum())
    made = random_vehicles(rng, road, count)
    for name, value in {
        "x": x,
        "y": road.centre[lane % lanes] + aside,
        "heading": heading,
        "speed": speed,
        "target_lane": (target % lanes).astype(np.int32),
        "timer": timer,
        "crashed": crashed & (rng.random(count) < 0.3),
    }.items():
        object.__setattr__(made, name, value)
    return stack([fit(World(road, random_drivers(rng, count), made), SIZE)] * BATCH)
