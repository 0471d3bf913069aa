"""The painter: pictures of a fish laid over the empty tank, turned, scaled and cross-faded.

It draws what an edit list names (fish paper Figs. 16, 18). Everything is premultiplied by alpha and
stays in floating point until the canvas, so that a pixel is rounded once:

    F = (1 − w) A + w B        the cross-fade of two pictures A, B, w the partner's share
    canvas = g F + (1 − alpha of F) · (canvas + g S − T)

S is the still tank, T its picture at this tick, and g their ratio around the fish: of a still tank
T = S and g = 1. So beneath a cut-out, which has its own film's grain, a living tank stands still,
and the fish is as bright as the tank beside it.

A and B are sampled with the cubic kernel of Keys (a = −1/2), which reproduces every polynomial up
to the second degree: a shift by a part of a pixel moves the mass centre by exactly that part, and
no shift at all changes nothing. Its overshoots are clipped: 0 ≤ colour ≤ alpha ≤ 255, so that no
fringe shines at the outline and nothing overflows. The kernel smooths, so a film's picture is
sharpened by as much (`sharpen_picture`), unless it is drawn pixel on pixel: then it stays as it is.

The puppet draws a fish in another pose than the filmed one, its partner in the same pose: then the
partner's skin gives way from the tail on, its outline at once (`finloop.puppet.drawing`). Of
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
from finloop.base.sampling import keys_cubic_weights, sharpen_for_interpolation
from finloop.puppet import PlacedBackbone, PosedPicture, change_in_pose
from finloop.render.living import LivingTank

Image = NDArray[np.uint8]
_PAD = 3  # transparent pixels around a picture: what the kernel reads beyond it
_WHOLE_PX = 1e-3  # off a whole pixel, a picture counts as drawn pixel on pixel


class Box(NamedTuple):
    """A rectangle of the canvas in px, without its right and bottom edge.

    It is empty where bottom ≤ top or right ≤ left.
    """

    top: int
    left: int
    bottom: int
    right: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Return the slices of rows and columns that select the box in an array."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def is_empty(self) -> bool:
        """Return whether the box contains no pixel."""
        return self.bottom <= self.top or self.right <= self.left

    def clip_to(self, shape: tuple[int, ...]) -> "Box":
        """Return the part of the box that lies on a canvas of a shape (height, width …)."""
        top, bottom = (min(max(edge, 0), shape[0]) for edge in (self.top, self.bottom))
        left, right = (min(max(edge, 0), shape[1]) for edge in (self.left, self.right))
        return Box(top, left, bottom, right)

    def grow(self, rim: int) -> "Box":
        """Return the box enlarged by `rim` px on every side."""
        return Box(self.top - rim, self.left - rim, self.bottom + rim, self.right + rim)

    def intersect(self, other: "Box") -> "Box":
        """Return the box that this and another box share; it may be empty."""
        return Box(
            max(self.top, other.top), max(self.left, other.left),
            min(self.bottom, other.bottom), min(self.right, other.right),
        )  # fmt: skip

    @classmethod
    def enclose(cls, boxes: Iterable["Box"]) -> "Box":
        """Return the smallest box that holds all the given boxes."""
        tops, lefts, bottoms, rights = zip(*boxes, strict=True)
        return cls(min(tops), min(lefts), max(bottoms), max(rights))


class PaddedPicture(NamedTuple):
    """A cut-out to draw: pixels (h, w, 2 or 4) with a transparent rim, premultiplied.

    filmed: as it was filmed, uint8; pixels: what turning and bending interpolate, float32. near:
    (h, w) uint8, 0 where all 4 × 4 pixels that the cubic kernel reads around are transparent. x_px,
    y_px: its mass centre, in its own pixels. Made by `pad_picture`.
    """

    filmed: Image
    pixels: NDArray[np.float32]
    near: Image
    x_px: float
    y_px: float


class PictureLayer(NamedTuple):
    """A picture to draw (see `PaddedPicture`), and the affine map from the canvas to its pixels.

    The canvas shows its pixel (u, v) at (x, y): u = m0 x + m1 y + m2, v = m3 x + m4 y + m5.
    """

    pixels: NDArray[np.float32]
    near: Image
    m: tuple[float, float, float, float, float, float]


class TankBelow(NamedTuple):
    """The tank that a fish is drawn on: still, at this tick, and how much brighter it is then.

    still, shown: (h, w, 1 or as the canvas) uint8; gain (channels of the canvas,) float32: mean of
    `shown` divided by that of `still`; 1 where the tank stands still.
    """

    still: Image
    shown: Image
    gain: NDArray[np.float32]


class TurnedPicture(NamedTuple):
    """A picture to draw turned anticlockwise and scaled, both about its mass centre."""

    picture: PaddedPicture
    rotation_deg: float = 0.0
    scale: float = 1.0

    def box_at(self, x_px: float, y_px: float) -> Box:
        """Return the box that the picture can cover with its mass centre at (x_px, y_px)."""
        cos, sin = (part * self.scale for part in self._cos_and_sin())
        height, width = self.picture.pixels.shape[:2]
        rim = _PAD - 2  # outermost pixels in which no kernel can see the cut-out
        us = [edge - self.picture.x_px for edge in (rim, width - 1 - rim)]
        vs = [edge - self.picture.y_px for edge in (rim, height - 1 - rim)]
        xs = [x_px + cos * u + sin * v for u in us for v in vs]  # of the four turned corners
        ys = [y_px - sin * u + cos * v for u in us for v in vs]
        return Box(
            math.ceil(min(ys)), math.ceil(min(xs)), math.floor(max(ys)) + 1, math.floor(max(xs)) + 1
        )

    def layer_at(self, x_px: float, y_px: float) -> PictureLayer:
        """Return the layer that draws the picture with its mass centre at (x_px, y_px)."""
        cos, sin = (part / self.scale for part in self._cos_and_sin())
        filmed, pixels, near, centre_u, centre_v = self.picture
        u_offset = centre_u - cos * x_px + sin * y_px
        v_offset = centre_v - sin * x_px - cos * y_px
        if cos == 1 and max(abs(part - round(part)) for part in (u_offset, v_offset)) < _WHOLE_PX:
            pixels = filmed.astype(np.float32)
        return PictureLayer(pixels, near, (cos, -sin, u_offset, sin, cos, v_offset))

    def _cos_and_sin(self) -> tuple[float, float]:
        """Return cosine and sine of the rotation; exactly 1 and 0 for whole turns."""
        angle = math.radians(math.remainder(self.rotation_deg, 360.0))
        return math.cos(angle), math.sin(angle)


class BentPicture(NamedTuple):
    """A picture to draw in another posture (`finloop.puppet.pose`).

    source: the animal's backbone in the picture's pixels; posture: the one to draw; heading_rad,
    size_px: of the drawn animal; mirrored: whether left is drawn as right.
    """

    picture: PaddedPicture
    source: PlacedBackbone
    posture: Floats
    heading_rad: float
    size_px: float
    mirrored: bool

    def pose_at(self, x_px: float, y_px: float) -> PosedPicture:
        """Return the picture bent into its posture, with its mass centre at (x_px, y_px)."""
        target = PlacedBackbone(x_px, y_px, self.heading_rad, self.size_px, self.posture)
        return PosedPicture(self.picture.pixels, self.source, target, self.mirrored)

    def box_at(self, x_px: float, y_px: float) -> Box:
        """Return the box that the picture can cover with its mass centre at (x_px, y_px)."""
        return Box(*self.pose_at(x_px, y_px).box)


def pad_picture(pixels: Image, x_px: float, y_px: float) -> PaddedPicture:
    """Return a cut-out (h, w, 2 or 4) uint8 with a transparent rim, as drawing needs it.

    x_px, y_px: its mass centre, px of the cut-out.
    """
    rim = (_PAD, _PAD)
    padded = np.pad(pixels, (rim, rim, (0, 0)))
    alpha = np.ascontiguousarray(padded[..., -1])
    # The cubic kernel reads pixels −1, 0, 1, 2 from the one at its place.
    near = cv2.dilate(alpha, np.ones((4, 4), np.uint8), anchor=(1, 1))
    return PaddedPicture(padded, padded.astype(np.float32), near, x_px + _PAD, y_px + _PAD)


def sharpen_picture(picture: PaddedPicture) -> PaddedPicture:
    """Return a picture that stays as sharp as filmed in the mean, however it is turned and placed.

    Transparent pixels stay transparent, and opaque ones opaque.
    """
    alpha, pixels = picture.filmed[..., -1:], sharpen_for_interpolation(picture.filmed)
    pixels *= np.where(alpha == 255, 255 / np.maximum(pixels[..., -1:], 1), alpha > 0)
    return picture._replace(pixels=pixels)


class PlacedFish(NamedTuple):
    """A fish to draw and its mass centre on the canvas; its fields are arguments of `Painter.draw`.

    partner: the picture that is cross-faded into it with the share `weight` (0 … 1), or None.
    """

    x_px: float
    y_px: float
    fish: TurnedPicture | BentPicture
    partner: TurnedPicture | BentPicture | None
    weight: float

    @property
    def box(self) -> Box:
        """Return the box of the canvas that the fish's picture and its partner can cover."""
        pictures = [self.fish]
        if self.partner is not None and self.weight:
            pictures.append(self.partner)
        return Box.enclose(picture.box_at(self.x_px, self.y_px) for picture in pictures)


