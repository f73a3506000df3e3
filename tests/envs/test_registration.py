"""Whichever is imported first, `gymnasium.make` knows the environments."""

import subprocess
import sys

import pytest

MAKE = "print(gymnasium.make('lanewise/Trap-v0').observation_space.shape)"
ORDERS = {
    "lanewise first": f"import lanewise, gymnasium; {MAKE}",
    "gymnasium first": f"import gymnasium, lanewise; {MAKE}",
    "by its module": f"import gymnasium; {MAKE.replace('lanewise/', 'lanewise:lanewise/')}",
    "long after": f"import lanewise.cli, json; import gymnasium as gym; import gymnasium; {MAKE}",
}


@pytest.mark.parametrize("order", ORDERS)
def test_it_is_known(order):
    words = [sys.executable, "-W", "error::UserWarning", "-c", ORDERS[order]]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.returncode) == ("(26,)", 0), done.stderr


def test_lanewise_alone_imports_neither_gymnasium_nor_jax():
    heavy = "('gymnasium', 'jax', 'numpy')"
    code = f"import sys, lanewise; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
