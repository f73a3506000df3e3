"""Draws the pictures of these pages into images/: ``python docs/make_pictures.py``.

Schematics come from the default settings, the others from test episode 0 of the pretrained
controllers. trap.png shows three moments of it: in the trap, on the way out, past it.
"""

from pathlib import Path

from PIL import Image

from lanewise.config.settings import Settings
from lanewise.evaluation.episodes import Recording
from lanewise.experiments import evaluate_trained
from lanewise.report import (
    film_strip,
    framework,
    goal_track,
    scene,
    start_ranges,
    trap_schematic,
    two_steps,
)
from lanewise.runs import trained

IMAGES = Path(__file__).parent / "images"
CONTROLLERS = ("single-level", "hierarchical")


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


def schematics(settings: Settings) -> None:
    """The pictures that settings alone make."""
    trap_schematic.write(settings.scenario, IMAGES / "trap-schematic.png")
    start_ranges.write(settings.scenario, IMAGES / "start-ranges.png")
    framework.write(settings, IMAGES / "framework.png")
    two_steps.write(settings, IMAGES / "two-steps.png")


def drives() -> None:
    """The pictures of test episodes."""
    recordings = {
        name: evaluate_trained.record(trained.load(Path("pretrained") / name), "lanewise", 0, 0)
        for name in CONTROLLERS
    }
    ours = recordings["hierarchical"]
    draw(ours).quantize(64).save(IMAGES / "trap.png", optimize=True)
    goal_track.write(ours, IMAGES / "goals.png")
    film_strip.write(recordings, IMAGES / "film-strip.png")


def main() -> None:
    """Writes all pictures."""
    IMAGES.mkdir(exist_ok=True)
    schematics(Settings())
    drives()


if __name__ == "__main__":
    main()
