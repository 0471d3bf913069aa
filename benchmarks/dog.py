"""Outlines of a trotting dog from a film: `python -m benchmarks.dog FILM`.

The film is `demo/data/gallery/01_dog.mp4` of github facebookresearch/sam2 (Apache-2.0), 1280×720
px, 30 frames/s, no part of finloop. A person calls the dog, which brings a ball. The extraction
follows the person, so this step begins with points given by hand: `data/gaits/dog/joints.csv` says
where the joints of each leg and of the body lie in every frame of two strides, and how wide the dog
is there. The result is an SVG for each of these frames in the same folder, with an outline for each
part. It is mirrored: the dog heads right. `--check FOLDER` also writes outlines onto the frames.

The camera stands still: what differs from the median of the frames without the dog is the dog, and
a dark leash. Blur makes some paws as pale as the ground, so the axes themselves always count.
"""

import argparse
from pathlib import Path

import av
import cv2
import numpy as np

from benchmarks.horse import COLOURS, ENLARGED, load_axes, outline_parts, svg_text
from benchmarks.pipeline import ROOT
from finloop.base.arrays import Mask, Picture
from finloop.base.drawing import Curve

FOLDER = ROOT / "data/gaits/dog"
EMPTY = slice(80, 100)  # frames without the dog
LEAST_CHANGE = 16  # of the brightest change of a channel, 0 … 255: more is not the ground
LEASH = 95  # brightest channel of the leash; the dog is brighter
SMOOTH_PX = 5  # side of the square within which most pixels decide
SLACK_PX = 4.0  # largest distance of an edge from the tapered axis of a leg; more for the body
SHOWN = slice(400, 600)  # rows of the pictures of `--check`


def find_dog(frame: Picture, ground: Picture) -> Mask:
    """Return where the dog is in a frame (h, w, 3), and no leash; ground: the frame without it."""
    change = cv2.absdiff(frame, ground).max(axis=2)
    mask = (change > LEAST_CHANGE) & (frame.max(axis=2) > LEASH)
    return cv2.medianBlur(mask.astype(np.uint8), SMOOTH_PX) > 0  # without notches and specks


def main() -> None:
    """Trace the film given in the command line; write an SVG for each marked frame to FOLDER."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("film", type=Path, help="the film, 01_dog.mp4")
    parser.add_argument("--check", type=Path, help="folder for pictures with the outlines")
    given = parser.parse_args()
    axes_by_frame = load_axes(FOLDER / "joints.csv")
    with av.open(str(given.film)) as film:
        frames = [
            np.asarray(picture.to_ndarray(format="rgb24"), np.uint8)
            for number, picture in enumerate(film.decode(video=0))
            if number <= max(axes_by_frame)
        ]
    ground = np.median(frames[EMPTY], axis=0).astype(np.uint8)
    height, width = ground.shape[:2]
    for frame, axes in axes_by_frame.items():
        solid = dict.fromkeys(axes, np.ones((height, width), bool))
        curves = outline_parts(axes, find_dog(frames[frame], ground), solid, SLACK_PX)
        if given.check:
            given.check.mkdir(parents=True, exist_ok=True)
            shown = cv2.resize(frames[frame][SHOWN], None, fx=ENLARGED, fy=ENLARGED)
            shown = np.ascontiguousarray(shown[..., ::-1])
            for name, curve in curves.items():
                corners = (curve.points + 0.5 - [0, SHOWN.start]) * ENLARGED - 0.5
                fixed = np.round(16 * corners).astype(np.int32)
                cv2.polylines(shown, [fixed], True, COLOURS[name], 1, cv2.LINE_AA, 4)
            cv2.imwrite(str(given.check / f"{frame}.png"), shown)
        mirrored = {
            name: Curve([width - 1, 0] + curve.points * [-1, 1], True)
            for name, curve in curves.items()
        }
        path = FOLDER / f"{frame}.svg"
        path.write_text(svg_text(mirrored, height, width), encoding="utf-8")


if __name__ == "__main__":
    main()