class Shadow(NamedTuple):
    """A fish's shadow on fish below it: `share` of the light taken, `blur_px`: SD of the blur."""

    share: float
    blur_px: float


NO_SHADOW = Shadow(0.0, 1.0)


class Painter:
    """A canvas on which fish are drawn tick after tick; it restores only what was drawn on.

    floor: (H, W, 1 or 3) uint8, the canvas without fish; callers that draw on it report where with
    `mark_changed`. canvas: the floor with fish; that of a living tank has another floor, and
    another light, at every tick.
    """

    def __init__(
        self, background: Image, colour: bool = False, shadow: Shadow = NO_SHADOW,
        tank: LivingTank | None = None,
    ) -> None:  # fmt: skip
        """Begin with the empty tank, (H, W) or (H, W, 3); `colour` makes a grey one RGB.

        tank: how the tank lives; None: it stands still.
        """
        floor = background if background.ndim == 3 else background[..., None]
        if colour and floor.shape[2] == 1:
            floor = floor.repeat(3, axis=2)
        self.floor = np.array(floor, order="C")
        self.canvas = self.floor.copy()
        self._shown = self.floor  # the tank at this tick
        self._shadow, self._touched, self._tank = shadow, list[Box](), tank

    @property
    def frame(self) -> Image:
        """Return the canvas as a view (H, W) or (H, W, 3)."""
        return self.canvas if self.canvas.shape[2] == 3 else self.canvas[..., 0]

    def mark_changed(self, box: Box) -> None:
        """Note that a box of the canvas is drawn on, so that `wipe` restores it."""
        if not box.is_empty:
            self._touched.append(box)

    def wipe(self, tick: int = 0) -> None:
        """Restore the floor where the canvas was changed; in a living tank draw that of a tick."""
        if self._tank is None:
            for box in self._touched:
                self.canvas[box.slices] = self.floor[box.slices]
        else:
            picture = self._tank.picture_at(tick)
            if picture.ndim == 2 and self.canvas.shape[2] == 3:
                cv2.cvtColor(picture, cv2.COLOR_GRAY2RGB, dst=self.canvas)
            else:
                np.copyto(self.canvas, picture.reshape(self.canvas.shape))
            self._shown = picture.reshape(*picture.shape[:2], -1)
        self._touched.clear()

    def show(self, *fish: PlacedFish, tick: int = 0) -> Box:
        """Draw fish on the clean floor, in the given order; return the box that they cover.

        fish: one or more, from the lowest to the highest; each casts its shadow on those below.
        tick: of the animation, for a living tank.
        """
        self.wipe(tick)
        boxes: list[Box] = []
        for number, placed in enumerate(fish):
            if self._shadow.share and number:
                self._draw_shadow(placed, fish[:number])
            boxes.append(self.draw(*placed))
        if self._tank is not None:
            self._tank.light_up(self.canvas, tick)
        return Box.enclose([box for box in boxes if not box.is_empty] or boxes)

    def _draw_shadow(self, upper: PlacedFish, lower: Sequence[PlacedFish]) -> None:
        """Draw the shadow of a fish on the fish below it; the more it covers them, the darker."""
        upper_box, (share, blur_px) = upper.box, self._shadow
        lower = [fish for fish in lower if not fish.box.intersect(upper_box).is_empty]
        box = upper_box.grow(math.ceil(3 * blur_px)).clip_to(self.canvas.shape)
        if not lower or box.is_empty:
            return
        upper_alpha = self._coverage(upper, box)
        off_lower = np.ones_like(upper_alpha)  # the share of each pixel that is on no lower fish
        for fish in lower:
            alpha = self._coverage(fish, box)
            # A fish counts more, up to 1, the larger the area that the upper one surely covers, in
            # areas of the Gaussian blur.
            common_px2 = np.maximum(0, upper_alpha + alpha - 1).sum()
            off_lower *= 1 - min(1.0, common_px2 / (2 * np.pi * blur_px**2)) * alpha
        if off_lower.min() == 1:
            return
        shade = cv2.GaussianBlur(upper_alpha, (0, 0), blur_px) * (1 - off_lower)
        light = 1 - share * shade[..., None]
        self.canvas[box.slices] = np.rint(self.canvas[box.slices] * light).astype(np.uint8)

    def _coverage(self, fish: PlacedFish, box: Box) -> NDArray[np.float32]:
        """Return the share (0-1) of each pixel of a box that a fish covers, (h, w)."""
        shape = box.bottom - box.top, box.right - box.left, self.canvas.shape[2]
        # By as much as drawings on black and on white differ, the floor is seen through the fish.
        black, white = (Painter(np.full(shape, level, np.uint8)) for level in (0, 255))
        moved = fish._replace(x_px=fish.x_px - box.left, y_px=fish.y_px - box.top)
        for painter in (black, white):
            painter.draw(*moved)
        through = white.canvas.astype(np.float32) - black.canvas
        return np.asarray(1 - through.mean(axis=2) / 255, np.float32)

    def draw(
        self, x_px: float, y_px: float, fish: TurnedPicture | BentPicture,
        partner: TurnedPicture | BentPicture | None = None, weight: float = 0.0,
    ) -> Box:  # fmt: skip
        """Draw a fish with its mass centre at (x_px, y_px) of the canvas; return its box.

        fish: its picture. `partner`, of the same kind, is cross-faded into it with the share
        `weight` (0 … 1). The fish is clipped at the edges. ValueError if it is coloured and the
        canvas grey, or the kinds of picture differ.
        """
        other, share = (partner, weight) if partner is not None else (fish, 0.0)
        channels = max(drawn.picture.pixels.shape[2] for drawn in (fish, other))
        if channels > self.canvas.shape[2] + 1:
            raise ValueError("a coloured fish needs a coloured canvas")
        if isinstance(fish, BentPicture) and isinstance(other, BentPicture):
            box = self._draw_bent(x_px, y_px, fish, other, share)
        elif isinstance(fish, TurnedPicture) and isinstance(other, TurnedPicture):
            box = self._draw_turned(x_px, y_px, fish, other, share)
        else:
            raise ValueError("a fish and its partner are either both drawn in a pose, or neither")
        self.mark_changed(box)
        return box

    def _draw_bent(
        self, x_px: float, y_px: float, fish: BentPicture, other: BentPicture, share: float
    ) -> Box:
        """Draw a bent picture with its mass centre at (x_px, y_px); return its box.

        other: the picture that `fish` replaces, of which the share `share`, 0 … 1, is left.
        """
        pictures = (fish, other) if share else (fish,)
        posed = [picture.pose_at(x_px, y_px) for picture in pictures]
        box = Box.enclose(Box(*picture.box) for picture in posed).clip_to(self.canvas.shape)
        if not box.is_empty:
            pixels = change_in_pose(*posed, share, box) if share else posed[0].draw_part(box)
            draw_pixels(self.canvas[box.slices], pixels, self._find_tank_below(box))
        return box

    def _draw_turned(
        self, x_px: float, y_px: float, fish: TurnedPicture, other: TurnedPicture, share: float
    ) -> Box:
        """Draw a turned picture with its mass centre at (x_px, y_px); return its box.

        other: the picture that `fish` replaces, of which the share `share`, 0 … 1, is left.
        """
        visible = [picture for picture, w in ((fish, 1 - share), (other, share)) if w > 0]
        boxes = (picture.box_at(x_px, y_px) for picture in visible)
        box = Box.enclose(boxes).clip_to(self.canvas.shape)
        if not box.is_empty:
            layers = fish.layer_at(x_px, y_px), other.layer_at(x_px, y_px)
            draw_layers(self.canvas, box, *layers, share, self._find_tank_below(box))
        return box

    def _find_tank_below(self, box: Box) -> TankBelow:
        """Return the tank's pixels in a box with at least one pixel, and its gain there."""
        still, shown = self.floor[box.slices], self._shown[box.slices]
        gain = np.ones(self.canvas.shape[2], np.float32)
        if self._shown is not self.floor:
            for k in range(len(gain)):
                level = cv2.mean(np.ascontiguousarray(shown[..., min(k, shown.shape[2] - 1)]))[0]
                gain[k] = level / max(cv2.mean(np.ascontiguousarray(still[..., k]))[0], 1.0)
        return TankBelow(still, shown, gain)


