"""PyTorch's matrix product in the shape of the update's largest one. Needs only PyTorch."""

import os
import time
from collections.abc import Callable
from typing import Any

import torch


def prepare(
    rows: int, inner: int, columns: int, seconds: float, seed: int = 0
) -> Callable[[], dict[str, Any]]:
    """Makes the matrices; the result multiplies for ``seconds``."""
    torch.set_num_threads(len(os.sched_getaffinity(0)))
    torch.manual_seed(seed)
    left = torch.randn(rows, inner)
    right = torch.randn(inner, columns) / inner**0.5
    out = torch.empty(rows, columns)
    for _ in range(100):
        torch.mm(left, right, out=out)

    def measure() -> dict[str, Any]:
        done, began = 0, time.perf_counter()
        while time.perf_counter() - began < seconds:
            for _ in range(100):
                torch.mm(left, right, out=out)
            done += 100
        took = time.perf_counter() - began
        return {"products": done, "seconds": took, "flops": 2.0 * rows * inner * columns * done}

    return measure
