"""Draw docs/gait.jpg, the walk and the tail beat in the README: `python -m docs.gait`."""

from pathlib import Path

from benchmarks.pipeline import ROOT
from finloop.base.drawing import Morph
from finloop.gait.tool import load_gait
from finloop.gait.transfer import transfer
from finloop.io.picture import save_picture
from finloop.io.svg import load_svg
from finloop.plots.morph import sheet

FRAMES = 8
DATA = Path(ROOT / "data")


def driven(drawing: str, gait: str) -> Morph:
    """A cycle of a shipped drawing by a shipped gait."""
    one, two = (load_svg(DATA / f"drawings/{drawing}_{key}.svg") for key in (1, 2))
    return transfer(one, two, load_gait(DATA / f"gaits/{gait}.json"), FRAMES).morph


if __name__ == "__main__":
    rows = {"dog_walk": driven("dog", "dog_walk"), "trout": driven("fish", "trout")}
    save_picture(ROOT / "docs/gait.jpg", sheet(rows, FRAMES))
