"""What the figures of one run say about one another: how many times as fast as which peer."""

from dataclasses import dataclass
from statistics import median

from lanewise.bench.session import number
from lanewise.bench.suite import training_case

OURS = "lanewise"
SB3_TRAINING = "Stable-Baselines3, DQN on highway-env"
LEVEL = "lanewise train hierarchical --preset quick"
LEVEL_CACHED = f"{LEVEL}, JAX_COMPILATION_CACHE_DIR set, second time"
AGAINST = {
    "world": ("world", ("EnvPool", "highway-env")),
    "latency": ("one decision of one world", ("highway-env",)),
    "update": ("update", ("PyTorch, double DQN", "Stable-Baselines3, DQN")),
}
"""By part, what it is called, and the peers: the best figure of a name that begins so counts."""


@dataclass(frozen=True)
class Ratio:
    """A comparison, in words and as a number."""

    what: str
    value: float
    unit: str
    """`times`, or the unit of a figure that needs no peer."""
    how: str
    """Which figures it comes from."""


def of(figures, cores):
    """Every comparison that the figures of one run allow; ``cores`` were used."""
    found = []
    for part, (called, peers) in AGAINST.items():
        for case in dict.fromkeys(each.case for each in figures if each.part == part):
            ours = _best(figures, part, case, OURS)
            for peer in peers:
                theirs = _best(figures, part, case, peer)
                found += _times(f"{called}, {case}, against {peer}", ours, theirs)
            if part == "world" and cores > 1 and case.endswith(f"{cores} cores"):
                one = case.replace(f"{cores} cores", "1 core")
                theirs = _best(figures, part, one, "highway-env")
                found += _times(f"{called}, {case}, against one highway-env", ours, theirs)
            product = _best(figures, part, case, "matrix product")
            if ours and product:
                done = ours.detail["gflop_per_second"]
                how = f"{done:,.0f} / {product.value:,.0f} {product.unit} ({product.subject})"
                what = f"{called}, {case}, of the matrix product's rate"
                found.append(Ratio(what, 100 * done / product.value, "%", how))
    return [*found, *_level(figures, cores), *_commands(figures)]


def _level(figures, cores):
    """The time to the paper's level, and what Stable-Baselines3 does in that time."""
    times = [each.value for each in figures if (each.part, each.case) == ("level", LEVEL)]
    if not times:
        return []
    typical = median(times)
    how = f"median of {len(times)} seeds, {min(times):.0f} to {max(times):.0f} s"
    found = [Ratio("a hierarchical controller at the paper's level", typical, "s", how)]
    sb3 = _best(figures, "training", training_case(False, cores), SB3_TRAINING)
    if sb3:
        what = "steps that Stable-Baselines3's DQN takes on highway-env in that time"
        how = f"{typical:.0f} s x {sb3.value:.1f} {sb3.unit}"
        found.append(Ratio(what, typical * sb3.value, "steps", how))
    return found


def _commands(figures):
    wanted = {("start-up", "lanewise --help"), ("evaluation", "lanewise")}
    return [
        Ratio(each.case, each.value, each.unit, each.part)
        for each in figures
        if (each.part, each.subject) in wanted
    ]


def _times(what, ours, theirs):
    """How many times as fast as theirs ours is; nothing where one of them was not measured."""
    if not (ours and theirs):
        return []
    how = f"{ours.value:,.0f} / {theirs.value:,.0f} {ours.unit} ({ours.subject} / {theirs.subject})"
    value = ours.value / theirs.value
    if ours.part == "latency":
        how, value = f"{theirs.value:,.0f} / {ours.value:,.0f} {ours.unit}", 1 / value
    return [Ratio(what, value, "times", how)]


def _best(figures, part, case, subject):
    """The largest figure of a subject, whose name begins so."""
    found = [
        each
        for each in figures
        if (each.part, each.case) == (part, case) and each.subject.startswith(subject)
    ]
    return max(found, key=lambda each: each.value, default=None)


def table(found):
    """Comparisons for a terminal."""
    width = max((len(ratio.what) for ratio in found), default=0)
    lines = [
        f"  {ratio.what:<{width}} {number(ratio.value):>9} {ratio.unit:<6} {ratio.how}"
        for ratio in found
    ]
    return "\n".join(["", "", "side by side", *lines]) if found else ""
