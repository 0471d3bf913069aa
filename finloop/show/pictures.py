"""Pictures of the film for the display's page: pixels, and where the animal is in them."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import cv2
import numpy as np

from finloop.base.arrays import Floats, Picture
from finloop.edit.schema import FRAME
from finloop.extract.matte import drop_residue
from finloop.render.gallery import Gallery
from finloop.show.drawn import PARTNER, PICTURE, States

_SAMPLE = 100  # pictures from which a typical one is made
_LIGHT = np.array([0.2126, 0.7152, 0.0722])  # of red, green, blue (ITU-R BT.709)
_SMALLER = 0.75  # below this drawn size a picture is shrunk beforehand: else it would flicker


class PicturePlacement(NamedTuple):
    """Where an animal is in a picture: its mass centre x, y [px], its heading and its size."""

    x: float
    y: float
    heading_rad: float
    size_px: float


class PagePicture(NamedTuple):
    """A picture of a fish with alpha, and where the animal is in it.

    pixels: (h, w, 2) grey or (h, w, 4) RGB, uint8, premultiplied by alpha. posture: the shape of
    its backbone, as `finloop.puppet.pose` describes it.
    """

    pixels: Picture
    placement: PicturePlacement
    posture: Floats

    def describe(self, number: int) -> dict[str, Any]:
        """Return number, size and placement of the picture for JSON; number: its film row."""
        height, width = self.pixels.shape[:2]
        line = [float(value) for value in self.placement]
        return {"picture": number, "width": width, "height": height, "line": line}

    def to_bytes(self) -> bytes:
        """Return the posture, as float32, and then the pixels, as bytes for a page."""
        return self.posture.astype("<f4").tobytes() + self.pixels.tobytes()


def list_shown_rows(states: States) -> list[int]:
    """Return the film rows whose pictures are shown in states (…, fields), each once, rising."""
    numbers = np.unique(states[..., [PICTURE, PARTNER]]).astype(int).tolist()
    return [number for number in numbers if number >= 0]


def measure_typical_fish(pictures: Iterable[PagePicture]) -> dict[str, Any]:
    """Return the median area and the median darkest colour of the fish in some pictures.

    All dots and silhouettes get this area and colour, so that they do not flicker. Keys: area, as a
    share of the fish's squared size; dark, mean red, green, blue (0 … 255) of the darkest twentieth
    of a fish's pixels.
    """
    areas, colours = [], []
    for picture in pictures:
        alpha = picture.pixels[..., -1].astype(float)
        areas.append(alpha.sum() / 255 / picture.placement.size_px**2)
        solid = picture.pixels[alpha > 127].astype(float)  # pixels that are more fish than water
        solid = solid[:, :-1] * 255 / solid[:, -1:]  # without the premultiplication by alpha
        brightness = solid @ _LIGHT if solid.shape[1] == 3 else solid[:, 0]
        if len(brightness):
            count = max(1, round(len(brightness) / 20))
            darkest = np.argsort(brightness, kind="stable")[:count]
            colours.append(np.broadcast_to(np.minimum(solid[darkest].mean(axis=0), 255), 3))
    dark = np.median(colours, axis=0) if colours else np.zeros(3)
    return {"area": float(np.median(areas)), "dark": [round(float(level), 1) for level in dark]}


class PagePictures:
    """The film's pictures of fish for the display's page; a call with a row loads one."""

    def __init__(self, gallery: Gallery, shrink: float = 1.0) -> None:
        """Take the pictures of a gallery; shrink: drawn size / filmed size, applied below 0.75."""
        self._gallery, self._shrink = gallery, shrink if shrink < _SMALLER else 1.0

    @property
    def largest_px(self) -> tuple[int, int]:
        """Return the largest height and the largest width [px] of all pictures, rounded up."""
        index = self._gallery.cutout_sets[FRAME].store.index
        height, width = (
            int(np.ceil(index[name].max() * self._shrink)) + 1  # 1: against rounding errors
            for name in ("height_px", "width_px")
        )
        return height, width

    def measure_typical_fish(self) -> dict[str, Any]:
        """Return area and darkest colour of a typical fish: medians over 100 to 199 pictures."""
        count = len(self._gallery.cutout_sets[FRAME].centres_px)
        sample = range(0, count, max(1, count // _SAMPLE))  # 100 to 199 pictures
        return measure_typical_fish(self(number) for number in sample)

    def load_pictures(self, states: States) -> dict[int, PagePicture]:
        """Load all pictures that states (…, fields) show; return them by film row."""
        return {number: self(number) for number in list_shown_rows(states)}

    def __call__(self, number: int) -> PagePicture:
        """Return the picture in a row of the film, shrunk; FinloopError if its file is damaged."""
        cutout_set, bodies = self._gallery.cutout_sets[FRAME], self._gallery.bodies
        assert bodies is not None
        cutout, (x_px, y_px) = cutout_set.store[number], cutout_set.centres_px[number]
        pose = bodies.poses.pose[number]
        whole = cutout.pixels if self._gallery.residue else drop_residue(cutout.pixels)
        pixels, (x_scale, y_scale) = _shrink_picture(whole, self._shrink)
        # The mass centre within the shrunk picture; the centre of its first pixel is 0.
        x = (x_px - cutout.x0_px + 0.5) * x_scale - 0.5
        y = (y_px - cutout.y0_px + 0.5) * y_scale - 0.5
        size_px = float(pose.size_px) * float(np.sqrt(x_scale * y_scale))
        placement = PicturePlacement(x, y, float(pose.heading_rad), size_px)
        return PagePicture(pixels, placement, pose.posture)


def _shrink_picture(pixels: Picture, scale: float) -> tuple[Picture, tuple[float, float]]:
    """Return a picture (h, w, c) shrunk by a scale below 1, and the exact scales in x and y.

    The exact scales differ a little, as sides are whole px.
    """
    if scale >= 1:
        return pixels, (1.0, 1.0)
    height, width = pixels.shape[:2]
    new_width, new_height = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(pixels, (new_width, new_height), interpolation=cv2.INTER_AREA)
    small = np.asarray(small, np.uint8).reshape(new_height, new_width, -1)
    return small, (new_width / width, new_height / height)