@leaf_kernel
def _sample_cubically(pixels, near, u, v):  # type: ignore[no-untyped-def]
    """Return the colour at (u, v) by cubic interpolation: red, green, blue, alpha; colour ≤ alpha.

    pixels (h, w, 2 or 4): float32, premultiplied by alpha; near (h, w): 0 where all pixels around
    are transparent, and so is the result; u, v: column and row, parts of a pixel included.
    """
    channels = pixels.shape[2]
    column, row = math.floor(u), math.floor(v)
    red = green = blue = alpha = np.float32(0)
    if near[row, column]:
        across, down = keys_cubic_weights(u - column), keys_cubic_weights(v - row)
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
        alpha = max(alpha, np.float32(0))
        share = min(np.float32(255) / max(alpha, np.float32(1)), np.float32(1))
        alpha *= share
        red = min(max(red * share, np.float32(0)), alpha)
        green = min(max(green * share, np.float32(0)), alpha)
        blue = min(max(blue * share, np.float32(0)), alpha)
    return red, green, blue, alpha


@leaf_kernel
def _locate_pixel(m, x, y, shape):  # type: ignore[no-untyped-def]
    """Return where canvas pixel (x, y) lies in a picture, (u, v), and whether it can be sampled.

    It can if the pixels −1, 0, 1 and 2 from (u, v) on, which the cubic kernel reads, lie in the
    picture. m: the map from the canvas to the picture, see `PictureLayer`; shape: height and width
    of the picture.
    """
    u, v = m[0] * x + m[1] * y + m[2], m[3] * x + m[4] * y + m[5]
    return u, v, 1 <= u < shape[1] - 2 and 1 <= v < shape[0] - 2


