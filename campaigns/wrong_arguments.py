"""Mistakes in what is no setting: commands, options, arguments of functions, experiments' keys."""

import math

from wrong_doors import TAKEN, Mistake
from wrong_names import SLIPS

from lanewise.cli.command_line import options_of
from lanewise.cli.main import COMMANDS, command_class
from lanewise.config.settings import PRESETS, TRAPS
from lanewise.controllers.registry import REFERENCES, TRAINABLE
from lanewise.runs import pretrained

# Each so that it ends before anything starts even if the mistake is not seen.
BEGIN = {
    "train": ("train", "hierarchical", "--out", TAKEN),
    "evaluate": ("evaluate", "absent"),
    "compare": ("compare", "absent", "absent2"),
    "watch": ("watch", "absent", "--out", "clip.gif"),
    "export": ("export", "absent", "--out", "model.onnx"),
    "sweep": ("sweep", "absent", "--out", "map"),
    "reproduce": ("reproduce", "--out", TAKEN),
    "bench": ("bench", "--out", f"{TAKEN}/notes.txt"),
}
OPTIONS_TOO = ("seed", "seeds")
"""Right names that a slip makes of one another."""
SPLITS = ("training", "validation", "test")
BUILT_IN = ("quick", "standard", "paper")


def misspelt(rng, each):
    """Names of commands, options, presets and the like."""
    for how in SLIPS:
        for door, right, make in _named(rng, each):
            wrong = how(rng, right)
            if wrong not in (right, "", *OPTIONS_TOO):
                yield Mistake("misspelt", in_words(how), door, make(wrong), ((right,),))


def in_words(how):
    """The name of a way to misspell."""
    return how.__name__.replace("_", " ")


def _named(rng, each):
    """(door, a right name, what the door is handed for a wrong one)."""
    for name in COMMANDS:
        yield "command", name, lambda wrong: [wrong, "--help"]
    for command, words in BEGIN.items():
        options = options_of(command_class(command)).values()
        long = [each.label[2:] for each in options if "." not in each.name and not each.positional]
        for option in rng.sample(sorted(long), min(each, len(long))):
            yield "command", option, lambda wrong, words=words: [*words, f"--{wrong}", "1"]
    for option, names in (("--preset", PRESETS), ("--trap", TRAPS)):
        for name in names:
            yield "command", name, lambda wrong, o=option: [*BEGIN["train"], o, wrong]
    for name in TRAINABLE:
        yield "command", name, lambda wrong: ["train", wrong, "--out", TAKEN]
        yield "lanewise.train", name, lambda wrong: {"controller": wrong}
    for name in BUILT_IN:
        yield "command", name, lambda wrong: ["reproduce", "--out", TAKEN, "--preset", wrong]
    for name in ("lanewise", "highway-env"):
        yield "command", name, lambda wrong: ["evaluate", "absent", "--world", wrong]
    for group, names in (("pretrained", pretrained.names()), ("reference", REFERENCES)):
        for name in names:
            yield "command", name, lambda wrong, g=group: ["evaluate", f"{g}/{wrong}"]
    for argument, names in {"preset": PRESETS, "trap": TRAPS, "split": SPLITS}.items():
        for name in names:
            make = lambda wrong, a=argument: {a: wrong}  # noqa: E731
            yield "gymnasium.make", name, make
            if argument != "split":
                yield "compose's arguments", name, make
                yield "lanewise.train", name, make
    for key in ("preset", "seeds", "episodes", "highway_env_episodes", "arms"):
        yield "experiment", key, lambda wrong, k=key: EXPERIMENT.replace(k, wrong, 1)
    for key, line in (("controller", "\n{}"), ("title", "\n{}"), ("settings", "one.{}")):
        yield (
            *("experiment", key),
            lambda wrong, k=key, at=line: EXPERIMENT.replace(at.format(k), at.format(wrong)),
        )
    for name in ("planned", "quick"):
        yield "experiment", name, lambda wrong, n=name: EXPERIMENT.replace(f'"{n}"', f'"{wrong}"')


EXPERIMENT = """\
preset = "quick"
seeds = 1
episodes = 1
highway_env_episodes = 0
[arms.one]
title = "one"
controller = "planned"
[arms.one.settings]
"scenario.lanes" = 3
"""


def wrong():
    """Wrong types, ranges and combinations of arguments and options."""
    for door, name, values, kind, hint in ARGUMENTS:
        for value in values:
            how = f"{name} {str(value)[:20]!r}"
            yield Mistake(kind, how, door, {name: value}, ((name.partition(" ")[0],), *hint))
    for kind, words, hint in LINES:
        yield Mistake(kind, " ".join(words)[:60], "command", list(words), hint)
    for kind, how, text, hint in _experiments():
        yield Mistake(kind, how, "experiment", text, hint)


