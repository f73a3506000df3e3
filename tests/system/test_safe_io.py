"""Files of strangers are read without being followed, waited for, or growing dear."""

import os
from pathlib import Path

import pytest

from lanewise import config
from lanewise.errors import LanewiseError
from lanewise.system import safe_io


def test_json_nested_too_deeply():
    with pytest.raises(ValueError, match="nested too deeply"):
        safe_io.parse_json(b"[" * 100_000)


def test_devices_pipes_and_links_are_no_files(tmp_path):
    for name in ("/dev/zero", "/proc/self/status"):
        with pytest.raises(LanewiseError, match=f"cannot read {name}: .*not a reg"):
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
        ("", {}, "a folder"),
    ):
        with pytest.raises(safe_io.UnreadableError, match=says):
            safe_io.read_bytes(tmp_path / name, **{"largest": 4} | options)
