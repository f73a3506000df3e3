"""No file can make Lanewise run anything: the source has no way to, and a real load does not."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import lanewise
import untrusted_files

SOURCE = Path(lanewise.__file__).parent
MODULES = {
    *("pickle", "cPickle", "dill", "cloudpickle", "joblib", "marshal", "shelve", "yaml", "copyreg"),
    *("pandas", "h5py", "imp", "code", "codeop", "pkgutil", "pydoc", "zipimport"),
}
"""Whose import alone would be a way in, or a long way round to one."""
CALLS = {"eval", "exec", "compile", "__import__", "execfile", "literal_eval"}
ATTRIBUTES = {
    *("import_module", "run_path", "run_module", "literal_eval", "exec_module", "load_module"),
    *("spec_from_file_location", "find_class", "fromfile", "memmap", "genfromtxt"),
}
LOADERS = {f"{name}.load" for name in ("np", "numpy", "jnp", "jax.numpy", "torch", "onnx")}
LOADERS |= {"os.system", "os.popen"}
"""Functions that run what they load, or can be told to."""
REASONED = {
    ("cli/main.py", "import_module"): "a command's module: names from the table of commands",
    ("controllers/registry.py", "import_module"): "a controller's class: names from the registry",
    ("report/installation.py", "import_module"): "doctor: names from Lanewise's own metadata",
    ("envs/registration.py", "exec_module"): "Gymnasium's own module, once somebody imports it",
    ("bench/worker.py", "run_path"): "bench: a workload, named by the table of benchmarks",
    ("experiments/drives.py", "np.load"): "recorded drives: arrays alone, as allow_pickle is False",
    ("experiments/drives.py", "allow_pickle"): "False",
}
"""Places that may, and why; what a file says decides none of them."""


def ways_in(tree):
    """(line, what) of every place where a file could come to run."""
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        if isinstance(node, ast.ImportFrom):
            names = [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
            named = {alias.name for alias in node.names} & (ATTRIBUTES | {"literal_eval"})
            yield from ((node.lineno, name) for name in named)
        for name in names:
            if name.split(".")[0] in MODULES:
                yield node.lineno, name
        if isinstance(node, ast.Name) and node.id in CALLS:
            yield node.lineno, node.id
        if isinstance(node, ast.Attribute) and node.attr in ATTRIBUTES:
            yield node.lineno, node.attr
        if isinstance(node, ast.Attribute) and ast.unparse(node) in LOADERS:
            yield node.lineno, ast.unparse(node)
        if isinstance(node, ast.keyword) and node.arg in ("allow_pickle", "shell"):
            yield node.value.lineno, node.arg


def test_the_source_has_no_way_in():
    found = {}
    for path in sorted(SOURCE.rglob("*.py")):
        name = path.relative_to(SOURCE).as_posix()
        for line, what in ways_in(ast.parse(path.read_text("utf-8"))):
            found.setdefault((name, what), []).append(line)
    assert {place for place in found if place not in REASONED} == set()
    # A reason for nothing would hide the next one.
    assert REASONED.keys() <= found.keys()


@pytest.mark.parametrize(
    "source",
    [
        "import pickle",
        "from pickle import loads",
        "import importlib; importlib.import_module(name)",
        "from importlib import import_module",
        "eval(text)",
        "run = exec",
        "compile(text, '', 'exec')",
        "__import__(name)",
        "import ast; ast.literal_eval(text)",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "torch.load(path, weights_only=False)",
        "import yaml",
        "os.system(text)",
        "subprocess.run(text, shell=True)",
    ],
)
def test_the_check_finds_each_way(source):
    assert list(ways_in(ast.parse(source)))


WATCHED = """
import os, sys
from contextlib import nullcontext, suppress
from pathlib import Path

sys.path.insert(0, sys.argv[1])
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
if planted:
    exec(planted)
print(caught)
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    path = tmp_path_factory.mktemp("watched")
    untrusted_files.make(path)
    return path


def watched(place, planted=""):
    """What a process was caught at while it loaded a file of every kind."""
    words = [str(Path(untrusted_files.__file__).parent), str(place), planted]
    made = subprocess.run(
        [sys.executable, "-c", WATCHED, *words], capture_output=True, text=True, check=False
    )
    assert made.returncode == 0, made.stderr
    return ast.literal_eval(made.stdout.splitlines()[-1])


def test_a_real_load_runs_nothing_and_touches_nothing(place):
    assert watched(place) == []


def test_the_watch_sees(place):
    """One process does all of it, after the same loads; each is seen."""
    planted = (
        "import pickle, decimal as d, wave, os, socket\n"
        "try: pickle.loads(b'cos\\ngetcwd\\n.')\nexcept Exception: pass\n"
        "eval('1 + 1')\n"
        f"open({str(place / 'new')!r}, 'w').close()\n"
        "open('/dev/null').close()\n"
        "socket.socket().close()\n"
        "os.system('true')\n"
    )
    seen = {event for event, _ in watched(place, planted)}
    assert {"pickle.find_class", "exec", "compile", "import", "open"} <= seen
    assert {"socket.__new__", "os.system"} <= seen
