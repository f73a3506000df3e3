"""What a campaign keeps holds as long as all that it depends on is the same."""

import subprocess

import record


def test_state_follows_files_and_options_and_not_results(tmp_path):
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    (tmp_path / ".gitignore").write_text("build/\n")
    first = record.state(root=tmp_path)
    for name, matters in (
        ("src/a.py", True),
        ("settings.toml", True),
        ("results/trust/some.json", False),
        ("build/kept.json", False),
    ):
        before = record.state(root=tmp_path)
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x = 1\n")
        assert (record.state(root=tmp_path) != before) == matters, name
    now = record.state(root=tmp_path)
    assert len({first, now, record.state(90.0, root=tmp_path)}) == 3
    within = record.state(root=tmp_path, within=("src",))
    (tmp_path / "settings.toml").write_text("x = 2\n")
    assert record.state(root=tmp_path, within=("src",)) == within
    (tmp_path / "src/a.py").rename(tmp_path / "src/b.py")
    assert record.state(root=tmp_path, within=("src",)) != within
