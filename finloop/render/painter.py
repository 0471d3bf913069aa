"""The painter: pictures of a fish laid over the empty tank, turned, scaled and cross-faded.

It draws what an edit list names (fish paper Figs. 16, 18). Everything is premultiplied by alpha and
stays in floating point until the canvas, so that a pixel is rounded once:

    F = (1 − w) A + w B        the cross-fade of two pictures A, B, w the partner's share
    canvas = F + (1 − alpha of F) · tank

A and B are sampled with the cubic kernel of Keys (a = −1/2), which reproduces every polynomial up
to the second degree: a shift by a part of a pixel moves the mass centre by exactly that part, and
no shift at all changes nothing. Its overshoots are clipped: 0 ≤ colour ≤ alpha ≤ 255, so that no
fringe shines at the outline and nothing overflows.

The puppet draws a fish in another pose than the filmed one, its partner in the same pose. Of
several fish each is laid over those before it. Where it lies over one, its shadow falls on that
one. U is its alpha, S the same blurred with the SD σ, Cₖ the alpha of a fish k below it: those keep

    1 − share · S · (1 − Πₖ (1 − fₖ Cₖ)),  fₖ = min(1, Aₖ / 2πσ²),  Aₖ = Σ max(0, U + Cₖ − 1)

of their light. Aₖ is the area in px² that both cover for certain, 0 for fish beside each other.
fₖ fades the shadow in as a fish comes under: Aₖ / 2πσ² is the peak of so large a spot blurred by σ.
The floor has no shadow: the film's own cut-outs have none.

Coordinates in px, x right, y down, pixel centres at integers; angles anticlockwise as seen.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.kernel import kernel, leaf_kernel
from finloop.base.sampling import keys_weights
from finloop.puppet import PlacedBackbone, PosedPicture, blend

Image = NDArray[np.uint8]
_PAD = 3  # transparent pixels around a picture: what the kernel reads beyond it


class Box(NamedTuple):
    """A rectangle of the canvas, px, half open; empty where bottom ≤ top or right ≤ left."""

    top: int
    left: int
    bottom: int
    right: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Return the slices of rows and columns that cut the box out of a canvas."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def empty(self) -> bool:
        """Return whether the box contains nothing."""
        return self.bottom <= self.top or self.right <= self.left

    def within(self, shape: tuple[int, ...]) -> "Box":
        """Return the part of the box that lies on a canvas of this shape (height, width …)."""
        top, bottom = (min(max(edge, 0), shape[0]) for edge in (self.top, self.bottom))
        left, right = (min(max(edge, 0), shape[1]) for edge in (self.left, self.right))
        return Box(top, left, bottom, right)

    def grow(self, rim: int) -> "Box":
        """Return the box enlarged by `rim` px on every side."""
        return Box(self.top - rim, self.left - rim, self.bottom + rim, self.right + rim)

    def common(self, other: "Box") -> "Box":
        """Return the intersection of two boxes."""
        return Box(
            max(self.top, other.top), max(self.left, other.left),
            min(self.bottom, other.bottom), min(self.right, other.right),
        )  # fmt: skip

    @classmethod
    def around(cls, boxes: Iterable["Box"]) -> "Box":
        """Return the smallest box that holds all boxes."""
        tops, lefts, bottoms, rights = zip(*boxes, strict=True)
        return cls(min(tops), min(lefts), max(bottoms), max(rights))


class Picture(NamedTuple):
    """A fish to draw: pixels (h, w, 2 or 4) uint8 with a transparent rim, premultiplied.

    near: (h, w) uint8, 0 where all that the kernel reads, between a pixel and the next, is
    transparent. x_px, y_px: its mass centre, in its own pixels. Made by `picture`.
    """

    pixels: Image
    near: Image
    x_px: float
    y_px: float


class Layer(NamedTuple):
    """A picture, see `Picture`, and where it is drawn.

    Its pixel (u, v) is seen at (x, y): u = m0 x + m1 y + m2, v = m3 x + m4 y + m5.
    """

    pixels: Image
    near: Image
    m: tuple[float, float, float, float, float, float]


class Turned(NamedTuple):
    """A picture to draw, turned anticlockwise and scaled about its mass centre."""

    picture: Picture
    rotation_deg: float = 0.0
    scale: float = 1.0

    def box_at(self, x_px: float, y_px: float) -> Box:
        """Return where it can leave a trace: its turned corners, and 2 px for the kernel."""
        cos, sin = (part * self.scale for part in self._axes())
        (height, width), reach = self.picture.pixels.shape[:2], _PAD - 2
        us = [edge - self.picture.x_px for edge in (reach, width - 1 - reach)]
        vs = [edge - self.picture.y_px for edge in (reach, height - 1 - reach)]
        xs = [x_px + cos * u + sin * v for u in us for v in vs]
        ys = [y_px - sin * u + cos * v for u in us for v in vs]
        return Box(
            math.ceil(min(ys)), math.ceil(min(xs)), math.floor(max(ys)) + 1, math.floor(max(xs)) + 1
        )

    def layer_at(self, x_px: float, y_px: float) -> Layer:
        """Return the picture with its mass centre at (x_px, y_px) of the canvas."""
        cos, sin = (part / self.scale for part in self._axes())
        pixels, near, u, v = self.picture
        return Layer(
            pixels, near,
            (cos, -sin, u - cos * x_px + sin * y_px, sin, cos, v - sin * x_px - cos * y_px),
        )  # fmt: skip

    def _axes(self) -> tuple[float, float]:
        """Return cosine and sine of the turn; exactly 1 and 0 for whole turns."""
        angle = math.radians(math.remainder(self.rotation_deg, 360.0))
        return math.cos(angle), math.sin(angle)


class Bent(NamedTuple):
    """A picture to draw in another posture (`finloop.puppet.pose`).

    source: the animal's backbone in the picture's pixels. posture: the one to draw, headed
    `heading_rad` on screen; size_px: of the animal there. mirrored: whether left is drawn as right.
    """

    picture: Picture
    source: PlacedBackbone
    posture: Floats
    heading_rad: float
    size_px: float
    mirrored: bool

    def lay_at(self, x_px: float, y_px: float) -> PosedPicture:
        """Return the picture in its new posture, its mass centre at (x_px, y_px) of the canvas."""
        target = PlacedBackbone(x_px, y_px, self.heading_rad, self.size_px, self.posture)
        return PosedPicture(self.picture.pixels, self.source, target, self.mirrored)

    def box_at(self, x_px: float, y_px: float) -> Box:
        """Return where it can leave a trace."""
        return Box(*self.lay_at(x_px, y_px).box)


def picture(pixels: Image, x_px: float, y_px: float) -> Picture:
    """Return a picture to draw, with a transparent rim, from a cut-out (h, w, 2 or 4) uint8.

    x_px, y_px: its mass centre, px of the cut-out.
    """
    rim = (_PAD, _PAD)
    padded = np.pad(pixels, (rim, rim, (0, 0)))
    alpha = np.ascontiguousarray(padded[..., -1])
    near = cv2.dilate(alpha, np.ones((4, 4), np.uint8), anchor=(1, 1))  # pixels −1, 0, 1, 2
    return Picture(padded, near, x_px + _PAD, y_px + _PAD)


class Placed(NamedTuple):
    """What a row of an edit list draws, and where; the arguments of `Painter.draw`."""

    x_px: float
    y_px: float
    fish: Turned | Bent
    partner: Turned | Bent | None
    weight: float

    @property
    def box(self) -> Box:
        """Return the box of the canvas, px, in which the fish and its partner can leave a trace."""
        fades = self.partner is not None and self.weight
        shown = (self.fish, self.partner if fades else None)
        return Box.around(fish.box_at(self.x_px, self.y_px) for fish in shown if fish is not None)


class Shadow(NamedTuple):
    """The shadow on the fish below. share: of the light that it takes; blur_px: SD of its blur."""

    share: float
    blur_px: float


NO_SHADOW = Shadow(0.0, 1.0)


class Painter:
    """A canvas to draw on, again and again; only what was drawn is wiped.

    floor: (H, W, 1 or 3) uint8, the canvas without fish; callers that draw on it report where with
    `touch`. canvas: the floor with fish.
    """

    def __init__(self, background: Image, colour: bool = False, shadow: Shadow = NO_SHADOW) -> None:
        """Take the empty tank, (H, W) or (H, W, 3); `colour` makes a grey one RGB."""
        floor = background if background.ndim == 3 else background[..., None]
        if colour and floor.shape[2] == 1:
            floor = floor.repeat(3, axis=2)
        self.floor = np.array(floor, order="C")
        self.canvas = self.floor.copy()
        self._shadow, self._touched = shadow, list[Box]()

    @property
    def frame(self) -> Image:
        """Return the canvas as (H, W) or (H, W, 3); a view."""
        return self.canvas if self.canvas.shape[2] == 3 else self.canvas[..., 0]

    def touch(self, box: Box) -> None:
        """Mark a box of the canvas as changed, now or soon, so that `wipe` restores it."""
        if not box.empty:
            self._touched.append(box)

    def wipe(self) -> None:
        """Restore the floor where the canvas was changed."""
        for box in self._touched:
            self.canvas[box.slices] = self.floor[box.slices]
        self._touched.clear()

    def show(self, *fish: Placed) -> Box:
        """Draw these fish alone on the floor, the lowest first; return the box that they cover."""
        self.wipe()
        boxes: list[Box] = []
        for number, one in enumerate(fish):
            if self._shadow.share and number:
                self._shade(one, fish[:number])
            boxes.append(self.draw(*one))
        return Box.around([box for box in boxes if not box.empty] or boxes)

    def _shade(self, upper: Placed, lower: Sequence[Placed]) -> None:
        """Draw the shadow of a fish on those below it, see this module's text."""
        own, (share, blur_px) = upper.box, self._shadow
        lower = [one for one in lower if not one.box.common(own).empty]
        box = own.grow(math.ceil(3 * blur_px)).within(self.canvas.shape)
        if not lower or box.empty:
            return
        above = self._silhouette(upper, box)
        clear = np.ones_like(above)
        for one in lower:
            below = self._silhouette(one, box)
            common_px2 = np.maximum(0, above + below - 1).sum()
            clear *= 1 - min(1.0, common_px2 / (2 * np.pi * blur_px**2)) * below
        if clear.min() == 1:
            return
        dark = cv2.GaussianBlur(above, (0, 0), blur_px) * (1 - clear)
        light = 1 - share * dark[..., None]
        self.canvas[box.slices] = np.rint(self.canvas[box.slices] * light).astype(np.uint8)

    def _silhouette(self, one: Placed, box: Box) -> NDArray[np.float32]:
        """Return the share of each pixel of a box (h, w) that a fish covers."""
        shape = box.bottom - box.top, box.right - box.left, self.canvas.shape[2]
        black, white = (Painter(np.full(shape, level, np.uint8)) for level in (0, 255))
        moved = one._replace(x_px=one.x_px - box.left, y_px=one.y_px - box.top)
        for painter in (black, white):
            painter.draw(*moved)
        through = white.canvas.astype(np.float32) - black.canvas
        return np.asarray(1 - through.mean(axis=2) / 255, np.float32)

    def draw(
        self,
        x_px: float,
        y_px: float,
        fish: Turned | Bent,
        partner: Turned | Bent | None = None,
        weight: float = 0.0,
    ) -> Box:
        """Draw a fish with its mass centre at (x_px, y_px) of the canvas; return its box.

        `partner`, of the same kind, is cross-faded into it with the share `weight` (0 … 1). The
        fish is clipped at the edges.
        """
        other, share = (partner, weight) if partner is not None else (fish, 0.0)
        channels = max(one.picture.pixels.shape[2] for one in (fish, other))
        if channels > self.canvas.shape[2] + 1:
            raise ValueError("a coloured fish needs a coloured canvas")
        if isinstance(fish, Bent) and isinstance(other, Bent):
            posed = [one.lay_at(x_px, y_px) for one in ((fish, other) if share else (fish,))]
            box = Box.around(Box(*one.box) for one in posed).within(self.canvas.shape)
            if not box.empty:
                drawn = [one.in_box(box) for one in posed]
                lay_pixels(self.canvas[box.slices], blend(*drawn, share) if share else drawn[0])
        elif isinstance(fish, Turned) and isinstance(other, Turned):
            parts = [one for one, w in ((fish, 1 - share), (other, share)) if w > 0]
            box = Box.around(one.box_at(x_px, y_px) for one in parts).within(self.canvas.shape)
            if not box.empty:
                layers = fish.layer_at(x_px, y_px), other.layer_at(x_px, y_px)
                lay(self.canvas, box, *layers, share)
        else:
            raise ValueError("a fish and its partner are either both drawn in a pose, or neither")
        self.touch(box)
        return box


