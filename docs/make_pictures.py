"""Draw the pictures of test episodes into images/: ``python docs/make_pictures.py``.

They show test episode 0 of the pretrained controllers; trap.png shows three moments of it: in the
trap, on the way out, past it. The other pictures are SVG files written by hand, whose numbers
`tests/test_schematics.py` compares with the settings.
"""

from pathlib import Path

from PIL import Image

from lanewise.experiments import evaluate_trained
from lanewise.report import film_strip, goal_figure
from lanewise.report.figure_style import save
from lanewise.report.frame import frame
from lanewise.runs import trained

IMAGES = Path(__file__).parent / "images"


def main() -> None:
    """Write all pictures."""
    recordings = {
        name: evaluate_trained.record(trained.load(Path("pretrained") / name), "lanewise", 0, 0)
        for name in ("single-level", "hierarchical")
    }
    ours = recordings["hierarchical"]
    escape = float(ours.time[int(ours.escaped.argmax())])
    frames = [frame(ours, time) for time in (0.0, escape / 2.0, escape)]
    width, height = frames[0].size
    picture = Image.new("RGB", (width, height * len(frames)))
    for place, each in enumerate(frames):
        picture.paste(each, (0, place * height))
    picture.quantize(64).save(IMAGES / "trap.png", optimize=True)
    save(goal_figure.draw(ours), IMAGES / "goals", (".png",))
    save(film_strip.draw(recordings), IMAGES / "film-strip", (".png",))


if __name__ == "__main__":
    main()
