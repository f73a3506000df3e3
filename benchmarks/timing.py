"""Times a repeated call. Standard library only, as a peer's environment may hold nothing else."""

import time


def calls_per_second(call, seconds):
    """The rate of a call that is repeated until so many seconds have passed."""
    calls, began = 0, time.perf_counter()
    while not calls or time.perf_counter() - began < seconds:
        call()
        calls += 1
    return calls / (time.perf_counter() - began)


def result(value, unit, **detail):
    """What a workload returns (`lanewise.bench.worker`)."""
    return {"value": value, "unit": unit, "detail": detail}


def driving(decisions_per_second, vehicles, ticks_per_decision, ended):
    """Vehicle-ticks/s of random driving in all environments, which hold so many vehicles each."""
    episodes = sum(ended.values())
    return result(
        decisions_per_second * ticks_per_decision * vehicles,
        "vehicle-ticks/s",
        decisions_per_second=decisions_per_second,
        vehicles=vehicles,
        ticks_per_decision=ticks_per_decision,
        episodes=episodes,
        ended={name: count / max(1, episodes) for name, count in ended.items()},
    )
