"""Outlines of a galloping horse from photographs: `python -m benchmarks.horse PHOTOGRAPHS`.

The photographs are the 15 of one gallop by Eadweard Muybridge (Animal Locomotion, 1887), dark on
light, `01.png` to `15.png`; they are no part of finloop. `data/gaits/horse/joints.csv` says where
the joints of each leg and of the body lie in them, marked by eye, and how wide the animal is there.
The result is an SVG for each photograph in the same folder, with an outline for each part.
`--check FOLDER` also writes the outlines onto the photographs.

The joints span a tapered axis, a little narrower than the animal. Dark pixels beside it, up to the
edge of the silhouette, belong to the nearest axis. So the outline follows the edge where the sky
shows it, and the axis where another part hides it: a leg is whole also where legs cross. A leg ends
inside the trunk, at the elbow or the stifle.
"""

import argparse
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd

from benchmarks.pipeline import ROOT
from finloop.base.arrays import Floats, Mask
from finloop.base.drawing import Curve
from finloop.base.errors import FinloopError
from finloop.gait.limbs import BODY, region_contour
from finloop.io.picture import load_picture
from finloop.morph.folds import count_polygon_folds

FOLDER = ROOT / "data/gaits/horse"
DARK = 0.6  # of the grey level of the sky, half-way to the animal: darker near an axis is animal
PALE = 0.9  # of the sky's grey level: on the axis, this too; some hooves are hardly darker than sky
SKY_PX = 121  # side of the square whose brightest pixel is sky; wider than the trunk
GROUND_PX = 342  # row from which on everything counts as ground
SLACK_PX = {BODY: 14.0}  # largest distance of the edge from the tapered axis, if not LEG_SLACK_PX
LEG_SLACK_PX = 6.0
TOLERANCE_PX = 0.8  # largest distance of the outline's corners from the edge
ENLARGED = 3  # times, of the pictures of `--check`
COLOURS = {  # blue, green, red
    BODY: (0, 200, 255), "fore_left": (255, 120, 0), "fore_right": (0, 0, 255),
    "hind_left": (255, 0, 200), "hind_right": (0, 180, 0),
}  # fmt: skip


class Axis(NamedTuple):
    """The axis of a leg or of the body: its joints (j, 2) and the widths there (j,), px."""

    joints_px: Floats
    widths_px: Floats

    def distances(self, height: int, width: int) -> Floats:
        """Return how far each pixel (h, w) lies outside the tapered axis, px; negative inside."""
        y, x = np.mgrid[:height, :width].astype(np.float64)
        pixel = x + 1j * y
        joints = self.joints_px @ np.array([1, 1j])
        distance = np.full((height, width), np.inf)
        for (start, end), (first, last) in zip(
            pairwise(joints), pairwise(self.widths_px / 2), strict=True
        ):
            bone = end - start
            share = np.clip(((pixel - start) / bone).real, 0, 1)
            outside = np.abs(pixel - start - share * bone) - first - share * (last - first)
            distance = np.minimum(distance, outside)
        return distance


def load_axes(path: Path) -> dict[int, dict[str, Axis]]:
    """Return the axes by frame and part from a CSV with a row for each joint, from the top down."""
    table = pd.read_csv(path)
    axes = dict[int, dict[str, Axis]]()
    for (frame, limb), joints in table.groupby(["frame", "limb"], sort=False):
        axis = Axis(joints[["x_px", "y_px"]].to_numpy(float), joints["width_px"].to_numpy(float))
        axes.setdefault(int(frame), {})[str(limb)] = axis
    return axes


def trace_parts(picture: Floats, axes: Mapping[str, Axis]) -> dict[str, Curve]:
    """Return the outlines of an animal's parts in a picture (h, w), dark on light, px.

    axes: by id. Pixel centres are whole numbers. FinloopError if a part is not on the silhouette.
    """
    smooth = cv2.GaussianBlur(picture, (0, 0), 1)
    shade = picture / cv2.dilate(smooth, np.ones((SKY_PX, SKY_PX)))
    shade[GROUND_PX:] = 1
    # The rider's leg on the body is as bright as the sky.
    solid = {name: (shade < PALE) | (name == BODY) for name in axes}
    return outline_parts(axes, shade < DARK, solid, LEG_SLACK_PX)


