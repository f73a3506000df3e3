"""Sweeps made up for the tests of their files and pictures."""

import random
from dataclasses import replace

from lanewise import config
from lanewise.config.settings import Settings
from lanewise.evaluation.grid import Cell, Grid, Outcome, Reach
from lanewise.report.sweep import Sweep


def sweep_of(grid: Grid | None = None, episodes: int = 20, clearance: float = 0.1) -> Sweep:
    """A controller that is good near the paper's start, on a grid where fast starts cannot be won.

    At 13 m/s behind 8 m/s nothing can be won; at 13 behind 9 only with D1 beyond 15 m.
    """
    grid = grid or Grid()
    draw = random.Random(0)
    cells = []
    for point in grid.points():
        faster = point.ego_speed - point.trap_speed
        winnable = faster < 4 or (faster == 4 and point.front_distance > 15.0)
        reach = Reach(winnable, True, winnable and faster < 4, "4" * 50 if winnable else "", 0)
        chance = max(0.0, 1.0 - 0.15 * abs(faster)) if winnable else 0.0
        won = sum(draw.random() < chance for _ in range(episodes))
        hit = draw.randint(0, episodes - won)
        outcome = Outcome(episodes, won, hit, 0, 0, 12.5, 9.0, escapes=won + hit // 2)
        cells.append(Cell(point, reach, outcome))
    return Sweep(
        controller="hierarchical",
        training_seed=3,
        trained_by={"commit": "a" * 40, "clean_tree": True, "training": "1" * 12},
        settings=config.flatten(Settings()),
        grid=grid,
        episodes=episodes,
        seed=1,
        clearance=clearance,
        command="lanewise sweep runs/h0 --out maps/h0",
        cells=cells,
    )


def only(sweep: Sweep, **where: float) -> Sweep:
    """The sweep's cells with these values."""
    kept = [
        cell
        for cell in sweep.cells
        if all(getattr(cell.point, axis) == value for axis, value in where.items())
    ]
    return replace(sweep, cells=kept)
