"""Which tests use randomness, time or files: those whose text has one of the words for it.

The text of a test is its own, and that of all in its file that it mentions: helpers, fixtures,
constants. Tests marked slow are left out.
"""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
WORDS = {
    "randomness": {"random", "given", "seed"},
    "time": {"time", "monotonic", "perf_counter", "sleep", "datetime", "clock", "signal"},
    "files": {
        "tmp_path", "tmp_path_factory", "open", "mkdir", "read_text", "write_text", "read_bytes",
        "write_bytes", "Path", "chdir", "subprocess",
    },
}  # fmt: skip


def names_in(node):
    """Every name that a piece of a program mentions."""
    found = set()
    for part in ast.walk(node):
        match part:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
                found.add(name)
            case ast.keyword(arg=str(name)):
                found.add(name)
    return found


def is_slow(node, marks):
    """Whether a function, or its whole file, is marked slow."""
    decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
    return any(text.startswith("pytest.mark.slow") for text in [*decorators, *marks])


def reasons_of(path):
    """{test: kinds of words it has}, of one file; tests without any are left out."""
    body = ast.parse(path.read_text()).body
    tops = {node.name: node for node in body if hasattr(node, "name")}
    for node in body:
        if isinstance(node, ast.Assign):
            tops |= {target.id: node for target in node.targets if isinstance(target, ast.Name)}
    mentions = {name: names_in(node) for name, node in tops.items()}
    marks = [ast.unparse(tops["pytestmark"].value)] if "pytestmark" in tops else []

    def reached(names):
        seen, left = set(), set(names)
        while left:
            name = left.pop()
            seen.add(name)
            left |= mentions.get(name, set()) - seen
        return seen

    tests = [(node.name, node) for node in body if getattr(node, "name", "").startswith("test_")]
    for node in body:
        if isinstance(node, ast.ClassDef) and node.name.startswith("Test"):
            inner = [part for part in node.body if getattr(part, "name", "").startswith("test_")]
            tests += [(f"{node.name}::{part.name}", part) for part in inner]
    found = {}
    for name, node in tests:
        used = reached(names_in(node) | mentions.get("pytestmark", set()))
        kinds = [kind for kind, words in WORDS.items() if words & used]
        if kinds and not is_slow(node, marks):
            found[name] = kinds
    return found


def select(root=ROOT):
    """{test: kinds of words it has}, of the whole suite."""
    return {
        f"{path.relative_to(root)}::{name}": kinds
        for path in sorted((root / "tests").rglob("test_*.py"))
        for name, kinds in reasons_of(path).items()
    }
