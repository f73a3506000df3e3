"""Files of strangers: none can run anything, and damaged ones are refused or say the same.

Ruff's rules in pyproject.toml refuse source that could run what a file holds; a test looks for what
Ruff does not see.
"""

import ast
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

import lanewise
import untrusted_files
from lanewise.errors import LanewiseError, printable
from untrusted_files import TARGETS, fingerprint

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
from pathlib import Path

sys.path[:] = sys.argv[1].split(os.pathsep)
import untrusted_files

from lanewise.runs import trained

place, planted = Path(sys.argv[2]), sys.argv[3]


def everything():
    for target in untrusted_files.TARGETS:
        target.load(place / target.name)
    for name in ("single-level", "hierarchical"):
        trained.load(Path("pretrained") / name)


everything()  # What JAX and Python load for themselves, they load now.
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
        inside = str(path).startswith((str(place), package))
        # A file that is open already has a number for a path.
        if not isinstance(path, int) and (writes or not inside):
            caught.append((event, f"{path} {mode} {flags}"))


sys.addaudithook(watch)
everything()
found = str(caught)
caught.clear()
exec(planted)
print(found)
print(caught)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory, _hierarchical_runs):
    path = tmp_path_factory.mktemp("untrusted")
    untrusted_files.make(path, *_hierarchical_runs)
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


def flip(data, rng):
    """One bit."""
    place, bit = int(rng.integers(len(data))), 1 << int(rng.integers(8))
    return data[:place] + bytes([data[place] ^ bit]) + data[place + 1 :]


def swap(data, rng):
    """Two parts change places."""
    a, b = sorted(int(place) for place in rng.integers(1, len(data), 2))
    return data[b:] + data[a:b] + data[:a]


def not_finite(data, rng):
    """A number becomes NaN, infinity, or one of endless digits."""
    place = rng.choice([place for place, byte in enumerate(data) if 48 <= byte < 58])
    word = rng.choice([b"NaN", b"-Infinity", b"inf", b"1e999", b"9" * 5000])
    return data[:place] + bytes(word) + data[place + 1 :]


CONTENTS = {
    "flip": flip,
    "truncate": lambda data, rng: data[: int(rng.integers(len(data)))],
    "extend": lambda data, rng: data + [b"\0" * 64, b"{}\n", rng.bytes(50)][rng.integers(3)],
    "swap": swap,
    "noise": lambda data, rng: rng.bytes(int(rng.integers(1, 4000))),
}
"""What becomes of a file's bytes."""
TEXTS = {
    "not finite": not_finite,
    "deep": lambda data, rng: b"a = " + b"[" * 20_000 + b"]" * 20_000,
    "dotted": lambda data, rng: b".".join([b"a"] * 40_000) + b" = 1\n",
    "many": lambda data, rng: b"[" + b'{"a":[]},' * 100_000 + b"0]\n",
}
"""What becomes of those of JSON and TOML."""


def instead(put):
    """Something else has the file's name."""

    def replace(file):
        kept = file.with_name(f"{file.name}.kept")
        file.rename(kept)
        put(file, kept)

    return replace


FILES = {
    "missing": Path.unlink,
    "link": instead(lambda file, kept: file.symlink_to(kept)),
    "endless": instead(lambda file, _: file.symlink_to("/dev/zero")),
    "pipe": instead(lambda file, _: os.mkfifo(file)),
    "folder": instead(lambda file, _: file.mkdir()),
    # Larger than any memory; it takes no room on the disk.
    "huge": lambda file: os.truncate(file, 12 * 1024**3),
}
"""What becomes of a file itself."""


@pytest.fixture(scope="module")
def expected(place):
    """What the whole files give."""
    return {each.name: fingerprint(each.load(place / each.name)) for each in TARGETS}


def state_of(folder):
    """Everything about a folder that a load could change."""
    status = {path: path.lstat() for path in folder.rglob("*")}
    return {path: (each.st_mode, each.st_size, each.st_mtime_ns) for path, each in status.items()}


def damage(how, file, rng):
    """Damage a file in one of the ways, where that leaves something wrong at all."""
    if how in FILES:
        # A kill leaves it without these, and they are made again.
        if how != "missing" or not (file.name == "lanewise.json" or "checkpoints" in file.parts):
            FILES[how](file)
    elif how in CONTENTS or file.suffix in (".json", ".jsonl", ".toml"):
        file.write_bytes((CONTENTS | TEXTS)[how](file.read_bytes(), rng))


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
    return "" if found == whole or not target.signed else "loaded damaged"


@pytest.mark.parametrize("how", [*CONTENTS, *TEXTS, *FILES])
def test_damage_is_refused(place, expected, tmp_path, how):
    def hang(*_):
        raise AssertionError("hangs")

    before, wrong, rng = signal.signal(signal.SIGALRM, hang), [], np.random.default_rng(3)
    try:
        for target in TARGETS:
            for name in target.files * (3 if how in ("flip", "truncate", "not finite") else 1):
                folder = Path(tempfile.mkdtemp(dir=tmp_path)) / target.name
                shutil.copytree(place / target.name, folder)
                damage(how, folder / name, rng)
                if said := problem(target, folder, expected[target.name]):
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
