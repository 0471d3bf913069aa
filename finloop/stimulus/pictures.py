"""Pictures of the film for the display's page: pixels, and where the animal is in them."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import cv2
import numpy as np

from finloop.base.arrays import Floats, Picture
from finloop.edit.schema import FRAME
from finloop.render.gallery import Gallery
from finloop.stimulus.drawn import PARTNER, PICTURE, States

_SAMPLE = 100  # pictures from which a typical one is made
_LIGHT = np.array([0.2126, 0.7152, 0.0722])  # of red, green, blue (ITU-R BT.709)
_SMALLER = 0.75  # below this drawn size a picture is shrunk beforehand: else it would flicker


class PagePicture(NamedTuple):
    """A picture of a fish with alpha, and where the animal is in it.

    pixels: (h, w, 2) grey or (h, w, 4) RGB, uint8, premultiplied by alpha. line: x, y of the mass
    centre (px of the picture), heading (rad), size (px). posture: of the animal, as in
    `finloop.puppet.pose`.
    """

    pixels: Picture
    line: tuple[float, float, float, float]
    posture: Floats


def list_named_pictures(states: States) -> list[int]:
    """Return the film rows whose pictures the states (…, F) of fish need, each once, in order."""
    numbers = np.unique(states[..., [PICTURE, PARTNER]]).astype(int).tolist()
    return [number for number in numbers if number >= 0]


def measure_typical_fish(pictures: Iterable[PagePicture]) -> dict[str, Any]:
    """Return the median area and the median darkest colour of the fish in some pictures.

    Dots and silhouettes share them, so that they do not flicker. area: share of the fish's squared
    size; dark: red, green, blue (0 … 255) of its darkest twentieth.
    """
    areas, colours = [], []
    for one in pictures:
        alpha = one.pixels[..., -1].astype(float)
        areas.append(alpha.sum() / 255 / one.line[3] ** 2)
        solid = one.pixels[alpha > 127].astype(float)
        solid = solid[:, :-1] * 255 / solid[:, -1:]
        light = solid @ _LIGHT if solid.shape[1] == 3 else solid[:, 0]
        if len(light):
            darkest = np.argsort(light, kind="stable")[: max(1, round(len(light) / 20))]
            colours.append(np.broadcast_to(np.minimum(solid[darkest].mean(axis=0), 255), 3))
    dark = np.median(colours, axis=0) if colours else np.zeros(3)
    return {"area": float(np.median(areas)), "dark": [round(float(part), 1) for part in dark]}


class PagePictures:
    """The film's pictures of fish for the display's page; a call with a row loads one.

    shrink: drawn size / filmed size; much smaller fish get smaller pictures.
    """

    def __init__(self, gallery: Gallery, shrink: float = 1.0) -> None:
        """Take the pictures of a gallery, shrunk if fish are drawn much smaller than filmed."""
        self._gallery, self._shrink = gallery, shrink if shrink < _SMALLER else 1.0

    @property
    def largest_px(self) -> tuple[int, int]:
        """Return the height and width [px] of which no picture has more."""
        index = self._gallery.shelves[FRAME].store.index
        sides = [index["height_px"].max(), index["width_px"].max()]
        height, width = (int(np.ceil(side * self._shrink)) + 1 for side in sides)
        return height, width

    def measure_typical_fish(self) -> dict[str, Any]:
        """Return area and darkest colour of a typical fish of the film (`measure_typical_fish`)."""
        count = len(self._gallery.shelves[FRAME].centres_px)
        return measure_typical_fish(
            self(number) for number in range(0, count, max(1, count // _SAMPLE))
        )

    def load_pictures(self, states: States) -> dict[int, PagePicture]:
        """Load all pictures that states (…, F) name; return them by their rows of the film."""
        return {number: self(number) for number in list_named_pictures(states)}

    def __call__(self, number: int) -> PagePicture:
        """Load the picture in a row of the film; FinloopError if its file is damaged."""
        shelf, bodies = self._gallery.shelves[FRAME], self._gallery.bodies
        assert bodies is not None
        cutout, (x_px, y_px) = shelf.store[number], shelf.centres_px[number]
        pose = bodies.poses.pose[number]
        pixels, share = _shrink_picture(cutout.pixels, self._shrink)
        x = (x_px - cutout.x0_px + 0.5) * share[0] - 0.5
        y = (y_px - cutout.y0_px + 0.5) * share[1] - 0.5
        size_px = float(pose.size_px) * float(np.sqrt(share[0] * share[1]))
        return PagePicture(pixels, (x, y, float(pose.heading_rad), size_px), pose.posture)


def _shrink_picture(pixels: Picture, share: float) -> tuple[Picture, tuple[float, float]]:
    """Return a picture (h, w, c) shrunk to a share of its size, and its exact scales in x and y."""
    if share >= 1:
        return pixels, (1.0, 1.0)
    height, width = pixels.shape[:2]
    to = max(1, round(width * share)), max(1, round(height * share))
    small = cv2.resize(pixels, to, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8).reshape(to[1], to[0], -1), (to[0] / width, to[1] / height)
