"""Settings that are right one by one and impossible together; one or more for every such rule."""

from lanewise.config.settings import ONE_LEVEL_STAGES

LEVELS = (*ONE_LEVEL_STAGES, "h_dqn.high_level", "h_dqn.low_level")
BUDGETS = (*ONE_LEVEL_STAGES, "h_dqn")
REVERSED = {
    "training_ego_speed": [12.0, 9.0],
    "training_trap_speed": [11.0, 9.5],
    "training_lanes": [5, 4],
    "training_front_distance": [17.0, 15.0],
    "training_side_distance": [7.0, 4.5],
}


def pairs(rng):
    """(the rule, values by setting, groups of which the message must name one each)."""
    yield from _starts(rng)
    yield from _driving(rng)
    for level in LEVELS:
        yield from _learning(rng, level)
    for stage in BUDGETS:
        yield (
            "training without an end",
            {f"{stage}.episodes": 0, f"{stage}.decisions": 0},
            ((f"{stage}.episodes",), (f"{stage}.decisions",)),
        )


def _starts(rng):
    scenario, traffic = "scenario", "scenario.traffic"
    for name, between in REVERSED.items():
        yield (
            "a range the wrong way round",
            {f"{scenario}.{name}": between},
            ((f"scenario.{name}",),),
        )
    for name, value in (("training_front_distance", [5.0, 15.0]), ("test_front_distance", 5.0)):
        yield (
            "the ego in the trap car ahead",
            {f"{scenario}.{name}": value},
            ((f"{scenario}.{name}",), ("car length",)),
        )
    jitter = round(rng.uniform(1.0, 20.0), 2)
    near = round(jitter + rng.uniform(0.1, 4.9), 2)
    for name, behind in (("spacing", 2), ("first_gap", 0), ("gap_behind", 1)):
        names = {f"{traffic}.{name}": near, f"{traffic}.spacing_jitter": jitter}
        yield (
            "traffic in one another",
            names | {f"{traffic}.vehicles_behind": behind} | _wide(name, jitter),
            tuple((each,) for each in names),
        )
    for name, value in (("test_side_distance", -60.0), ("training_side_distance", [-60.0, 5.0])):
        yield (
            "the trap among the traffic behind",
            {f"{scenario}.{name}": value, f"{traffic}.vehicles_behind": 2},
            ((f"{scenario}.{name}",), (f"{traffic}.gap_behind", f"{traffic}.vehicles_behind")),
        )


def _wide(name, jitter):
    """Enough room elsewhere, so that only the gap of this name is too small."""
    gaps = {"spacing", "first_gap", "gap_behind"} - {name}
    return {f"scenario.traffic.{gap}": round(jitter + 50.0, 2) for gap in sorted(gaps)}


def _driving(rng):
    yield _two(
        "driving.decision_frequency", rng.randint(31, 50), "driving.simulation_frequency", 30
    )
    low = round(rng.uniform(16.5, 39.0), 1)
    yield _two("goals.lowest_speed", low, "goals.highest_speed", 16.0)
    slow = round(rng.uniform(5.5, 9.0), 1)
    yield _two("goals.lowest_speed", 5.0, "driving.stopped_speed", slow)
    yield _two("scenario.ego_speed", 3.0, "driving.stopped_speed", 4.0)
    yield _two("scenario.training_ego_speed", [3.0, 12.0], "driving.stopped_speed", 4.0)
    width = round(rng.uniform(2.5, 3.9), 2)
    yield _two("goals.lateral_tolerance", width, "scenario.lane_width", width)
    step = round(rng.uniform(0.05, 2.0), 2)
    yield _two("goals.speed_tolerance", step, "goals.speed_step", step)
    weights = [f"driving.reward.{name}_weight" for name in ("speed", "steering", "centring")]
    yield "a reward of nothing", dict.fromkeys(weights, 0.0), tuple((name,) for name in weights)


def _two(first, value, second, other):
    return f"{first} against {second}", {first: value, second: other}, ((first,), (second,))


def _learning(rng, level):
    learner, budget = f"{level}.learner", level.partition(".")[0]
    kept = rng.randint(2000, 4000)
    capacity = {f"{learner}.replay_capacity": kept}
    for name, value in (
        (f"{learner}.batch_size", rng.randint(4001, 8000)),
        (f"{learner}.warm_up", rng.randint(4001, 8000)),
        (f"{budget}.worlds", rng.randint(4001, 8000)),
    ):
        yield (
            f"{name.rpartition('.')[2]} against replay_capacity",
            {name: value} | capacity,
            ((name,), (f"{learner}.replay_capacity",)),
        )
    start = round(rng.uniform(0.0, 0.5), 2)
    rate = rng.choice([1e-5, 3e-4, 1e-3])
    for first, value, second, other, more in (
        (f"{level}.exploration.end", start + 0.1, f"{level}.exploration.start", start, {}),
        (
            f"{learner}.final_learning_rate",
            rate * 2,
            f"{learner}.learning_rate",
            rate,
            {f"{learner}.learning_rate_decay": 1000},
        ),
        (f"{learner}.warm_up", 3000, f"{budget}.decisions", rng.randint(1001, 3000), {}),
    ):
        rule, flags, hint = _two(first, value, second, other)
        yield rule.replace(f"{level}.", "").replace(f"{budget}.", ""), flags | more, hint
    paid = ("external_weight", "tracking_weight", "approach_weight", "goal_reward")
    yield (
        "a level that is never paid",
        {f"{level}.{name}": 0.0 for name in paid},
        tuple((f"{level}.{name}",) for name in paid[:1]),
    )
    if level in ("high_level", "low_level"):
        for hidden in ([65_536, 65_536], [rng.randint(40_000, 65_536)] * 8):
            yield (
                "networks that no memory holds",
                {f"{learner}.hidden": hidden},
                ((f"{learner}.hidden",), ("GiB",)),
            )
    for hidden in ([512, 0], [0], [65_537], [-1, 64]):
        yield (
            "layers of no possible width",
            {f"{learner}.hidden": hidden},
            ((f"{learner}.hidden",), ("1",), ("65536",)),
        )