@leaf_kernel
def _sample(pixels, near, u, v):  # type: ignore[no-untyped-def]
    """Return red, green, blue (grey: thrice), alpha at (u, v), 0 ≤ colour ≤ alpha ≤ 255."""
    channels = pixels.shape[2]
    column, row = math.floor(u), math.floor(v)
    red = green = blue = alpha = np.float32(0)
    if near[row, column]:
        across, down = keys_weights(u - column), keys_weights(v - row)
        for j in range(4):
            r = g = b = a = np.float32(0)
            line = pixels[row - 1 + j]
            if channels == 4:
                for i in range(4):
                    weight = across[i]
                    r += weight * line[column - 1 + i, 0]
                    g += weight * line[column - 1 + i, 1]
                    b += weight * line[column - 1 + i, 2]
                    a += weight * line[column - 1 + i, 3]
            else:
                for i in range(4):
                    r += across[i] * line[column - 1 + i, 0]
                    a += across[i] * line[column - 1 + i, 1]
            red += down[j] * r
            green += down[j] * g
            blue += down[j] * b
            alpha += down[j] * a
        if channels == 2:
            green = blue = red
        # Where alpha overshoots, the colour follows: a fish of the tank's colour stays invisible.
        alpha, share = (
            max(alpha, np.float32(0)),
            min(np.float32(255) / max(alpha, np.float32(1)), np.float32(1)),
        )
        alpha *= share
        red = min(max(red * share, np.float32(0)), alpha)
        green = min(max(green * share, np.float32(0)), alpha)
        blue = min(max(blue * share, np.float32(0)), alpha)
    return red, green, blue, alpha