TYPE, RANGE, TOGETHER = "wrong type", "out of range", "impossible"
WHOLE = (("whole number",),)
ARGUMENTS = (
    ("lanewise.train", "seed", ("1", 1.5, True, [1], math.nan), TYPE, WHOLE),
    ("lanewise.train", "seed", (-1, 2**31, 10**30), RANGE, (("0",), ("2147483647",))),
    ("lanewise.train", "preset", (3, ["quick"]), TYPE, (("quick",),)),
    ("lanewise.train", "trap", (10, ["trap-10"]), TYPE, (("trap-10",),)),
    ("lanewise.train", "controller", (3, None, ["planned"]), TYPE, (("planned",),)),
    ("lanewise.train", "parts", (3, "mine", None, {}), TYPE, (("lanewise.Parts",),)),
    ("gymnasium.make", "preset", (3, None), TYPE, (("quick",),)),
    ("gymnasium.make", "trap", (10.9, None), TYPE, (("trap-10.9",),)),
    ("gymnasium.make", "split", (0, None, True), TYPE, (("training",), ("test",))),
    ("gymnasium.make", "duration", ("25", None, True, [25], "long"), TYPE, (("number",),)),
    ("gymnasium.make", "duration", (0, -1, 0.4, 1e7, math.nan, math.inf), RANGE, (("0.5",),)),
    ("gymnasium.make", "parts", (3, None, "mine"), TYPE, (("lanewise.Parts",),)),
    ("gymnasium.make", "actions", ("goal", "fly"), TOGETHER, (("lanewise/TrapGoal-v0",),)),
    ("gymnasium.make_vec", "num_envs", ("4", 2.5), TYPE, WHOLE),
    ("gymnasium.make_vec", "autoreset_mode", ("sometimes", 3), TYPE, (("SameStep",),)),
    ("gymnasium.make_vec", "actions", ("goal",), TOGETHER, (("lanewise/TrapGoal-v0",),)),
    ("gymnasium.make_vec", "num_envs", (0, -1), RANGE, (("1",),)),
    ("compose's arguments", "preset", (3, None, ["quick"]), TYPE, (("quick",),)),
    ("compose's arguments", "trap", (10, None), TYPE, (("trap-10",),)),
    ("compose's arguments", "file", (3, "absent.toml", [1]), TYPE, (("settings",),)),
    ("compose's arguments", "flags", (3, "scenario.lanes", [3]), TYPE, (("mapping",),)),
)
LINES = (
    (TOGETHER, ("reproduce", "--out", TAKEN, "--preset", "paper", "--experiment", "wrong.toml"),
     (("--preset",), ("--experiment",))),
    (TOGETHER, ("reproduce", "--out", TAKEN, "--seed", "2147483647", "--seeds", "2"),
     (("--seed",), ("--seeds",))),
    (TOGETHER, ("train", "single-level", "--out", TAKEN, "--high-level", "absent"),
     (("--high-level",), ("hierarchical",))),
    (TOGETHER, ("train", "h-dqn", "--out", TAKEN, "--high-level", "absent"),
     (("--high-level",), ("planned",))),
    (TOGETHER, ("evaluate", "pretrained/single-level", "--renewal", "critic"),
     (("--renewal",), ("goals",))),
    (TOGETHER, ("evaluate", "reference/search", "--renewal", "critic"),
     (("--renewal",), ("goals",))),
    (TOGETHER, ("export", "pretrained/single-level", "--renewal", "critic", "-o", "a.onnx"),
     (("--renewal",), ("goals",))),
    (TOGETHER, ("export", "reference/search", "-o", "a.onnx"), (("exported",),)),
    (TOGETHER, ("export", "reference/rule-based", "-o", "a.npz"), (("exported",),)),
    (TYPE, ("watch", "pretrained/hierarchical", "-o", "clip.avi"), ((".gif",), (".mp4",))),
    (TYPE, ("export", "pretrained/hierarchical", "-o", "a.txt"), ((".onnx",), (".npz",))),
    (TOGETHER, ("sweep", "pretrained/hierarchical", "--out", "map", "--lanes", "3", "3"),
     (("--lanes",), ("twice",))),
    (TOGETHER, ("sweep", "pretrained/hierarchical", "--out", "map", "--front-distance", "5"),
     (("--front-distance",), ("car length",))),
    (TOGETHER, ("sweep", "pretrained/hierarchical", "--out", "map", "--spacing", "9"),
     (("--spacing",), ("car length",))),
    *(
        (TYPE, (*BEGIN["train"][:2], dash + "out", "run"), (("--out",),))
        for dash in ("-", "\N{EM DASH}", "\N{EN DASH}")
    ),
    (TYPE, ("train", "hierarchical", "out", "run"), (("--out",),)),
    (TYPE, (*BEGIN["train"], "--resume=yes"), (("--resume",), ("no value",))),
    ("misspelt", (*BEGIN["reproduce"], "--only", "hierarchicl"), (("hierarchical",),)),
    (TYPE, ("train", "--out", "run"), (("hierarchical",),)),
    (TYPE, ("train", "hierarchical"), (("--out",),)),
    (TYPE, ("--seed", "3", "train"), (("train",),)),
    *((kind, (*BEGIN[command], option, value), ((option,), *hint))
      for command, option, kind, value, hint in (
          ("train", "--seed", RANGE, "-1", (("0",), ("2147483647",))),
          ("train", "--seed", TYPE, "one", WHOLE),
          ("train", "--seed", TYPE, "1.0", WHOLE),
          ("evaluate", "--episodes", RANGE, "0", (("1",), ("10000000",))),
          ("evaluate", "--episodes", TYPE, "many", WHOLE),
          ("compare", "--episodes", RANGE, "10000001", (("1",), ("10000000",))),
          ("watch", "--episode", RANGE, "-1", (("0",), ("10000000",))),
          ("export", "--check", RANGE, "-5", (("0",), ("10000000",))),
          ("sweep", "--clearance", RANGE, "2", (("0",), ("1.5",))),
          ("sweep", "--clearance", TYPE, "wide", (("number",),)),
          ("sweep", "--ego-speed", RANGE, "1e400", (("1",), ("40",))),
          ("reproduce", "--seeds", RANGE, "0", (("1",), ("1000",))),
          ("reproduce", "--processes", RANGE, "0", (("1",), ("1024",))),
          ("bench", "--seconds", RANGE, "0", (("0.1",), ("3600",))),
          ("bench", "--seconds", TYPE, "five", (("number",),)),
      )),
)  # fmt: skip