def outline_parts(
    axes: Mapping[str, Axis], animal: Mask, solid: Mapping[str, Mask], slack_px: float
) -> dict[str, Curve]:
    """Return the outlines of an animal's parts, px: their axes, and the animal beside them.

    axes: by id. animal (h, w): its silhouette, which counts up to slack_px from a leg, or SLACK_PX.
    solid (h, w): by id, where the axis itself counts. FinloopError if a part is not there.
    """
    distances = {name: axis.distances(*animal.shape) for name, axis in axes.items()}
    nearest = np.min(list(distances.values()), axis=0)
    curves = dict[str, Curve]()
    for name, distance in distances.items():
        within_reach = (distance == nearest) & (distance < SLACK_PX.get(name, slack_px))
        contour = region_contour((distance < 0) & solid[name] | within_reach & animal)
        if isinstance(contour, str):
            raise FinloopError(
                f"the silhouette at the joints of {name}: {contour}",
                "the animal, all of it in the picture",
                "give the pictures in which the joints are marked",
            )
        curves[name] = _thin_out(contour)
    return curves


def _thin_out(contour: Curve) -> Curve:
    """Return an outline with fewer corners, TOLERANCE_PX beside it at most, that does not cross."""
    corners, tolerance = contour.points.astype(np.float32), TOLERANCE_PX
    while True:
        kept = cv2.approxPolyDP(corners, tolerance, True)[:, 0].astype(np.float64)
        if not count_polygon_folds(kept)[0]:
            return Curve(kept, closed=True)
        tolerance /= 2  # where a leg is thin, its sides must not meet


def svg_text(curves: Mapping[str, Curve], height: int, width: int) -> str:
    """Return an SVG of closed paths with ids."""
    lines = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">']
    for name, curve in curves.items():
        points = " ".join(f"{x:.4g} {y:.4g}" for x, y in curve.points)
        lines.append(f'<path id="{name}" d="M{points}Z"/>')
    return "\n".join([*lines, "</svg>", ""])


def draw_outlines(picture: Floats, curves: Mapping[str, Curve]) -> Floats:
    """Return a picture (h, w), enlarged and brighter, with the outlines in COLOURS: (h, w, 3)."""
    bright = (255 * (picture / 255) ** 0.55).astype(np.uint8)
    large = cv2.resize(bright, None, fx=ENLARGED, fy=ENLARGED, interpolation=cv2.INTER_CUBIC)
    large = cv2.cvtColor(large, cv2.COLOR_GRAY2BGR)
    for name, curve in curves.items():
        corners = np.round(16 * ((curve.points + 0.5) * ENLARGED - 0.5)).astype(np.int32)
        cv2.polylines(large, [corners], True, COLOURS[name], 1, cv2.LINE_AA, 4)
    return large


def main() -> None:
    """Trace the photographs given in the command line; write an SVG for each to FOLDER."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photographs", type=Path, help="folder with 01.png to 15.png")
    parser.add_argument("--check", type=Path, help="folder for pictures with the outlines")
    given = parser.parse_args()
    for frame, axes in load_axes(FOLDER / "joints.csv").items():
        path = given.photographs / f"{frame:02}.png"
        if not path.is_file():
            parser.error(f"there is no {path}: give the folder with 01.png to 15.png")
        picture = load_picture(path)
        grey = picture.reshape(*picture.shape[:2], -1).mean(axis=2)
        curves = trace_parts(grey, axes)
        (FOLDER / f"{frame:02}.svg").write_text(svg_text(curves, *grey.shape), encoding="utf-8")
        if given.check:
            given.check.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(given.check / f"{frame:02}.png"), draw_outlines(grey, curves))


if __name__ == "__main__":
    main()
