"""Clips and pictures: what is drawn where, and files whole or not at all."""

import dataclasses
import subprocess
import warnings

import imageio_ffmpeg
import jax
import numpy as np
import pytest
from fabricate import make_recording
from PIL import Image

from lanewise.errors import LanewiseError
from lanewise.report import clip, scene

SMALL = (480, 120)


def painted(image: Image.Image, colour: tuple[int, int, int]) -> np.ndarray:
    """Rows and columns of the pixels close to a colour, below the panel."""
    pixels = np.asarray(image).astype(int)
    pixels[: int(scene.PANEL * image.height) + 1] = -1000
    return np.argwhere(np.abs(pixels - colour).max(axis=2) < 12)


def test_vehicles_are_true_to_scale(recording):
    image = clip.frame(recording, 0.0)
    scale = scene.View(recording, 0.0, scene.SIZE, 1).scale
    height, width = np.ptp(painted(image, scene.BODY[0]), axis=0) + 1
    assert width == pytest.approx(5.0 * scale, abs=1.5)
    assert height == pytest.approx(2.0 * scale, abs=1.5)


def test_ego_stands_at_its_place_and_lane(recording):
    image = clip.frame(recording, 25.0)
    row, column = painted(image, scene.BODY[0]).mean(axis=0)
    assert column == pytest.approx(scene.EGO_PLACE * image.width, abs=3.0)
    x, y = float(recording.x[-1, 0]), float(recording.y[-1, 0])
    assert row == pytest.approx(scene.View(recording, x, image.size, 1).at(x, y)[1], abs=1.5)


def test_colours_tell_the_roles(recording):
    image = clip.frame(recording, 0.0)
    assert all(len(painted(image, colour)) > 100 for colour in scene.BODY)


def test_absent_vehicles_are_not_drawn(recording):
    alone = dataclasses.replace(recording, present=np.arange(8) == 0)
    image = clip.frame(alone, 0.0)
    assert not len(painted(image, scene.BODY[1]))
    assert not len(painted(image, scene.BODY[2]))


def test_target_lane_is_shown_only_with_a_goal(recording):
    assert len(painted(clip.frame(recording, 0.0), scene.TARGET_LANE)) > 1000
    flat = make_recording(goals=False)
    assert not len(painted(clip.frame(flat, 0.0), scene.TARGET_LANE))


def test_badges():
    escaped, crashed = make_recording(), make_recording(accident=1, seconds=5.0)

    def corner(recording, t):
        image = clip.frame(recording, t)
        return np.asarray(image)[:30, 800:].reshape(-1, 3).tolist()

    assert list(scene.GREEN) in corner(escaped, 25.0)
    assert list(scene.GREEN) not in corner(escaped, 0.0)
    assert list(scene.ALARM) in corner(crashed, 5.0)
    assert list(scene.ALARM) not in corner(crashed, 4.4)


def test_crashed_vehicles_are_marked():
    crashed = make_recording(accident=1, seconds=5.0)
    before, after = (len(painted(clip.frame(crashed, t), scene.INK)) for t in (4.4, 5.0))
    assert before == 0
    assert after > 20


def test_moments_between_decisions_are_interpolated(recording):
    now = scene.moment(recording, 0.25)
    np.testing.assert_allclose(now.x, (recording.x[0] + recording.x[1]) / 2)
    assert now.index == 0
    assert scene.moment(recording, 0.5).index == 1
    assert scene.moment(recording, 99.0).index == len(recording.time) - 1
    assert scene.moment(recording, -1.0).time == 0.0


def test_decision_times_that_are_not_exact_in_floats(recording):
    thirds = dataclasses.replace(recording, time=np.cumsum(np.full(51, 0.1)) - 0.1)
    assert [scene.moment(thirds, n / 10).index for n in range(51)] == list(range(51))


def test_gif(tmp_path):
    clip.render(make_recording(seconds=2.0), tmp_path / "c.gif", SMALL)
    with Image.open(tmp_path / "c.gif") as gif:
        durations = []
        for number in range(gif.n_frames):
            gif.seek(number)
            durations.append(gif.info["duration"])
        assert gif.size == SMALL
    assert sum(durations) == pytest.approx(1000 * (2.1 + clip.LINGER))
    assert durations[:20] == [100] * 20
    assert [p.name for p in tmp_path.iterdir()] == ["c.gif"]


def test_gif_keeps_the_colours(tmp_path):
    clip.render(make_recording(seconds=1.0), tmp_path / "c.gif")
    with Image.open(tmp_path / "c.gif") as gif:
        image = gif.convert("RGB")
    assert all(len(painted(image, colour)) > 100 for colour in scene.BODY)


