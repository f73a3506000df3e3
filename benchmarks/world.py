"""Decisions a second of our world beside highway-env's, on the same starts in the same run.

Low-level actions are random, the same ones in both worlds; observations and fresh starts after an
ending are included, compilation is timed apart. One decision is five ticks of twelve vehicles.

    python benchmarks/world.py --out results/world.json
    python benchmarks/world.py --processes 2 --out results/world-2.json
"""

import argparse
import json
import os
import shlex
import sys
import time
from datetime import UTC, datetime
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from queue import Empty

ACTION_STREAM = 3
"""Key stream of the random actions; the splits of the starts have 0 to 2."""
CHUNK = 50
"""Decisions in a compiled call."""
DURATION = 50
"""Decisions after which an episode is truncated: 25 s."""


def ours_main(worlds, seconds, seed, barrier):
    """(decisions, seconds, compile seconds, episodes by accident) of our world."""
    import jax
    import numpy as np

    state = jax.jit(partial(begin, worlds, seed))()
    began = time.perf_counter()
    advance = jax.jit(partial(chunk, worlds, seed), donate_argnums=0).lower(state).compile()
    compiled = time.perf_counter() - began
    state = jax.block_until_ready(advance(state)[0])
    barrier.wait()
    ended = np.zeros(5, np.int64)
    decisions, began = 0, time.perf_counter()
    while decisions == 0 or time.perf_counter() - began < seconds:
        state, counts = advance(state)
        ended += np.asarray(counts)  # waits for the chunk
        decisions += worlds * CHUNK
    return decisions, time.perf_counter() - began, compiled, ended.tolist()


def theirs_main(seconds, seed, barrier):
    """(decisions, seconds, seconds of fresh starts, episodes by accident) of highway-env."""
    import numpy as np

    from lanewise.driving import accidents

    starts = prepared(seed, first=0, count=64)
    # The first steps of a process import and set up things.
    warm = live(starts[0][0])
    for action in starts[0][1][:3]:
        their_step(warm, action)
    warm.close()
    barrier.wait()
    ended, decisions, resets, index = np.zeros(5, np.int64), 0, 0.0, 0
    began = time.perf_counter()
    while decisions == 0 or time.perf_counter() - began < seconds:
        asked = time.perf_counter()
        env = live(starts[index % len(starts)][0])
        resets += time.perf_counter() - asked
        accident = accidents.NONE
        for action in starts[index % len(starts)][1]:
            accident = their_step(env, action)
            decisions += 1
            if accident or time.perf_counter() - began > seconds:
                break
        else:
            ended[4] += 1
        ended[accident] += accident > 0
        index += 1
        env.close()
    return decisions, time.perf_counter() - began, resets, ended.tolist()


def settings():
    from lanewise import config

    return config.compose()


def fresh_episode(seed, index):
    from lanewise.driving import episode
    from lanewise.scenario import trap

    start_key = trap.start_key(seed, "training", index)
    return episode.begin(trap.sample(settings().scenario, start_key, "training"))


def action_of(seed, index, decision):
    """The random action of a decision of a start."""
    import jax

    stream = jax.random.fold_in(jax.random.key(seed), ACTION_STREAM)
    key = jax.random.fold_in(jax.random.fold_in(stream, index), decision)
    return jax.random.randint(key, (), 0, 9)


def begin(worlds, seed):
    """World w begins with start w; its next ones are w + worlds, w + 2 worlds and so on."""
    import jax
    import jax.numpy as jnp

    return jax.vmap(partial(fresh, seed))(jnp.arange(worlds))


def fresh(seed, index):
    """A world at its start: (episode, number of the start, observation)."""
    from lanewise.driving import percept

    begun = fresh_episode(seed, index)
    return begun, index, percept.of(settings().driving.observation, begun.world).features


def chunk(worlds, seed, state):
    """`CHUNK` decisions in every world: (state, episodes by accident, the last truncated)."""
    import jax

    from lanewise.driving import restart

    def one(carry, _):
        after, counts = jax.vmap(partial(decide, seed))(*carry)
        _, index, _ = after

        def anew(over):
            return jax.vmap(partial(fresh, seed))(index[over] + worlds)

        return restart.where(counts.any(1), after, anew), counts.sum(0)

    state, counts = jax.lax.scan(one, state, length=CHUNK)
    return state, counts.sum(0)


def decide(seed, before, index, _features):
    """One decision in one world and its observation: (world, how its episode ended)."""
    import jax.numpy as jnp

    from lanewise.driving import episode, percept

    driving = settings().driving
    action = action_of(seed, index, before.decisions)
    after, outcome = episode.step(driving, before, action, DURATION)
    features = percept.of(driving.observation, after.world).features
    code = jnp.where(outcome.truncated, 4, outcome.accident)
    done = outcome.terminated | outcome.truncated
    return (after, index, features), (jnp.arange(5) == code) & done