@leaf_kernel
def _blend_pixel(pixel, k, level, alpha, still, shown, gain):  # type: ignore[no-untyped-def]
    """Draw a fish's level and alpha, 0 … 255, over channel k of a canvas's pixel, which changes.

    pixel (channels,); still, shown (1 or channels,): the tank's pixel there; gain: of the channel,
    all as in `TankBelow`.
    """
    through = 1 - alpha / np.float32(255)
    below = np.float32(pixel[k]) - np.float32(shown[min(k, len(shown) - 1)])
    below += gain * np.float32(still[k])
    result = gain * level + through * below + np.float32(0.5)
    pixel[k] = np.uint8(min(max(result, np.float32(0)), np.float32(255)))


@kernel
def draw_layers(canvas, box, fish, partner, share, tank):  # type: ignore[no-untyped-def]
    """Cross-fade two pictures over the canvas, which changes: (1 − share) fish + share partner.

    canvas: (H, W, 1 or 3) uint8; box: a `Box`; fish, partner: a `PictureLayer` each; share: 0 … 1;
    tank: the tank in the box.
    """
    # Unpacked here: within the loop every access to a tuple would count its references.
    pixels, near, m = fish
    other, other_near, n = partner
    still, shown, gain = tank
    shape, other_shape = near.shape, other_near.shape
    fish_share, share = np.float32(1 - share), np.float32(share)
    for y in range(box.top, box.bottom):
        for x in range(box.left, box.right):
            red = green = blue = alpha = np.float32(0)
            u, v, is_inside = _locate_pixel(m, x, y, shape)
            if fish_share > 0 and is_inside:
                r, g, b, a = _sample_cubically(pixels, near, u, v)
                red, green = fish_share * r, fish_share * g
                blue, alpha = fish_share * b, fish_share * a
            u, v, is_inside = _locate_pixel(n, x, y, other_shape)
            if share > 0 and is_inside:
                r, g, b, a = _sample_cubically(other, other_near, u, v)
                red += share * r
                green += share * g
                blue += share * b
                alpha += share * a
            if alpha > 0:
                empty, alive = still[y - box.top, x - box.left], shown[y - box.top, x - box.left]
                pixel = canvas[y, x]
                _blend_pixel(pixel, 0, red, alpha, empty, alive, gain[0])
                if canvas.shape[2] == 3:
                    _blend_pixel(pixel, 1, green, alpha, empty, alive, gain[1])
                    _blend_pixel(pixel, 2, blue, alpha, empty, alive, gain[2])


@kernel
def draw_pixels(canvas, drawn, tank):  # type: ignore[no-untyped-def]
    """Draw a picture (h, w, 2 or 4), 0 … 1, over a canvas (h, w, 1 or 3), which is changed.

    drawn: premultiplied by alpha, its last channel; grey is drawn in all channels of a canvas.
    tank: the tank beneath, of the canvas's size.
    """
    still, shown, gain = tank
    height, width, channels = canvas.shape
    opacity = drawn.shape[2] - 1
    for y in range(height):
        for x in range(width):
            alpha = drawn[y, x, opacity]
            if alpha > 0:  # an empty pixel keeps its value
                for k in range(channels):
                    level = np.float32(255) * drawn[y, x, min(k, opacity - 1)]
                    _blend_pixel(
                        canvas[y, x], k, level, np.float32(255) * alpha, still[y, x], shown[y, x],
                        gain[k],
                    )  # fmt: skip
