"""A recording as a clip (GIF or MP4)."""

import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, cast

import numpy as np

from lanewise.errors import LanewiseError
from lanewise.evaluation.episodes import Recording
from lanewise.report.frame import COLOURS, HEIGHT, WIDTH, frame
from lanewise.report.output_files import replacing
from lanewise.system.extras import needed_for

with needed_for("a clip"):
    from PIL import Image

SUFFIXES = (".gif", ".mp4")
FRAME_RATE = 10
"""Frames a second in real time; a GIF's clock counts hundredths of a second, so 10 is exact."""
LINGER = 1.5
"""Seconds the last frame stays, so that the ending can be read."""
GIF_COLOURS = 96


def check_name(path: Path | str) -> str:
    """The suffix of a clip's path; call it before an episode is driven for nothing."""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise LanewiseError(f"cannot write {path}: the name must end in {' or '.join(SUFFIXES)}")
    return suffix


def render(recording: Recording, path: Path | str) -> None:
    """Write a recording as a .gif or .mp4 in real time."""
    write = {".gif": _gif, ".mp4": _mp4}[check_name(path)]
    with replacing(path) as beside:
        write(recording, beside)


def _frames(recording: Recording) -> Iterator[Image.Image]:
    start, end = float(recording.time[0]), float(recording.time[-1])
    count = int(np.ceil((end - start) * FRAME_RATE - 1e-6))
    for number in range(count + 1):
        last = frame(recording, start + number / FRAME_RATE)
        yield last
    for _ in range(round(LINGER * FRAME_RATE)):
        yield last


def _gif(recording: Recording, path: Path) -> None:
    palette, frames = _palette(recording), _frames(recording)
    reduced = (image.quantize(palette=palette, dither=Image.Dither.NONE) for image in frames)
    looks: Any = {"save_all": True, "duration": 1000 // FRAME_RATE, "loop": 0}
    next(reduced).save(path, append_images=reduced, **looks)


def _palette(recording: Recording) -> Image.Image:
    """One palette for all frames, so that nothing flickers and the file is small.

    From the shades of the first and the last frame, and each colour that may be in neither.
    """
    sample = Image.new("RGB", (WIDTH, 3 * HEIGHT))
    sample.paste(frame(recording, float(recording.time[0])))
    sample.paste(frame(recording, float(recording.time[-1])), (0, HEIGHT))
    patch = WIDTH // len(COLOURS) + 1
    for number, colour in enumerate(COLOURS):
        sample.paste(colour, (number * patch, 2 * HEIGHT, (number + 1) * patch, 3 * HEIGHT))
    return sample.quantize(GIF_COLOURS, dither=Image.Dither.NONE)


def _mp4(recording: Recording, path: Path) -> None:
    with needed_for("an MP4 clip"):
        import imageio_ffmpeg

    try:
        ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError as error:
        raise LanewiseError("there is no ffmpeg for an MP4 clip; write a .gif instead") from error
    # So that no name is taken for an option or a protocol.
    place = f"file:{path}"
    sent = _encode(ffmpeg, _frames(recording), place)
    # An encoder that runs out of room while finishing may well call that a success.
    try:
        stored, _ = imageio_ffmpeg.count_frames_and_secs(place)
    except RuntimeError:
        stored = 0
    if not sent or stored != sent:
        raise OSError("the video encoder did not finish; is there room on the disk?")


def _encode(ffmpeg: str, frames: Iterator[Image.Image], place: str) -> int:
    """Hand frames to an ffmpeg; how many it made a video of, 0 if it failed.

    imageio-ffmpeg's own writer runs Python in the new process before it becomes ffmpeg, to give it
    a process group; in a copy of a process with threads, such as JAX's, that may wait for ever.
    """
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{WIDTH}x{HEIGHT}"]
    # yuv420 is what all players know; it halves the colour resolution, hence even sizes.
    wanted = ["-vcodec", "h264", "-crf", "10", "-pix_fmt", "yuv420p"]
    process = subprocess.Popen(
        [ffmpeg, "-y", "-v", "quiet", *raw, "-r", str(FRAME_RATE), "-i", "-", *wanted, place],
        stdin=subprocess.PIPE,
        process_group=0,  # Ctrl-C is for this process alone.
    )
    stdin = cast("IO[bytes]", process.stdin)
    sent = 0
    try:
        with suppress(BrokenPipeError):  # It has stopped, as its status tells.
            for image in frames:
                stdin.write(image.tobytes())
                sent += 1
    except BaseException:
        process.kill()
        raise
    finally:
        with suppress(OSError):
            stdin.close()
        process.wait()
    return 0 if process.returncode else sent