def first_endings(seed, count):
    """Code of the ending of starts 0 to ``count - 1`` in our world: an accident, or 4."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    from lanewise.driving import episode

    driving = settings().driving

    def ending(index):
        def one(carry, _):
            state, code = carry
            state, outcome = episode.step(
                driving, state, action_of(seed, index, state.decisions), DURATION
            )
            return (state, jnp.where(code == 0, outcome.accident, code)), None

        carry = (fresh_episode(seed, index), jnp.int32(0))
        code = jax.lax.scan(one, carry, length=DURATION)[0][1]
        return jnp.where(code == 0, 4, code)

    return np.asarray(jax.jit(jax.vmap(ending))(jnp.arange(count)))


def prepared(seed, first, count):
    """Starts for highway-env with their actions: [(world, actions)]."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    index = first + jnp.arange(count)
    begun = jax.device_get(jax.jit(jax.vmap(partial(fresh_episode, seed)))(index))
    each = jax.vmap(jax.vmap(partial(action_of, seed), (None, 0)), (0, None))
    actions = np.asarray(jax.jit(each)(index, jnp.arange(DURATION)))
    worlds = [jax.tree.map(lambda leaf, i=i: leaf[i], begun.world) for i in range(count)]
    return list(zip(worlds, actions, strict=True))


def live(world):
    """A live highway-env environment in the state of a start."""
    from lanewise.interop import drive

    return drive.live(settings().driving, world, DURATION)


def their_step(env, action):
    """One decision in highway-env, with its observation: the accident's code."""
    from lanewise.driving import accidents

    env.step(int(action))
    if env.vehicle.crashed:
        return accidents.COLLISION
    if not env.vehicle.on_road:
        return accidents.OFF_ROAD
    stopped = env.vehicle.speed < settings().driving.stopped_speed
    return accidents.STOPPED if stopped else accidents.NONE


def their_endings(seed, count):
    """As `first_endings`, in highway-env."""
    codes = []
    for world, actions in prepared(seed, 0, count):
        env = live(world)
        accident = 0
        for action in actions:
            accident = their_step(env, action)
            if accident:
                break
        codes.append(accident or 4)
        env.close()
    return codes


def side_by_side(main, processes, arguments):
    """The same measurement in several processes at once, each with its own seed."""
    context = get_context("spawn")
    barrier, results = context.Barrier(processes), context.Queue()
    children = [
        context.Process(target=put, args=(results, main, *arguments, seed, barrier))
        for seed in range(processes)
    ]
    for child in children:
        child.start()
    found = []
    while len(found) < processes:
        try:
            found.append(results.get(timeout=1.0))
        except Empty:
            if any(child.exitcode for child in children):
                for child in children:
                    child.terminate()
                sys.exit("a measurement failed")
    for child in children:
        child.join()
    return found


def put(results, main, *arguments):
    results.put(main(*arguments))


def rates(found, extra):
    """Rates summed over processes; episodes by ending."""
    driving, traffic = settings().driving, settings().scenario.traffic
    vehicles = 3 + traffic.vehicles_ahead + traffic.vehicles_behind
    rate = sum(decisions / seconds for decisions, seconds, _, _ in found)
    ended = [sum(column) for column in zip(*(counts for *_, counts in found), strict=True)]
    episodes = max(sum(ended[1:]), 1)
    names = ("collision", "off_road", "stopped", "truncated")
    return {
        "decisions_per_second": rate,
        "vehicle_ticks_per_second": rate * driving.ticks_per_decision * vehicles,
        "decisions": sum(decisions for decisions, *_ in found),
        "episodes": sum(ended[1:]),
        "ended": {name: count / episodes for name, count in zip(names, ended[1:], strict=True)},
        extra: max(value for _, _, value, _ in found),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, nargs="+", default=[1, 64, 1024, 4096])
    parser.add_argument("--seconds", type=float, default=10.0, help="of each measurement")
    parser.add_argument("--processes", type=int, default=1, help="at once, for several cores")
    parser.add_argument("--same", type=int, default=200, help="starts whose endings are compared")
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    if options.processes > 1:
        flags = os.environ.get("XLA_FLAGS", "")
        os.environ["XLA_FLAGS"] = f"{flags} --xla_cpu_multi_thread_eigen=false".strip()

    theirs = rates(
        side_by_side(theirs_main, options.processes, (options.seconds,)), "reset_seconds"
    )
    ours = {}
    for worlds in options.worlds:
        found = side_by_side(ours_main, options.processes, (worlds, options.seconds))
        ours[worlds] = rates(found, "compile_seconds")
        ours[worlds]["times_highway_env"] = (
            ours[worlds]["decisions_per_second"] / theirs["decisions_per_second"]
        )
    pairs = [
        (int(a), int(b))
        for a, b in zip(first_endings(0, options.same), their_endings(0, options.same), strict=True)
    ]

    from lanewise.report import provenance

    result = {
        "command": shlex.join(["python", *sys.argv]),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": provenance.machine(),
        "versions": provenance.versions(),
        "processes": options.processes,
        "vehicles": 3 + settings().scenario.traffic.vehicles_ahead,
        "simulation_frequency": settings().driving.simulation_frequency,
        "decision_frequency": settings().driving.decision_frequency,
        "highway_env": theirs,
        "lanewise": ours,
        "same_starts": {
            "episodes": len(pairs),
            "same_ending": sum(a == b for a, b in pairs),
            "different": [[i, a, b] for i, (a, b) in enumerate(pairs) if a != b],
        },
    }
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(result, indent=2) + "\n")
    print(f"highway-env          {theirs['decisions_per_second']:>12,.0f} decisions/s")
    for worlds, row in ours.items():
        rate, factor = row["decisions_per_second"], row["times_highway_env"]
        print(f"lanewise {worlds:>5} worlds {rate:>12,.0f} decisions/s, {factor:,.0f} times")
    same = result["same_starts"]
    print(f"same ending: {same['same_ending']} of {same['episodes']} starts")


if __name__ == "__main__":
    main()
