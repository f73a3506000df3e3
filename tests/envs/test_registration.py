"""Whichever is imported first, Gymnasium knows the environments."""

import subprocess
import sys

import pytest

KNOWN = "print(gymnasium.spec('lanewise/Trap-v0').entry_point)"
ORDERS = {
    "lanewise first": f"import lanewise, gymnasium; {KNOWN}",
    "gymnasium first": f"import gymnasium, lanewise; {KNOWN}",
    "long after": f"import lanewise.cli, json; import gymnasium as gym; import gymnasium; {KNOWN}",
}


@pytest.mark.parametrize("order", ORDERS)
def test_it_is_known(order):
    words = [sys.executable, "-W", "error::UserWarning", "-c", ORDERS[order]]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.returncode) == ("lanewise.envs.single:TrapEnv", 0), done


def test_lanewise_alone_imports_neither_gymnasium_nor_jax():
    heavy = "('gymnasium', 'jax', 'numpy')"
    code = f"import sys, lanewise; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
