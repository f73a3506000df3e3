"""A recording as a clip (GIF or MP4), or some of its moments as one picture (PNG)."""

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from lanewise.errors import LanewiseError
from lanewise.evaluation.episodes import Recording
from lanewise.extras import needed_for
from lanewise.report.files import check_suffix, replacing
from lanewise.report.scene import COLOURS, PAPER, SIZE, frame

with needed_for("a clip"):
    from PIL import Image

__all__ = ["FRAME_RATE", "SUFFIXES", "check_name", "frame", "picture", "render"]

SUFFIXES = (".gif", ".mp4")
FRAME_RATE = 10
"""Frames a second in real time; a GIF's clock counts hundredths of a second, so 10 is exact."""
LINGER = 1.5
"""Seconds the last frame stays, so that the ending can be read."""
GIF_COLOURS = 96


def check_name(path: Path | str) -> str:
    """The suffix of a clip's path; call it before driving an episode for nothing.

    Raises:
        LanewiseError: if it is neither .gif nor .mp4.
    """
    return check_suffix(path, SUFFIXES)


def render(recording: Recording, path: Path | str, size: tuple[int, int] = SIZE) -> None:
    """Write a recording as a clip in real time.

    Args:
        recording: the episode; places between its frames are interpolated.
        path: ending in .gif or .mp4; it appears only when complete.
        size: width and height, pixels, both even.

    Raises:
        LanewiseError: for any other suffix, or if the file cannot be written.
    """
    suffix = check_name(path)
    with replacing(path) as beside:
        if suffix == ".gif":
            _gif(recording, beside, size)
        else:
            _mp4(recording, beside, size)


def picture(
    recording: Recording, times: Sequence[float], path: Path | str, size: tuple[int, int] = SIZE
) -> None:
    """Write several moments of a recording, one under the other, as a PNG.

    Args:
        recording: the episode.
        times: s, at least one.
        path: ending in .png.
        size: width and height of one moment, pixels.

    Raises:
        LanewiseError: for any other suffix, no times, or if the file cannot be written.
    """
    check_suffix(path, (".png",))
    if not times:
        raise LanewiseError("a picture needs at least one moment")
    gap = size[1] // 24
    strip = Image.new("RGB", (size[0], len(times) * (size[1] + gap) - gap), PAPER)
    for row, t in enumerate(times):
        strip.paste(frame(recording, t, size), (0, row * (size[1] + gap)))
    with replacing(path) as beside:
        strip.save(beside, optimize=True)


def _frames(recording: Recording, size: tuple[int, int]) -> Iterator[Image.Image]:
    start, end = float(recording.time[0]), float(recording.time[-1])
    count = int(np.ceil((end - start) * FRAME_RATE - 1e-6))
    for number in range(count + 1):
        last = frame(recording, start + number / FRAME_RATE, size)
        yield last
    for _ in range(round(LINGER * FRAME_RATE)):
        yield last


def _gif(recording: Recording, path: Path, size: tuple[int, int]) -> None:
    palette = _palette(recording, size)
    reduced = (
        image.quantize(palette=palette, dither=Image.Dither.NONE)
        for image in _frames(recording, size)
    )
    next(reduced).save(
        path, save_all=True, append_images=reduced, duration=1000 // FRAME_RATE, loop=0
    )


def _palette(recording: Recording, size: tuple[int, int]) -> Image.Image:
    """One palette for all frames: no flicker, small file.

    From the first and the last frame for the shades, and an ample patch of each pure colour, since
    a badge or a blue car may appear in neither.
    """
    width, height = size
    sample = Image.new("RGB", (width, 3 * height))
    sample.paste(frame(recording, float(recording.time[0]), size))
    sample.paste(frame(recording, float(recording.time[-1]), size), (0, height))
    patch = width // len(COLOURS) + 1
    for number, colour in enumerate(COLOURS):
        sample.paste(colour, (number * patch, 2 * height, (number + 1) * patch, 3 * height))
    return sample.quantize(GIF_COLOURS, dither=Image.Dither.NONE)


def _mp4(recording: Recording, path: Path, size: tuple[int, int]) -> None:
    with needed_for("an MP4 clip"):
        import imageio_ffmpeg

    try:
        imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise LanewiseError("there is no ffmpeg for an MP4 clip; write a .gif instead") from error
    # yuv420 halves the colour resolution, hence even sizes; 2 keeps ours as it is.
    writer = imageio_ffmpeg.write_frames(
        str(path), size, fps=FRAME_RATE, quality=8, macro_block_size=2, ffmpeg_log_level="quiet"
    )
    sent = -1  # the first thing sent only starts the encoder
    try:
        for image in chain((None,), _frames(recording, size)):
            writer.send(None if image is None else image.tobytes())
            sent += 1
    finally:
        writer.close()
    # An encoder that runs out of room while finishing raises nothing.
    try:
        stored, _ = imageio_ffmpeg.count_frames_and_secs(str(path))
    except RuntimeError:
        stored = 0
    if stored != sent:
        raise OSError("the video encoder did not finish; is there room on the disk?")
