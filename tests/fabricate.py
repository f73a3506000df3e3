"""Made-up results: an episode past two trap cars, curves, outcomes, a sweep."""

import random

import numpy as np

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.driving import accident_kinds as kinds
from lanewise.evaluation.cells import KINDS, Cell, CellOutcome, Reach, cells_of
from lanewise.evaluation.conditions import HORIZONS, Condition, ConditionGrid
from lanewise.evaluation.episodes import Episodes, Recording
from lanewise.evaluation.grid import Grid, Point
from lanewise.evaluation.metrics import summarise
from lanewise.report.experiment_tables import ArmFigures
from lanewise.report.sweep_result import SweepResult

KIND_OF = np.array([kinds.NONE, kinds.CAR_AHEAD, kinds.OFF_ROAD, kinds.STOPPED], np.int8)
"""A kind for each accident."""


def make_recording(accident: int = 0, goals: bool = True, seconds: float = 25.0) -> Recording:
    time = np.arange(0.0, seconds + 0.25, 0.5)
    frames = len(time)
    speed = np.interp(time, [0, 4, 10, 17, 25], [10.0, 8.0, 9.0, 15.0, 15.0])
    x = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 4.0)])
    y = np.interp(time, [0, 4, 8, 10, 14, 25], [0.0, 0.0, 4.0, 4.0, 8.0, 8.0])
    slope = np.gradient(y, x) if frames > 1 else np.zeros(1)
    traffic_x = np.array([60.0, 85.0, 110.0, 135.0, 160.0])
    traffic_y = np.array([0.0, 8.0, 4.0, 8.0, 4.0])
    xs = np.column_stack(
        [x, 15.62 + 10.0 * time, 6.61 + 10.0 * time, traffic_x + 12.5 * time[:, None]]
    )
    ys = np.column_stack([y, 0.0 * time, 4.0 + 0.0 * time, traffic_y + 0.0 * time[:, None]])
    n = xs.shape[1]
    speeds = np.column_stack([speed, np.full((frames, 2), 10.0), np.full((frames, 5), 12.5)])
    crashed = np.zeros((frames, n), bool)
    if accident:
        crashed[-1, [0, 2]] = True
    reward = np.interp(speed, [5.0, 12.5, 15.0], [0.0, 0.2, 1.0])
    lanes = np.where(time < 3, 0, np.where(time < 9, 1, 2))
    return Recording(
        controller="hierarchical",
        time=time,
        x=xs,
        y=ys,
        heading=np.column_stack([np.arctan(slope), np.zeros((frames, n - 1))]),
        speed=speeds,
        crashed=crashed,
        present=np.ones(n, bool),
        role=np.array([0, 1, 1] + [2] * 5, np.int8),
        length=np.full(n, 5.0),
        width=np.full(n, 2.0),
        lane_centre=np.array([0.0, 4.0, 8.0]),
        lane_width=np.full(3, 4.0),
        goal_lane=lanes if goals else np.full(frames, -1),
        goal_speed=np.where(time < 9, 8.0, 15.0) if goals else np.full(frames, np.nan),
        # The first goal is given up at 2.5 s, the second reached at 8.5 s, if it comes to that.
        goals_ended=((time >= 3).astype(int) + (time >= 9)) * int(goals),
        goals_timed_out=(time >= 3).astype(int) * int(goals),
        reward=np.where(np.arange(frames) == 0, 0.0, reward),
        accumulated_reward=np.cumsum(np.where(np.arange(frames) % 2 == 0, reward, 0.0)),
        escaped=xs[:, 0] - 5.0 > xs[:, 1],
        accident=accident,
        accident_kind=int(KIND_OF[accident]),
    )


def make_rows() -> list[dict]:
    """Metrics of the chunks of three stages."""
    rng = np.random.default_rng(0)
    rows = []
    for stage, final in (("single-level", 0.02), ("high-level", 0.97), ("hierarchical", 0.94)):
        for i in range(1, 101):
            done = final / (1.0 + np.exp(-(i - 45) / 8))
            rows.append(
                {
                    "stage": stage,
                    "decisions": 1000 * i,
                    "escape_rate": float(np.clip(done + 0.02 * (i % 5), 0, 1)),
                    "success_rate": float(np.clip(done + 0.1 * rng.normal(), 0, 1)),
                    "reward": None if i < 3 else float(20 + 30 * done + 3 * rng.normal()),
                    "speed": float(10 + 3 * done + 0.3 * rng.normal()),
                    "epsilon": max(0.5 - 0.48 * i / 32, 0.02),
                }
            )
    return rows