def _experiments():
    """(kind, how, text, hint) of experiments that make no sense."""
    for key in ("seeds", "episodes", "highway_env_episodes"):
        for value in ('"3"', "1.5", "true", "[1]", "-1", "100000000", "1" * 5000):
            text = "".join(
                f"{key} = {value}\n" if line.startswith(f"{key} =") else f"{line}\n"
                for line in EXPERIMENT.splitlines()
            )
            kind = RANGE if value.strip("-").isdigit() else TYPE
            yield kind, f"{key} = {value[:12]}", text, ((key,), ("whole number",))
    for key, hint in (("preset", "text"), ("title", "text"), ("controller", "text")):
        text = "\n".join(
            f"{key} = 3" if line.startswith(key) else line for line in EXPERIMENT.splitlines()
        )
        yield TYPE, f"{key} = 3", text, ((key,), (hint,))
    head, arms = EXPERIMENT.split("[arms.one]")[0], '[arms.a]\ncontroller = "{}"\n'
    yield TYPE, "no arms", head, (("arms.NAME", "arms"),)
    yield TYPE, "arms = 3", head + "arms = 3\n", (("arms",), ("table",))
    yield TYPE, "not TOML", head + "[arms\n", (("TOML",),)
    borrower = '[arms.b]\ncontroller = "hierarchical"\nhigh_level = "{}"\n'
    for how, text, hint in (
        ("lender unknown", arms.format("planned") + borrower.format("c"), (("high_level",),)),
        ("lender without step 1", arms.format("single-level") + borrower.format("a"),
         (("step 1",), ("planned",))),
        ("more seeds than the lender", arms.format("planned") + borrower.format("a")
         + "seeds = 3\n", (("seeds",), ("a",))),
        ("other goals than the lender's", arms.format("planned") + borrower.format("a")
         + '[arms.b.settings]\n"goals.speed_step" = 2.0\n', (("goals",), ("a",))),
        ("a lender that borrows", arms.format("planned") + borrower.format("a")
         + borrower.replace("arms.b", "arms.d").format("b"), (("d",), ("b",))),
        ("a borrower without step 1", arms.format("planned")
         + borrower.replace("hierarchical", "h-dqn").format("a"), (("step 1",),)),
    ):  # fmt: skip
        yield TOGETHER, how, head + text, hint
