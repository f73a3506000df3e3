"""Processes forked from one that has used JAX: refused at once instead of waiting for ever."""

import os
import signal
import subprocess
import sys
from textwrap import indent

import pytest

START = """
import multiprocessing, gymnasium, jax, lanewise, numpy as np

def made():
    return gymnasium.make("lanewise/Trap-v0", duration=8.0)

def far(world):
    return world.vehicles.x[0] > jax.numpy.float32(9)

def of_own_parts(_):
    return gymnasium.make("lanewise/Trap-v0", task=lanewise.TaskFunctions(success=far))

def evaluated(_):
    return lanewise.evaluate(lambda seen: 4, episodes=1, quiet=True)
"""
ENVIRONMENTS = """
envs = gymnasium.make_vec("lanewise/Trap-v0", 2, vectorization_mode="async", vector_kwargs={kwargs})
print(envs.reset(seed=0)[1]["seed"], envs.step(np.array([4, 4]))[0].shape)
envs.close()
"""
USED = "jax.devices()"
POOL = "multiprocessing.get_context('fork').Pool(1).map(evaluated, [0])"
ALREADY_MADE = """
env = made()
env.reset(seed=0)
print(multiprocessing.get_context("fork").Pool(1).apply(env.step, (4,)))
"""
OWN_PARTS = "multiprocessing.get_context('fork').Pool(1).map(of_own_parts, [0])"


def run(code, timeout=100):
    """A process of its own, killed with those it forked when it waits."""
    words = [sys.executable, "-c", f"{START}\nif __name__ == '__main__':\n{indent(code, '    ')}"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(words, start_new_session=True, **pipes) as process:
        try:
            said, complained = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    return said, complained, process.returncode


@pytest.mark.parametrize(
    "code",
    [
        pytest.param(
            f"{USED}\n{ENVIRONMENTS.format(kwargs={'context': 'fork'})}",
            id="async",
            marks=pytest.mark.slow,
        ),
        pytest.param(f"{USED}\n{POOL}", id="pool"),
        pytest.param(ALREADY_MADE, id="made-before", marks=pytest.mark.slow),
        pytest.param(f"{USED}\n{OWN_PARTS}", id="own-parts", marks=pytest.mark.slow),
    ],
)
def test_it_is_refused_at_once(code):
    _, complained, status = run(code)
    assert status == 1
    last = complained[complained.rindex("LanewiseError: ") :]
    assert "forked from one that had used JAX" in last
    assert 'context="spawn"' in last


@pytest.mark.slow
@pytest.mark.parametrize(
    "code",
    [
        pytest.param(f"{USED}\n{ENVIRONMENTS.format(kwargs={'context': 'spawn'})}", id="spawn"),
        pytest.param(ENVIRONMENTS.format(kwargs={"context": "fork"}), id="before-jax"),
    ],
)
def test_other_processes_work(code):
    said, complained, status = run(code, timeout=300)
    assert (said, status) == ("[0 1] (2, 26)\n", 0), complained