def make_training(lengths: tuple[int, ...] = (80, 60)) -> list[list[dict]]:
    """Finished training episodes of several seeds."""
    seeds = []
    for seed, length in enumerate(lengths):
        rng, number = np.random.default_rng(seed), np.arange(length)
        success = rng.random(length) < 0.9 / (1.0 + np.exp(-(number - 25) / 6))
        columns = {
            # In every fourth episode past the trap there is an accident later.
            "escaped": success | (number % 4 == 3),
            "success": success,
            "reward": 20 + 30 * success + rng.normal(size=length),
            "timestep_reward": 10 + 15 * success + rng.normal(size=length),
            "speed": 10 + 3 * success + 0.2 * rng.normal(size=length),
        }
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        seeds.append([dict(zip(columns, row, strict=True)) for row in rows])
    return seeds


def make_episodes(
    successes: int = 293, total: int = 300, seed: int = 1, faster: float = 0.0
) -> Episodes:
    rng = np.random.default_rng(seed)
    success = np.arange(total) < successes
    accident = np.where(success, 0, 1 + np.arange(total) % 3).astype(np.int8)
    return Episodes(
        success=success,
        accident=accident,
        accident_kind=KIND_OF[accident],
        accumulated_reward=13.0 + faster + rng.normal(size=total),
        average_speed=13.0 + faster + 0.2 * rng.normal(size=total),
        travel_distance=325.0 + 25.0 * faster + 5.0 * rng.normal(size=total),
        duration=np.where(success, 25.0, 10.0),
        escape_time=np.where(success, 15.0 + rng.normal(size=total), np.nan),
        goals=np.full(total, 10, np.int64),
        goals_timed_out=(np.arange(total) % 4 == 0).astype(np.int64),
    )


def make_arm(title: str, controller: str, successes: list[int], **more) -> ArmFigures:
    """An arm whose seeds succeed in so many of 100 episodes."""
    episodes = [make_episodes(count, 100) for count in successes]
    tests = [summarise(each, controller=controller, world="lanewise") for each in episodes]
    alike = {"unlike_paper": "", "unlike_papers_training": ""}
    seeds = range(len(successes))
    return ArmFigures(title, controller, seeds, {"lanewise": tests}, **alike | more)


OURS = make_arm("two levels", "hierarchical", [98, 99, 100, 100, 90])
FLAT = make_arm("flat | one", "single-level", [0, 0, 1, 0, 0])


def make_sweep(grid: Grid | None = None, episodes: int = 20) -> SweepResult[Point]:
    """A controller that is good near the paper's start, on a grid where fast starts cannot be won.

    At 13 m/s behind 8 m/s nothing can be won; at 13 behind 9 only with D1 beyond 15 m.
    """
    grid = grid or Grid()
    draw = random.Random(0)
    cells = []
    for point in grid.places():
        faster = point.ego_speed - point.trap_speed
        winnable = faster < 4 or (faster == 4 and point.front_distance > 15.0)
        reach = Reach(winnable, True, winnable and faster < 4, "4" * 50 if winnable else "", 0)
        chance = max(0.0, 1.0 - 0.15 * abs(faster)) if winnable else 0.0
        won = sum(draw.random() < chance for _ in range(episodes))
        hit = draw.randint(0, episodes - won)
        kinds = [hit, *[0] * (len(KINDS) - 1)]
        outcome = CellOutcome(episodes, 12.5, 9.0, [won + hit // 2], [won], [kinds], [-1])
        cells.append(Cell(point, reach, outcome))
    return _swept(grid, cells, [25], episodes, "lanewise sweep runs/h0 --out maps/h0")


def make_robust(grid: ConditionGrid | None = None, episodes: int = 20) -> SweepResult[Condition]:
    """A controller whose accidents grow with time; its start 13 behind 11 m/s cannot be won."""
    grid = grid or ConditionGrid()
    draw = random.Random(0)
    reached = [
        Reach(place.ego_speed < 13.0, True, place.ego_speed < 12.0, "4" * 50, 0)
        for place in grid.searched()
    ]
    outcomes = []
    for _ in grid.places():
        hit, kinds = 0, []
        for _ in HORIZONS:
            hit += draw.randint(0, (episodes - hit) // 3)
            kinds.append([hit - hit // 3, *[0] * (len(KINDS) - 2), hit // 3])
        hits = [sum(found) for found in kinds]
        outcomes.append(
            CellOutcome(
                episodes=episodes,
                speed=12.5,
                reward=9.0,
                escapes=[episodes - 1] * len(hits),
                successes=[episodes - 1 - hit for hit in hits],
                kinds=kinds,
                first_accident=[3 if hit else -1 for hit in hits],
            )
        )
    command = "lanewise sweep runs/h0 --grid robust --out maps/robust"
    return _swept(grid, cells_of(grid, reached, outcomes), HORIZONS, episodes, command)


def _swept(grid, cells, horizons, episodes, command) -> SweepResult:
    return SweepResult(
        controller="hierarchical",
        training_seed=3,
        trained_by={"commit": "a" * 40, "clean_tree": True, "training": "1" * 12},
        seen=("paper",),
        settings=config.flatten(Settings()),
        changes={},
        run="runs/h0",
        command=command,
        episodes=episodes,
        seed=1,
        clearance=0.1,
        horizons=horizons,
        axes=vars(grid),
        cells=cells,
    )
