"""Our own workloads beside which peers are measured: the matrix product, and time to the level."""

import io
import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stdout
from pathlib import Path
from statistics import median

import timing

PRODUCTS = 1_000
"""In a compiled call."""
CACHE = "JAX_COMPILATION_CACHE_DIR"
"""Where JAX keeps compiled programs, if it is set."""


def matrix_product(rows, inner, columns, seconds, seed=0):
    """GFLOP/s of XLA's matrix product in the shape of the update's largest one."""
    import jax
    import jax.numpy as jnp

    keys = jax.random.split(jax.random.key(seed), 2)
    left = jax.random.normal(keys[0], (rows, inner))
    right = jax.random.normal(keys[1], (inner, columns)) / inner**0.5

    @jax.jit
    def chain(left, right):
        # Each product depends on the one before, so that none can be left out.
        return jax.lax.fori_loop(0, PRODUCTS, lambda _, x: jnp.dot(x, right), left)

    def call():
        chain(left, right).block_until_ready()

    call()
    work = 2.0 * rows * inner * columns * PRODUCTS
    return lambda: timing.result(timing.calls_per_second(call, seconds) * work / 1e9, "GFLOP/s")


def level(training_seed, cached=False, seed=0):
    """Seconds of a training of preset quick, imports and compilation included; it is then tested.

    ``cached``: an earlier training has left its compiled programs.
    """
    place = tempfile.TemporaryDirectory()
    run, first = Path(place.name) / "run", Path(place.name) / "first"
    words = ["train", "hierarchical", "--preset", "quick", "--seed", str(training_seed), "--out"]
    # Without a compilation cache of the user's, so that all is compiled.
    os.environ.pop(CACHE, None)
    if cached:
        os.environ[CACHE] = str(Path(place.name) / "cache")
        subprocess.run([sys.executable, "-m", "lanewise", *words, first], check=True)

    def timed():
        began = time.perf_counter()
        from jax import monitoring

        from lanewise.cli import main

        spans = []
        monitoring.register_event_time_span_listener(
            lambda event, start, end, **_: spans.append((event, start, end))
        )
        if main([*words, str(run)]):
            raise RuntimeError("the training failed")
        seconds = time.perf_counter() - began
        compiling = covered(span for event, *span in spans if "/compile/" in event)
        with redirect_stdout(io.StringIO()) as said:
            main(["evaluate", str(run), "--json"])
        times = [json.loads(line) for line in (run / "timings.jsonl").read_text().splitlines()]
        detail = {
            "seed": training_seed,
            "compile_seconds": compiling,
            "seconds_of": breakdown(seconds, compiling, times),
            "test": json.loads(said.getvalue()),
        }
        place.cleanup()
        return timing.result(seconds, "s", **detail)

    return timed


def covered(spans):
    """Seconds that at least one span covers: functions are compiled within one another."""
    total, until = 0.0, 0.0
    for start, end in sorted(spans):
        total += max(0.0, end - max(start, until))
        until = max(until, end)
    return total


def breakdown(whole, compiling, times):
    """Where a training's wall time went, adding up to it.

    Chunks count as long as the median of their stage, and so do validations, as the first of each
    waits for its compilation. ``times`` are the lines of the run's ``timings.jsonl``.
    """
    found = {"compilation": compiling, "driving and updates": 0.0, "validation": 0.0}
    for stage in {line["stage"] for line in times}:
        lines = [line for line in times if line["stage"] == stage]
        chunks = [line["seconds"] - line["validation"] for line in lines]
        validations = [line["validation"] for line in lines if line["validation"]]
        found["driving and updates"] += median(chunks) * len(chunks)
        found["validation"] += median(validations or [0.0]) * len(validations)
    return found | {"start, saving, the rest": whole - sum(found.values())}
