"""Draws images/trap.png from a trained controller: ``python docs/make_picture.py RUN``.

Three moments of test episode 0, one above the other: in the trap, on the way out, past it.
"""

import sys
from pathlib import Path

from PIL import Image

from lanewise.evaluation.episodes import Recording
from lanewise.experiments import testing
from lanewise.report import scene
from lanewise.runs import trained

PICTURE = Path(__file__).parent / "images" / "trap.png"


def moments(recording: Recording) -> tuple[float, float, float]:
    """The start, the middle of the escape, and the moment of it, s; thirds if there is none."""
    end = float(recording.time[-1])
    if recording.escaped.any():
        end = float(recording.time[int(recording.escaped.argmax())])
    return 0.0, end / 2.0, end


def draw(recording: Recording) -> Image.Image:
    """The moments of a recording, stacked."""
    frames = [scene.frame(recording, time) for time in moments(recording)]
    width, height = frames[0].size
    picture = Image.new("RGB", (width, height * len(frames)))
    for place, frame in enumerate(frames):
        picture.paste(frame, (0, place * height))
    return picture


def main(run: Path) -> None:
    """Writes the picture."""
    recording = testing.record(trained.load(run), "lanewise", seed=0, episode=0)
    PICTURE.parent.mkdir(exist_ok=True)
    draw(recording).quantize(64).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
