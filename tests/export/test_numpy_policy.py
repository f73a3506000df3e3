"""The NumPy policy against the JAX controller, and what its reader refuses."""

import json
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from seen import BATCH, CASES, STEPS, decisions, untrained

from lanewise.export import check, contents, formats, numpy_policy
from lanewise.export.numpy_policy import FORMAT, Ego, load

EGO = Ego(y=4.0, heading=0.0, speed=10.0, lane_centres=[0.0, 4.0, 8.0])


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A policy file of each case."""
    folder = tmp_path_factory.mktemp("policies")
    for case in CASES:
        formats.save(contents.policy(untrained(case), "digest"), folder / f"{case}.npz")
    return folder


@pytest.mark.parametrize("case", CASES)
def test_decides_as_the_controller(files, case):
    found = check.compare(load(files / f"{case}.npz").step, decisions(case))
    assert found.states == found.same == STEPS * BATCH
    assert found.largest_difference < 1e-5
    assert len(found.actions) > 3


def test_one_car_and_a_batch_decide_alike(files):
    seen = decisions("hierarchical")
    batch, single = load(files / "hierarchical.npz"), load(files / "hierarchical.npz")
    for number in range(STEPS):
        ego = Ego(*(value[number] for value in seen.ego))
        actions = batch.act(seen.features[number], ego)
        assert np.array_equal(actions, seen.action[number])
        alone = single.act(seen.features[number, 7], Ego(*(value[7] for value in ego)))
        assert type(alone) is int
        assert alone == actions[7]


@pytest.mark.parametrize("case", ["hierarchical", "single-level-held"])
def test_some_episodes_begin_anew(files, case):
    seen = decisions(case)
    policy, fresh = load(files / f"{case}.npz"), load(files / f"{case}.npz")
    first = (seen.features[0], Ego(*(value[0] for value in seen.ego)))
    second = (seen.features[1], Ego(*(value[1] for value in seen.ego)))
    policy.act(*first)
    which = np.arange(BATCH) % 2 == 0
    policy.reset(which)
    assert np.array_equal(policy.act(*second)[which], fresh.act(*second)[which])
    policy.reset()
    again = load(files / f"{case}.npz")
    assert np.array_equal(policy.act(*first), again.act(*first))


def test_the_reader_needs_numpy_alone(files, tmp_path):
    shutil.copy(numpy_policy.__file__, tmp_path / "numpy_policy.py")
    program = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "import numpy_policy as p\n"
        "policy = p.load(sys.argv[2])\n"
        "ego = p.Ego(y=4.0, heading=0.0, speed=10.0, lane_centres=[0.0, 4.0, 8.0])\n"
        "print(policy.act([0.1] * 26, ego))\n"
        "assert not {'jax', 'lanewise', 'onnx', 'safetensors'} & set(sys.modules)\n"
    )
    words = [sys.executable, "-I", "-c", program, str(tmp_path), str(files / "planned.npz")]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert int(said) == load(files / "planned.npz").act([0.1] * 26, EGO)


def test_says_what_it_is(files):
    about = load(files / "planned.npz").about
    assert (about["controller"], about["settings_digest"]) == ("planned", "digest")
    assert about["goals"]["lifetime"] == 3
    assert about["observation"]["scaling"] == "fine"


@pytest.mark.parametrize(
    ("features", "ego", "says"),
    [
        ([0.0] * 26, None, "needs the ego"),
        ([0.0] * 25, EGO, "features must be"),
        ([np.nan] * 26, EGO, "features must be"),
        ([0.0] * 26, EGO._replace(speed=np.nan), "must be finite"),
        ([0.0] * 26, EGO._replace(lane_centres=[np.inf]), "must have a lane"),
    ],
)
def test_wrong_inputs_are_refused(files, features, ego, says):
    with pytest.raises(ValueError, match=says):
        load(files / "hierarchical.npz").act(features, ego)


def test_a_batch_keeps_its_size(files):
    policy = load(files / "hierarchical.npz")
    policy.act(np.zeros((2, 26)), EGO)
    with pytest.raises(ValueError, match="another size"):
        policy.act(np.zeros((3, 26)), EGO)


def altered(files, tmp_path, **changes):
    """A policy file with other arrays; None leaves one out."""
    with np.load(files / "h-dqn.npz") as file:
        arrays = {name: file[name] for name in file.files} | changes
    path = tmp_path / "altered.npz"
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


@pytest.mark.parametrize(
    "changes",
    [
        {"about": None},
        {"about": np.asarray("[]")},
        {"about": np.asarray("no JSON")},
        {"about": np.asarray(json.dumps({"format": "another", "version": 1}))},
        {"about": np.asarray(json.dumps({"format": FORMAT, "version": 1, "memory": "all"}))},
        {"low_level/0/weights": None},
        {"low_level/0/weights": np.zeros((26, 32), np.float32)},
        {"high_level/1/biases": np.full(6, np.nan, np.float32)},
        {"high_level/1/biases": np.array([{}], object)},
    ],
)
def test_altered_files_are_refused(files, tmp_path, changes):
    with pytest.raises(ValueError, match=r"altered.npz (is no policy|has format another)"):
        load(altered(files, tmp_path, **changes))


def test_other_files_are_refused(files, tmp_path):
    broken = tmp_path / "broken.npz"
    for data in (b"", b"text", (files / "h-dqn.npz").read_bytes()[:-200]):
        broken.write_bytes(data)
        with pytest.raises(ValueError, match="is no policy"):
            load(broken)


def field(*path):
    """Set a field of what a policy says of itself; the last of the path is the value."""

    def change(about, arrays):
        *places, name, value = path
        for place in places:
            about = about[place]
        about[name] = value

    return change


def array(name, alter):
    def change(about, arrays):
        arrays[name] = alter(arrays[name])

    return change


@pytest.mark.parametrize(
    ("case", "change", "says"),
    [
        ("planned", field("seed", float("nan")), "NaN is no number"),
        ("planned", field("seed", -1), "seed is no number from 0"),
        ("planned", field("decision_frequency", True), "decision_frequency is no number"),
        ("planned", field("controller", 3), "controller is no text"),
        ("planned", field("levels", {"high_level": 2, "low_level": 2}), "not those of its kind"),
        ("planned", field("levels", "high_level", 65), "high_level is no number from 1 to 64"),
        ("planned", field("goals", "reference", "yours"), "reference is none that is known"),
        ("planned", field("goals", "lowest_speed", 17.0), "lowest speed of goals exceeds"),
        ("planned", field("goals", "moves", {}), "moves are no list"),
        ("planned", field("goals", "moves", [[0, 2]]), "a move is none"),
        ("planned", field("goals", "moves", [[0, 0]]), "chooses among 5, not 1"),
        ("planned", field("planner", "ticks", 0), "ticks is no number from 1"),
        ("planned", array("planner/trims", lambda a: a[1:]), "candidates do not fit"),
        ("planned", array("planner/trim_steps", np.float32), "are of another type"),
        ("planned", array("planner/turns", lambda a: a * 2), "candidates are no signs"),
        ("planned", array("planner/trim_steps", lambda a: a + 5), "are trimmed at no step"),
        ("planned", array("high_level/1/biases", np.int64), "layer 1 is of another type"),
        ("planned", array("about", lambda _: np.zeros(3, np.float32)), "is no text"),
        ("hierarchical", lambda _, arrays: arrays.update(more=np.zeros(1, np.float32)),
         "holds arrays that do not belong there"),
        ("single-level-held", field("hold", 1001), "hold is no number from 1 to 1000"),
        ("single-level-held", field("hold", 2.0), "hold is no number from 1 to 1000"),
    ],
)  # fmt: skip
def test_each_part_is_checked(files, tmp_path, case, change, says):
    with np.load(files / f"{case}.npz") as file:
        arrays = {name: file[name] for name in file.files}
    about = json.loads(str(arrays["about"]))
    change(about, arrays)
    if arrays["about"].dtype.kind == "U":
        arrays["about"] = np.asarray(json.dumps(about))
    path = tmp_path / "altered.npz"
    np.savez(path, **arrays)
    with pytest.raises(numpy_policy.PolicyError, match=says):
        load(path)


def test_an_archive_holds_each_array_once_and_as_it_is(files, tmp_path):
    members = zipfile.ZipFile(files / "planned.npz")
    path = tmp_path / "altered.npz"

    def wrote(method, *names):
        with zipfile.ZipFile(path, "w", method) as archive:
            for name in names:
                archive.writestr(name, members.read("about.npy"))

    wrote(zipfile.ZIP_DEFLATED, "about.npy")
    with pytest.raises(ValueError, match=r"holds more than it does|is compressed"):
        load(path)
    wrote(zipfile.ZIP_STORED, "about.npy", "about")
    with pytest.raises(ValueError, match="holds an array twice"):
        load(path)
    wrote(zipfile.ZIP_STORED, *(f"{number}.npy" for number in range(501)))
    with pytest.raises(ValueError, match="more than 500 arrays"):
        load(path)


def test_an_endless_file_is_not_read_to_its_end(tmp_path, monkeypatch):
    monkeypatch.setattr(numpy_policy, "LARGEST", 1000)
    path = tmp_path / "large.npz"
    path.write_bytes(b"P" * 1001)
    with pytest.raises(ValueError, match="larger than 1000 bytes"):
        load(path)


def test_a_wrong_policy_is_noticed():
    seen = decisions("single-level")
    policy = contents.policy(untrained("single-level"), "")
    policy.arrays["single_level/1/biases"] = policy.arrays["single_level/1/biases"][::-1]
    found = check.compare(policy.step, seen)
    assert found.different > 50
    assert found.same + found.tied + found.different == found.states


def test_ties_are_counted_apart():
    seen = decisions("single-level")
    policy = contents.policy(untrained("single-level"), "")
    second = np.argsort(-seen.values["single_level"], axis=-1)[..., 1]
    best = np.take_along_axis(seen.values["single_level"], seen.action[..., None], -1)
    tied = seen.values["single_level"].copy()
    np.put_along_axis(tied, second[..., None], best - 1e-5, -1)
    seen = replace(seen, values={"single_level": tied})
    numbers = iter(range(STEPS))

    def other(features, ego, memory):
        _, memory, _ = policy.step(features, ego, memory)
        chosen = second[next(numbers)]
        return chosen, memory, {"single_level": np.eye(9)[chosen]}

    found = check.compare(other, seen)
    assert (found.same, found.tied, found.different) == (0, found.states, 0)
