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

def refused(call):
    try:
        call()
    except lanewise.errors.LanewiseError as error:
        assert 'context="spawn"' in str(error)
        print(str(error).splitlines()[0])

pool = multiprocessing.get_context("fork").Pool
"""
ENVIRONMENTS = """
envs = gymnasium.make_vec("lanewise/Trap-v0", 2, vectorization_mode="async", vector_kwargs={kwargs})
print(envs.reset(seed=0)[1]["seed"], envs.step(np.array([4, 4]))[0].shape)
envs.close()
"""


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


def test_it_is_refused_at_once():
    code = """
jax.devices()
refused(lambda: pool(1).map(evaluated, [0]))
refused(lambda: pool(1).map(of_own_parts, [0]))
"""
    said, complained, status = run(code)
    assert status == 0, complained
    assert said.count("forked from one that had used JAX") == 2


@pytest.mark.slow
def test_environments_are_refused_at_once():
    made_before = "env = made()\nenv.reset(seed=0)\nrefused(lambda: pool(1).apply(env.step, (4,)))"
    said, complained, status = run(
        f"{made_before}\n{ENVIRONMENTS.format(kwargs={'context': 'fork'})}"
    )
    assert status == 1
    assert "forked from one that had used JAX" in said
    last = complained[complained.rindex("LanewiseError: ") :]
    assert "forked from one that had used JAX" in last


@pytest.mark.slow
@pytest.mark.parametrize(
    "code",
    [
        pytest.param(
            f"jax.devices()\n{ENVIRONMENTS.format(kwargs={'context': 'spawn'})}", id="spawn"
        ),
        pytest.param(ENVIRONMENTS.format(kwargs={"context": "fork"}), id="before-jax"),
    ],
)
def test_other_processes_work(code):
    said, complained, status = run(code, timeout=300)
    assert (said, status) == ("[0 1] (2, 26)\n", 0), complained