def test_mp4(tmp_path):
    clip.render(make_recording(seconds=2.0), tmp_path / "c.mp4", SMALL)
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "c.mp4"))
    assert frames == 21 + round(clip.LINGER * clip.FRAME_RATE)
    assert seconds == pytest.approx(frames / clip.FRAME_RATE, abs=0.05)
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(tmp_path / "c.mp4")]
    still = tmp_path / "still.png"
    subprocess.run([*command, "-frames:v", "1", str(still)], check=True)
    assert Image.open(still).size == SMALL


def test_an_mp4_forks_no_python_beside_the_threads_of_jax(tmp_path):
    """JAX warns of the deadlock that a fork risks, and where it warns it is right."""
    jax.devices()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        clip.render(make_recording(seconds=0.5), tmp_path / "c.mp4", SMALL)
    assert not [str(warning.message) for warning in said]


@pytest.mark.parametrize("folder", ["a:b", "-f"])
def test_an_mp4_anywhere(tmp_path, monkeypatch, folder):
    monkeypatch.chdir(tmp_path)
    clip.render(make_recording(seconds=0.5), f"{folder}/c.mp4", SMALL)
    assert (tmp_path / folder / "c.mp4").stat().st_size > 1000


def test_an_encoder_that_fails_at_once(tmp_path, monkeypatch):
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", lambda: "false")
    with pytest.raises(LanewiseError, match="did not finish"):
        clip.render(make_recording(seconds=1.0), tmp_path / "c.mp4", SMALL)
    assert not list(tmp_path.iterdir())


def test_one_frame_is_enough(tmp_path):
    clip.render(make_recording(seconds=0.0), tmp_path / "c.gif", SMALL)


def test_other_suffixes_are_refused_at_once(tmp_path, recording):
    for name in ("c.avi", "c", "c.gif.png"):
        with pytest.raises(LanewiseError, match=r"\.gif or \.mp4") as error:
            clip.render(recording, tmp_path / name)
        assert "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".gif", ".mp4"])
def test_interrupted_writing_leaves_what_was_there(tmp_path, monkeypatch, suffix):
    path = tmp_path / f"c{suffix}"
    path.write_bytes(b"old")
    recording = make_recording(seconds=2.0)
    real = clip.frame

    def stops(recording, t, size):
        if 1.0 < t < 1.5:
            raise KeyboardInterrupt
        return real(recording, t, size)

    monkeypatch.setattr(clip, "frame", stops)
    with pytest.raises(KeyboardInterrupt):
        clip.render(recording, path, SMALL)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_unwritable_places_are_one_line(tmp_path, recording):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file" / "c.png", tmp_path / "folder.png"):
        (tmp_path / "folder.png").mkdir(exist_ok=True)
        with pytest.raises(LanewiseError, match="cannot write") as error:
            clip.picture(recording, [0.0], path, SMALL)
        assert "\n" not in str(error.value)


def test_picture_stacks_moments(tmp_path, recording):
    clip.picture(recording, [0.0, 12.0, 25.0], tmp_path / "p.png", SMALL)
    assert Image.open(tmp_path / "p.png").size == (480, 3 * 120 + 2 * 5)
    with pytest.raises(LanewiseError, match="at least one"):
        clip.picture(recording, [], tmp_path / "p.png")


def test_words_do_not_overlap(recording, monkeypatch):
    boxes = []
    real = scene.ImageDraw.ImageDraw.text

    def noted(self, place, words, **rest):
        boxes.append(self.textbbox(place, words, font=rest["font"], anchor=rest.get("anchor")))
        real(self, place, words, **rest)

    monkeypatch.setattr(scene.ImageDraw.ImageDraw, "text", noted)
    width, height = scene.SIZE
    wide = dataclasses.replace(
        recording, controller="single-level", accumulated_reward=-100.0 - recording.time
    )
    clip.frame(wide, 25.0)
    assert len(boxes) > 15
    for number, (left, top, right, bottom) in enumerate(boxes):
        assert 0 <= left < right <= width
        assert 0 <= top < bottom <= height
        for a, b, c, d in boxes[:number]:
            assert right <= a or c <= left or bottom <= b or d <= top


def test_an_encoder_that_does_not_finish_is_noticed(tmp_path, monkeypatch):
    monkeypatch.setattr(imageio_ffmpeg, "count_frames_and_secs", lambda path: (3, 0.3))
    with pytest.raises(LanewiseError, match="did not finish"):
        clip.render(make_recording(seconds=1.0), tmp_path / "c.mp4", SMALL)
    assert not list(tmp_path.iterdir())


def test_no_ffmpeg_is_one_line(tmp_path, monkeypatch):
    def missing():
        raise RuntimeError("No ffmpeg exe could be found.\nInstall it.")

    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", missing)
    with pytest.raises(LanewiseError, match=r"a \.gif instead"):
        clip.render(make_recording(seconds=1.0), tmp_path / "c.mp4", SMALL)
