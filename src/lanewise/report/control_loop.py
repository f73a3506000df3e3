"""Who tells whom what: the two levels, the critic and the road, as one row of boxes and arrows."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isclose, pi

from lanewise.config.settings import Settings
from lanewise.controllers import goals
from lanewise.controllers.settings import GoalSettings
from lanewise.driving import actions, observation
from lanewise.extras import needed_for
from lanewise.report import diagram
from lanewise.report.diagram import Box, Kind
from lanewise.report.dimensions import number
from lanewise.report.style import MINUS, TIMES

with needed_for("a schematic"):
    from matplotlib.axes import Axes

HEIGHT = 2.85
"""Of a row, inches."""
BUS, BOXES, REWARD = 0.22, 1.33, 2.58
"""Heights of the observation's line, of the boxes' feet and of the reward's line, inches."""


@dataclass(frozen=True)
class Part:
    """A box: what it does and what it says."""

    kind: Kind
    title: str
    lines: Sequence[str]
    rewarded: bool = False
    """Whether the reward teaches it."""


def draw(axes: Axes, base: float, high: Part, low: Part, settings: Settings, loop: "Loop") -> None:
    """A row of boxes whose foot is at `base` inches."""
    above = Box(0.45, base + BOXES, 1.75, 0.95)
    below = Box(3.02, base + BOXES, 2.06, 0.95)
    world = Box(5.76, base + BOXES, 1.34, 0.95)
    critic = Box(1.72, base + 0.47, 2.0, 0.56)
    for place, part in ((above, high), (below, low)):
        diagram.box(axes, place, part.kind, part.title, part.lines)
    diagram.box(axes, world, Kind.WORLD, "road", ("ego: bicycle model", *_others(settings)))
    diagram.box(axes, critic, Kind.RULES, "goal critic", loop.critic)
    _goal(axes, above, below, critic)
    frequency = f"{settings.driving.decision_frequency} Hz"
    diagram.arrow(axes, ((below.right, below.middle), (world.left, world.middle)))
    middle = (below.right + world.left) / 2.0
    diagram.words(axes, (middle, below.middle + 0.05), f"action\nat {frequency}")
    _observation(axes, base, (above, critic, below), world)
    learners = [place for place, part in ((above, high), (below, low)) if part.rewarded]
    _reward(axes, base, learners, world, loop.reward)


@dataclass(frozen=True)
class Loop:
    """What a row says beside its boxes."""

    critic: Sequence[str]
    """Lines of the goal critic."""
    reward: str
    """Label of the reward."""


def _goal(axes: Axes, above: Box, below: Box, critic: Box) -> None:
    """The goal from the high level to the low one and to the critic, and the critic's answer."""
    height = above.middle + 0.1
    diagram.arrow(axes, ((above.right, height), (below.left, height)))
    middle = (above.right + below.left) / 2.0
    diagram.words(axes, (middle, height + 0.05), "goal: lane\nand speed")
    diagram.arrow(axes, ((middle, height), (middle, critic.top)))
    corner = critic.left - 0.3
    diagram.arrow(
        axes, ((critic.left, critic.middle), (corner, critic.middle), (corner, above.bottom))
    )
    diagram.words(axes, (corner - 0.06, critic.middle + 0.02), "new\ngoal due", "right")


def _observation(axes: Axes, base: float, readers: Sequence[Box], world: Box) -> None:
    line = base + BUS
    first, critic, last = readers
    start = (world.centre, world.bottom)
    diagram.arrow(
        axes,
        (start, (world.centre, line), (first.left + 0.2, line), (first.left + 0.2, first.bottom)),
    )
    for x, top in ((critic.centre, critic.bottom), (last.centre + 0.45, last.bottom)):
        diagram.arrow(axes, ((x, line), (x, top)))
    seen = f"the ego and {observation.NEIGHBOURS} vehicles"
    label = f"observation: {observation.SIZE} features of\n{seen}"
    diagram.words(axes, (world.centre - 0.08, line + 0.05), label, "right")


def _reward(axes: Axes, base: float, learners: Sequence[Box], world: Box, label: str) -> None:
    line = base + REWARD
    for place in learners:
        diagram.arrow(
            axes,
            (
                (world.centre, world.top),
                (world.centre, line),
                (place.centre, line),
                (place.centre, place.top),
            ),
            dashed=True,
        )
    if learners:
        left = min(place.centre for place in learners)
        diagram.words(axes, ((left + world.centre) / 2.0, line + 0.05), label)


def high_level(settings: Settings) -> list[str]:
    """What the high level is made of and chooses from."""
    choices = goals.ACTION_SETS[settings.goals.action_set]
    lanes, speeds = (sorted({choice[axis] for choice in choices}) for axis in (0, 1))
    both = TIMES if len(choices) == len(lanes) * len(speeds) else "or"
    delta = settings.goals.speed_step
    return [
        _layers(observation.SIZE, settings.high_level.learner.hidden, len(choices)),
        f"lane {_steps(lanes)}",
        f"{both} speed {_steps([delta * step for step in speeds])} m/s",
    ]


def low_level(settings: Settings) -> list[str]:
    """What the low level is made of and chooses from."""
    inputs = observation.SIZE + goals.FEATURES
    return [
        _layers(inputs, settings.low_level.learner.hidden, actions.COUNT),
        *low_level_actions(settings),
    ]


def low_level_actions(settings: Settings) -> list[str]:
    """The low-level actions, on two lines."""
    chosen = settings.driving.actions
    angle = f"{chosen.steering:g}"
    if isclose(pi / chosen.steering, round(pi / chosen.steering), rel_tol=1e-9):
        angle = f"π/{round(pi / chosen.steering)}"
    push = chosen.acceleration
    return [
        f"acceleration {_steps([-push, 0.0, push])} m/s²",
        f"{TIMES} steering {MINUS}{angle}, 0, +{angle} rad",
    ]


def critic(settings: GoalSettings, renewal: str) -> list[str]:
    """When a goal ends, and when the next one is set."""
    limits = number(settings.lateral_tolerance), number(settings.speed_tolerance)
    otherwise = {
        "critic": f"after {number(settings.time_limit)} s",
        "timestep": "after 1 s",
        "decision": "at the next decision",
    }
    return [
        f"$|\\Delta d|$ < {limits[0]} m, $|\\Delta v|$ < {limits[1]} m/s",
        f"otherwise {otherwise[renewal]}",
    ]


def _layers(inputs: int, hidden: Sequence[int], outputs: int) -> str:
    return " → ".join(map(str, (inputs, *hidden, outputs)))


def _steps(values: Sequence[float]) -> str:
    return ", ".join("0" if not v else f"{'+' if v > 0 else ''}{number(v)}" for v in values)


def _others(settings: Settings) -> list[str]:
    traffic = settings.scenario.traffic
    lines = ["trap: 2 slow cars"]
    if traffic.vehicles_ahead + traffic.vehicles_behind:
        lines.append("traffic: IDM, MOBIL")
    return lines
