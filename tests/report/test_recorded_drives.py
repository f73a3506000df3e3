"""Recorded drives of an arm's median seed: small, and what was driven."""

from dataclasses import fields
from types import SimpleNamespace

import numpy as np

from fabricate import make_recording
from lanewise.evaluation.episodes import Recording
from lanewise.experiments import drives


def test_what_is_read_is_what_was_driven_to_half_a_centimetre(tmp_path):
    driven = [make_recording(), make_recording(accident=1), make_recording(goals=False)]
    file = tmp_path / "arm.npz"
    drives.save(file, driven)
    found = drives.read(file)
    assert len(found) == len(driven)
    for was, now in zip(driven, found, strict=True):
        for field in fields(Recording):
            before, after = getattr(was, field.name), getattr(now, field.name)
            assert type(before) is type(after), field.name
            if isinstance(before, str | int):
                assert before == after
                continue
            assert (before.shape, before.dtype) == (after.shape, after.dtype), field.name
            within = 0.0051 if field.name in ("x", "y") else 1e-4
            np.testing.assert_allclose(after, before, rtol=1e-6, atol=within)


def test_the_median_seed_is_in_the_middle_by_success_then_reward():
    for figures, median in (
        ([(0.0, 3.0)], 0),
        ([(1.0, 9.0), (0.5, 20.0), (0.9, 1.0)], 2),
        ([(1.0, 9.0), (1.0, 8.0), (1.0, 7.0)], 1),
        ([(1.0, 9.0), (1.0, 8.0)], 1),
    ):
        seeds = []
        for number, (success, reward) in enumerate(figures):
            values = {"success_rate": success, "accumulated_reward": reward}
            test = SimpleNamespace(summary=SimpleNamespace(values=values))
            job = SimpleNamespace(seed=number)
            seeds.append(SimpleNamespace(job=job, tests={"lanewise": test}))
        assert drives.median_seed(seeds).job.seed == median
