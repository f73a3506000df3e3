"""Frames and clips: what is drawn where, and files whole or not at all."""

import dataclasses
import subprocess
import warnings

import imageio_ffmpeg
import jax
import numpy as np
import pytest
from PIL import Image, ImageColor

from fabricate import make_recording
from lanewise.errors import LanewiseError
from lanewise.report import clip, frame, road_shapes


def painted(image: Image.Image, colour: str) -> np.ndarray:
    """Rows and columns of the pixels close to a colour, below the panel."""
    pixels = np.asarray(image).astype(int)
    pixels[: int(frame.PANEL * image.height) + 1] = -1000
    return np.argwhere(np.abs(pixels - ImageColor.getrgb(colour)).max(axis=2) < 12)


RECORDING = make_recording()


def test_the_ego_is_to_scale_at_its_place_and_the_colours_tell_the_roles():
    image = frame.frame(RECORDING, 0.0)
    camera = frame.Camera(RECORDING, 0.0)
    ego = painted(image, road_shapes.BODIES[0])
    height, width = np.ptp(ego, axis=0) + 1
    assert width == pytest.approx(5.0 * camera.scale, abs=1.5)
    assert height == pytest.approx(2.0 * camera.scale, abs=1.5)
    row, column = ego.mean(axis=0)
    assert column == pytest.approx(frame.EGO_PLACE * image.width, abs=3.0)
    assert row == pytest.approx(camera.pixel((0.0, float(RECORDING.y[0, 0])))[1], abs=1.5)
    assert all(len(painted(image, colour)) > 100 for colour in road_shapes.BODIES)


def test_endings_have_a_badge_and_crashed_vehicles_a_cross():
    escaped, crashed = make_recording(), make_recording(accident=1, seconds=5.0)

    def badge(recording, t, colour):
        corner = np.asarray(frame.frame(recording, t))[:30, 800:].reshape(-1, 3).tolist()
        return list(ImageColor.getrgb(colour)) in corner

    assert badge(escaped, 25.0, frame.GREEN)
    assert not badge(escaped, 0.0, frame.GREEN)
    assert badge(crashed, 5.0, frame.ALARM)
    assert not badge(crashed, 4.4, frame.ALARM)
    before, after = (len(painted(frame.frame(crashed, t), road_shapes.CRASH)) for t in (4.4, 5.0))
    assert before == 0
    assert after > 20


def test_moments_between_decisions_are_interpolated():
    now = road_shapes.moment(RECORDING, 0.25)
    np.testing.assert_allclose(now.x, (RECORDING.x[0] + RECORDING.x[1]) / 2)
    assert now.index == 0
    assert road_shapes.moment(RECORDING, 99.0).index == len(RECORDING.time) - 1
    assert road_shapes.moment(RECORDING, -1.0).time == 0.0
    # Times that are not exact in floats.
    thirds = dataclasses.replace(RECORDING, time=np.cumsum(np.full(51, 0.1)) - 0.1)
    assert [road_shapes.moment(thirds, n / 10).index for n in range(51)] == list(range(51))


def test_a_gif_runs_in_real_time_and_keeps_the_colours(tmp_path, monkeypatch):
    monkeypatch.setattr(clip, "LINGER", 0.3)
    clip.render(make_recording(seconds=1.0), tmp_path / "c.gif")
    with Image.open(tmp_path / "c.gif") as gif:
        image, durations = gif.convert("RGB"), []
        for number in range(gif.n_frames):
            gif.seek(number)
            durations.append(gif.info["duration"])
    assert all(len(painted(image, colour)) > 100 for colour in road_shapes.BODIES)
    assert sum(durations) == pytest.approx(1000 * (1.1 + clip.LINGER))
    assert durations[:10] == [100] * 10
    assert [p.name for p in tmp_path.iterdir()] == ["c.gif"]
    clip.render(make_recording(seconds=0.0), tmp_path / "c.gif")


def test_mp4(tmp_path, monkeypatch):
    """Anywhere, and without a fork beside JAX's threads, of which JAX would warn."""
    jax.devices()
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        clip.render(make_recording(seconds=1.0), "-f:b/c.mp4")
    assert not [str(warning.message) for warning in said]
    place = str(tmp_path / "-f:b" / "c.mp4")
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(place)
    assert frames == 11 + round(clip.LINGER * clip.FRAME_RATE)
    assert seconds == pytest.approx(frames / clip.FRAME_RATE, abs=0.05)
    still = tmp_path / "still.png"
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", place, "-frames:v", "1"]
    subprocess.run([*command, str(still)], check=True)
    assert Image.open(still).size == (frame.WIDTH, frame.HEIGHT)


def no_ffmpeg():
    raise RuntimeError("No ffmpeg exe could be found.\nInstall it.")


def test_an_encoder_that_fails_is_one_line(tmp_path, monkeypatch):
    for found, message in ((lambda: "false", "did not finish"), (no_ffmpeg, r"a \.gif instead")):
        monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", found)
        with pytest.raises(LanewiseError, match=message) as error:
            clip.render(make_recording(seconds=1.0), tmp_path / "c.mp4")
        assert "\n" not in str(error.value)
        assert not list(tmp_path.iterdir())


def test_other_suffixes_are_refused_at_once(tmp_path):
    with pytest.raises(LanewiseError, match=r"must end in \.gif or \.mp4"):
        clip.render(RECORDING, tmp_path / "c.gif.png")
    assert not list(tmp_path.iterdir())


def test_words_do_not_overlap(monkeypatch):
    boxes = []
    real = frame.ImageDraw.ImageDraw.text

    def noted(self, place, words, **rest):
        boxes.append(self.textbbox(place, words, font=rest["font"], anchor=rest.get("anchor")))
        real(self, place, words, **rest)

    monkeypatch.setattr(frame.ImageDraw.ImageDraw, "text", noted)
    sums = -100.0 - RECORDING.time
    frame.frame(dataclasses.replace(RECORDING, accumulated_reward=sums), 25.0)
    assert len(boxes) > 15
    for number, (left, top, right, bottom) in enumerate(boxes):
        assert 0 <= left < right <= frame.WIDTH
        assert 0 <= top < bottom <= frame.HEIGHT
        for a, b, c, d in boxes[:number]:
            assert right <= a or c <= left or bottom <= b or d <= top