@leaf_kernel
def _span(m, y, shape, ends):  # type: ignore[no-untyped-def]
    """Return the half-open range of x, within `ends`, where the kernel can read for row y."""
    start, stop = ends
    for slope, offset, most in (
        (m[0], m[1] * y + m[2], shape[1] - 2), (m[3], m[4] * y + m[5], shape[0] - 2),
    ):  # fmt: skip
        if abs(slope) < 1e-9:
            if not 1 <= offset < most:
                return 0, 0
            continue
        low, high = (1 - offset) / slope, (most - offset) / slope
        if slope < 0:
            low, high = high, low
        start, stop = max(start, math.ceil(low - 1e-6)), min(stop, math.floor(high + 1e-6) + 1)
    return start, stop


@leaf_kernel
def _locate_pixel(m, x, y, shape):  # type: ignore[no-untyped-def]
    """Return where (x, y) lies in a picture, (u, v), and whether the kernel can read around it."""
    u, v = m[0] * x + m[1] * y + m[2], m[3] * x + m[4] * y + m[5]
    return u, v, 1 <= u < shape[1] - 2 and 1 <= v < shape[0] - 2


@kernel
def lay(canvas, box, fish, partner, share):  # type: ignore[no-untyped-def]
    """Lay (1 − share) fish + share partner, both a `Layer`, over the canvas, in place.

    canvas: (H, W, 1 or 3) uint8; box: top, left, bottom, right of what is drawn; share: 0 … 1.
    """
    top, left, bottom, right = box
    # Unpacked here: within the loop every access to a tuple would count its references.
    pixels, near, m = fish
    other, other_near, n = partner
    shape, other_shape = near.shape, other_near.shape
    keep, share = np.float32(1 - share), np.float32(share)
    for y in range(top, bottom):
        start, stop = _span(m, y, shape, (left, right)) if keep > 0 else (right, left)
        if share > 0:
            first, last = _span(n, y, other_shape, (left, right))
            if first < last:
                start, stop = min(start, first), max(stop, last)
        for x in range(start, stop):
            red = green = blue = alpha = np.float32(0)
            u, v, seen = _locate_pixel(m, x, y, shape)
            if keep > 0 and seen:
                r, g, b, a = _sample(pixels, near, u, v)
                red, green, blue, alpha = keep * r, keep * g, keep * b, keep * a
            if share > 0:
                u, v, seen = _locate_pixel(n, x, y, other_shape)
                if seen:
                    r, g, b, a = _sample(other, other_near, u, v)
                    red += share * r
                    green += share * g
                    blue += share * b
                    alpha += share * a
            if alpha > 0:
                through = 1 - alpha / np.float32(255)
                pixel = canvas[y, x]
                pixel[0] = np.uint8(red + through * pixel[0] + np.float32(0.5))
                if canvas.shape[2] == 3:
                    pixel[1] = np.uint8(green + through * pixel[1] + np.float32(0.5))
                    pixel[2] = np.uint8(blue + through * pixel[2] + np.float32(0.5))


@kernel
def lay_pixels(canvas, drawn):  # type: ignore[no-untyped-def]
    """Lay a premultiplied picture (h, w, 2 or 4), 0 … 1, over a canvas (h, w, 1 or 3) uint8."""
    height, width, channels = drawn.shape
    for y in range(height):
        for x in range(width):
            alpha = drawn[y, x, channels - 1]
            if alpha > 0:
                through = np.float32(1) - alpha
                for c in range(canvas.shape[2]):
                    level = np.float32(255) * drawn[y, x, min(c, channels - 2)]
                    canvas[y, x, c] = np.uint8(level + through * canvas[y, x, c] + np.float32(0.5))
