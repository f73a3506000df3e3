"""Files of strangers: none can run anything, and damaged ones are refused or say the same.

Ruff's rules in pyproject.toml refuse source that could run what a file holds; a test looks for what
Ruff does not see.
"""

import ast
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import lanewise
import untrusted_files
from lanewise.errors import LanewiseError, printable
from untrusted_files import JOURNAL, TARGETS, fingerprint

BUILTINS = {"compile", "eval", "exec", "__import__"}


def runs_text(source):
    """Whether it names a builtin that runs or compiles text, or lets NumPy unpickle."""
    nodes = list(ast.walk(ast.parse(source)))
    names = {node.id for node in nodes if isinstance(node, ast.Name)}
    pickles = [n.value for n in nodes if isinstance(n, ast.keyword) and n.arg == "allow_pickle"]
    return bool(names & BUILTINS) or any(ast.unparse(value) != "False" for value in pickles)


def test_no_source_runs_text():
    sources = Path(lanewise.__file__).parent.rglob("*.py")
    assert [path for path in sources if runs_text(path.read_text("utf-8"))] == []
    for source in ("run = exec", "compile(text, '', 'eval')", "__import__(name)"):
        assert runs_text(source)
    assert runs_text("np.load(path, allow_pickle=True)")


WATCHED = """
import os, sys
from contextlib import nullcontext, suppress
from pathlib import Path

sys.path[:] = sys.argv[1].split(os.pathsep)
import untrusted_files

loads = untrusted_files.TARGETS
place, planted = Path(sys.argv[2]), sys.argv[3]
from lanewise.errors import LanewiseError
from lanewise.runs import run_state, trained

pretrained = [Path("pretrained") / name for name in ("single-level", "hierarchical")]


def everything(twin):
    for target in loads:
        # The other sweep is not the one that is asked for, and is refused.
        with suppress(LanewiseError) if twin == "other" else nullcontext():
            target.load(place / twin / target.name)
    for name in pretrained:
        trained.load(name)


everything("other")  # What JAX and Python load for themselves, they load now.
package = str(Path(trained.__file__).parent)
caught = []
REFUSED = (
    *("pickle.find_class", "exec", "compile", "marshal.loads", "os.system", "os.exec", "os.fork"),
    *("os.posix_spawn", "os.spawn", "subprocess.Popen", "ctypes.dlopen", "code.__new__"),
    *("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.truncate", "os.chmod", "os.link"),
    *("os.symlink", "shutil.rmtree", "shutil.copyfile", "shutil.move", "builtins.input"),
)


def watch(event, arguments):
    if event == "compile" and arguments[1] == "<unknown>":
        return  # `ast.parse`, by which NumPy reads an array's header: it makes a tree, no code.
    if event in REFUSED or event.startswith(("socket.", "urllib.", "http.", "ftplib.")):
        caught.append((event, str(arguments)[:200]))
    if event == "import" and arguments[0] not in sys.modules:
        caught.append((event, arguments[0]))
    if event == "open":
        path, mode, flags = arguments
        writes = (flags or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND)
        inside = str(path).startswith((str(place / "whole"), package))
        # A file that is open already has a number for a path.
        if not isinstance(path, int) and (writes or not inside):
            caught.append((event, f"{path} {mode} {flags}"))


sys.addaudithook(watch)
everything("whole")
found = str(caught)
caught.clear()
exec(planted)
print(found)
print(caught)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    path = tmp_path_factory.mktemp("untrusted")
    untrusted_files.make(path)
    return path


PLANTED = """
import pickle, decimal as d, wave, os, socket
try: pickle.loads(b'cos\\ngetcwd\\n.')
except Exception: pass
eval('1 + 1')
open(place / 'new', 'w').close()
open('/dev/null').close()
socket.socket().close()
os.system('true')
"""


def test_a_real_load_runs_nothing_and_touches_nothing(place):
    """One process: first it loads a file of every kind, then it does what the watch must notice."""
    words = [os.pathsep.join(sys.path), str(place), PLANTED]
    made = subprocess.run(
        [sys.executable, "-c", WATCHED, *words], capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr
    caught, planted = map(ast.literal_eval, made.stdout.splitlines()[-2:])
    assert caught == []
    seen = {event for event, _ in planted}
    assert {"pickle.find_class", "exec", "compile", "import", "open"} <= seen
    assert {"socket.__new__", "os.system"} <= seen


SECONDS = 20
"""After which a load counts as hanging: it waits for something that never comes."""


def flip(file, other, rng):
    """One bit."""
    data = bytearray(file.read_bytes())
    data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
    file.write_bytes(data)


def truncate(file, other, rng):
    data = file.read_bytes()
    file.write_bytes(data[: int(rng.integers(len(data)))])


def extend(file, other, rng):
    file.write_bytes(file.read_bytes() + [b"\0" * 64, b"{}\n", rng.bytes(50)][rng.integers(3)])


def swap(file, other, rng):
    """Two parts change places."""
    data = file.read_bytes()
    a, b = sorted(int(place) for place in rng.integers(1, len(data), 2))
    file.write_bytes(data[b:] + data[a:b] + data[:a])


def noise(file, other, rng):
    file.write_bytes(rng.bytes(int(rng.integers(1, 4000))))


def exchange(file, other, rng):
    """The file of another run."""
    file.write_bytes(other.read_bytes())


def missing(file, other, rng):
    file.unlink()


def link(file, other, rng):
    """A link to a file that is as it should be."""
    kept = file.with_name(f"{file.name}.kept")
    file.rename(kept)
    file.symlink_to(kept)


def endless(file, other, rng):
    file.unlink()
    file.symlink_to("/dev/zero")


def pipe(file, other, rng):
    """A pipe that nobody writes to."""
    file.unlink()
    os.mkfifo(file)


def folder(file, other, rng):
    file.unlink()
    file.mkdir()


def huge(file, other, rng):
    """Larger than any memory; it takes no room on the disk."""
    os.truncate(file, 12 * 1024**3)


def deep(file, other, rng):
    """Lists in lists in lists."""
    depth = int(rng.choice([900, 20_000]))
    file.write_text(("a = " if file.suffix == ".toml" else "") + "[" * depth + "]" * depth)


def many(file, other, rng):
    """Very many small things."""
    file.write_text(("a = [" if file.suffix == ".toml" else "[") + '{"a":[]},' * 100_000 + "0]\n")


def not_finite(file, other, rng):
    """A number becomes NaN, infinity, or one of endless digits."""
    data = file.read_bytes()
    digits = [place for place, byte in enumerate(data) if 48 <= byte < 58]
    place = digits[rng.integers(len(digits))]
    words = [b"NaN", b"-Infinity", b"inf", b"1e999", b"9" * 5000]
    file.write_bytes(data[:place] + words[rng.integers(len(words))] + data[place + 1 :])


WAYS = (flip, truncate, extend, swap, noise, exchange, missing, link, endless, pipe, folder, huge)
TEXT = (deep, many, not_finite)
"""For JSON and TOML."""


@pytest.fixture(scope="module")
def whole(place):
    """What the whole files give."""
    return {each.name: fingerprint(each.load(place / "whole" / each.name)) for each in TARGETS}


def state_of(folder):
    """Everything about a folder that a load could change."""
    status = {path: path.lstat() for path in folder.rglob("*")}
    return {path: (each.st_mode, each.st_size, each.st_mtime_ns) for path, each in status.items()}


def is_damage(target, name, how):
    """Whether the way leaves something wrong at all."""
    alone = len(target.files) == 1 and target.name != JOURNAL
    if how is exchange and alone:
        return False
    # A kill leaves these, and they are made again.
    again = name == "tests/lanewise.json" or name.startswith("run/checkpoints")
    return not (how is missing and again)


def problem(target, folder, whole):
    """What is wrong with how a damaged file is taken; empty if nothing is."""
    before = state_of(folder)
    signal.alarm(SECONDS)
    try:
        found = fingerprint(target.load(folder))
    except LanewiseError as error:
        said = str(error)
        well = 1 <= len(said.splitlines()) <= 2 and printable(said) == said and str(folder) in said
        return "" if well and state_of(folder) == before else f"refused with {said[:300]}"
    finally:
        signal.alarm(0)
    if state_of(folder) != before:
        return "touched"
    if target.name == JOURNAL and found != whole:
        # A journal that ends early is what a kill leaves.
        results, every = json.loads(found)[1], json.loads(whole)[1]
        return "" if results == every[: len(results)] else "loaded damaged"
    return "" if found == whole or not target.signed else "loaded damaged"


@pytest.mark.parametrize("how", WAYS + TEXT, ids=lambda how: how.__name__)
def test_damage_is_refused(place, whole, tmp_path, how):
    def hang(*_):
        raise AssertionError("hangs")

    before, wrong, rng = signal.signal(signal.SIGALRM, hang), [], np.random.default_rng(3)
    try:
        for target in TARGETS:
            for name in target.files:
                binary = name.endswith((".safetensors", ".npz", ".csv"))
                if not is_damage(target, name, how) or (how in TEXT and binary):
                    continue
                for number in range(3 if how in (flip, truncate, not_finite) else 1):
                    folder = tmp_path / f"{number} {target.name} {name.replace('/', ' ')}"
                    shutil.copytree(place / "whole" / target.name, folder)
                    how(folder / name, place / "other" / target.name / name, rng)
                    if said := problem(target, folder, whole[target.name]):
                        wrong.append((target.name, name, said))
    finally:
        signal.signal(signal.SIGALRM, before)
    assert wrong == []


@pytest.mark.parametrize(
    ("load", "said"),
    [
        (lambda folder: "something else", "loaded damaged"),
        (lambda folder: (folder / "file").write_text("x"), "touched"),
        (lambda folder: (_ for _ in ()).throw(LanewiseError("it is wrong")), "refused with it is"),
    ],
)
def test_a_careless_loader_is_noticed(tmp_path, load, said):
    (tmp_path / "file").write_text("altered")
    target = untrusted_files.Target("careless", ("file",), load)
    assert problem(target, tmp_path, "what it should be").startswith(said)
