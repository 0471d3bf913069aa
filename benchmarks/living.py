"""Grain of the living tank beside that of the film, and whether its pictures are seen again.

`python -m benchmarks.living DATA ...` takes working copies whose stage `extract` is done; it prints
the table and writes benchmarks/living.csv. The film's grain is measured in another part of it than
the tank's pictures are from, where no animal passes, in even light.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.pipeline import write_table
from finloop.extract.grain import choose_spans, empty_tank_pictures
from finloop.io.video import CLIP_NAME, read_frames
from finloop.project import Project
from finloop.render.living import LivingTank

_FRAMES, _SECONDS = 120, 60  # of the film that are measured; of the animation
_APART_PX = (1, 4, 8)


def measure_grain(pictures: NDArray[np.float32], shown: NDArray[np.bool_]) -> tuple[float, ...]:
    """Return SD [grey levels], correlation with the next picture, and with pixels 1, 4, 8 px apart.

    pictures: (n, h, w); shown (h, w): pixels that count.
    """
    grain = pictures - pictures.mean(axis=0)
    power = float((grain[:, shown] ** 2).mean())
    next_correlation = float((grain[1:][:, shown] * grain[:-1][:, shown]).mean()) / power
    correlations = []
    for apart in _APART_PX:
        both = shown[:, apart:] & shown[:, :-apart]
        right, left = grain[:, :, apart:][:, both], grain[:, :, :-apart][:, both]
        scale = ((right**2).mean() * (left**2).mean()) ** 0.5
        correlations.append(float((right * left).mean() / scale))
    return (power**0.5, next_correlation, *correlations)


def repetition(tank: LivingTank, rate_hz: float) -> float:
    """Return the largest autocorrelation of whole pictures more than 1 s apart, in a minute."""
    order = np.array([tank.number_at(tick) for tick in range(round(_SECONDS * rate_hz))])
    sample = np.stack([picture[::4, ::4].ravel() for picture in tank.pictures]).astype(np.float32)
    sample -= sample.mean(axis=0)
    products = sample @ sample.T
    products /= np.diag(products).mean()
    lags = range(round(rate_hz) + 1, len(order) // 2)
    return max(float(products[order[lag:], order[:-lag]].mean()) for lag in lags)


def measure_film(root: Path) -> dict[str, Any] | None:
    """Return the row of a working copy's film; None if its tank stands still."""
    with Project(root) as project:
        tank, facts, scene = project.living_tank("grain"), project.facts, project.scene
        if tank is None:
            return None
        first = choose_spans(facts.segments, project.background.shape)[0][0]
        start, stop = facts.segments[0]
        part = max(start, min(first - _FRAMES, (stop - start) // 4))
        frames = read_frames(
            project.data / "clip" / CLIP_NAME, colour=project.background.ndim == 3, start=part,
            stop=min(stop, part + _FRAMES),
        )  # fmt: skip
        film = empty_tank_pictures(
            frames, project.background, scene.threshold_grey, scene.typical_length_px
        )
        ticks = range(len(film.pictures))
        shown = ~film.covered
        sides = {"film": film.pictures, "animation": np.stack([tank.picture_at(t) for t in ticks])}
        row: dict[str, Any] = {"film": root.name, "pictures": len(tank.pictures)}
        names = ["sd_grey", "next", *(f"px_{apart}" for apart in _APART_PX)]
        for side, pictures in sides.items():
            grey = pictures if pictures.ndim == 3 else pictures[..., 1]
            numbers = measure_grain(grey.astype(np.float32), shown)
            row |= {f"{side}_{name}": number for name, number in zip(names, numbers, strict=True)}
        return row | {"repetition": repetition(tank, facts.frame_rate_hz)}


def main() -> None:
    """Measure the films of working copies; print and write the table."""
    parser = argparse.ArgumentParser(description="Grain of the living tank beside the film's.")
    parser.add_argument("data", nargs="+", type=Path, help="working copies, each with data/")
    rows = [row for root in parser.parse_args().data if (row := measure_film(root))]
    write_table(__file__, pd.DataFrame(rows).round(2))


if __name__ == "__main__":
    main()
