"""Files of strangers are read without being followed, waited for, or growing dear."""

import os
import sys
import tracemalloc
from contextlib import suppress
from pathlib import Path

import pytest

from lanewise import config
from lanewise.errors import LanewiseError
from lanewise.system import safe_io

SIZE = 10_000
LINES_A_BYTE, MEMORY_A_BYTE = 150, 700
"""What parsing may take: lines of Python and bytes; what grows with the square takes far more."""
LONG = {
    "a key over what is no line end": '"\x85".' * (SIZE // 5) + "a = 1",
    "a dotted key": "a." * (SIZE // 2) + "a = 1",

    "deep tables": "".join(f"[a{n}." + ".".join("b" * 32) + "]\n" for n in range(SIZE // 75)),

    "lists in lists": "a = " + "[" * (SIZE // 2) + "]" * (SIZE // 2),

}  # fmt: skip


@pytest.mark.parametrize("text", LONG.values(), ids=LONG)
def test_the_cost_of_reading_toml_grows_with_its_length_alone(text):
    """Counted, as a clock would tell more of the machine."""
    data = text.encode()[: 2 * SIZE]
    left = LINES_A_BYTE * len(data)

    def count(*_):
        nonlocal left
        left -= 1
        assert left > 0, "too many lines"
        return count

    sys.settrace(count)
    try:
        with suppress(ValueError):
            safe_io.parse_toml(data)
    finally:
        sys.settrace(None)
    tracemalloc.start()
    try:
        with suppress(ValueError):
            safe_io.parse_toml(data)
        assert tracemalloc.get_traced_memory()[1] < MEMORY_A_BYTE * len(data)
    finally:
        tracemalloc.stop()


def test_lines_are_those_of_toml():
    """A separator in a comment or a text begins no line; a line feed begins the next key."""
    found = safe_io.parse_toml("a = 1 # \u2028 .\nb = '\u2028'\nc.d = 1.5".encode())
    assert found == {"a": 1, "b": "\u2028", "c": {"d": 1.5}}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (b'{"a": 1, "a": 2}', "a name is given twice"),
        (b"NaN", "not finite"),
        (b"1e999", "not finite"),
        (b"[" * 40 + b"]" * 40, "nested too deeply"),
        (b"[" * 100_000, "nested too deeply|Expecting value"),
        (b"\xff", "utf-8"),
    ],
)
def test_json_is_plain_and_unambiguous(text, says):
    with pytest.raises(ValueError, match=says):
        safe_io.parse_json(text)


def test_devices_pipes_and_links_are_no_files(tmp_path):
    for name in ("/dev/zero", "/proc/self/status"):
        with pytest.raises(LanewiseError, match=f"cannot read settings file {name}: .*not a reg"):
            config.load_toml(Path(name))
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    (tmp_path / "file").write_text("text")
    assert safe_io.read_bytes(tmp_path / "link", 4) == b"text"
    for name, options, says in (
        ("pipe", {}, "a pipe"),
        ("link", {"links": False}, "a link"),
        ("file", {"largest": 3}, "too large"),
        ("none", {}, "No such file"),
        ("", {}, "Is a directory"),
    ):
        with pytest.raises(safe_io.UnreadableError, match=says):
            safe_io.read_bytes(tmp_path / name, **{"largest": 4} | options)
