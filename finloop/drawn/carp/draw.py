"""Drawing one carp in one pose: exact coverage, colours, shadow. Pure functions over arrays."""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.drawn.carp.skin import FIN_HALF, SKIN_HALF, FishColours, Image, half_width, width_table

OVERSAMPLE = 3
BLUR_PX = 0.6  # blur of the lens
GLOSS = 20.0  # grey levels that the wet back reflects

# Root of a fin (s, share of the half width), length and breadth (body lengths), angle to the tail's
# direction when closed and when open (radians).
PECTORAL = (0.235, 0.78, 0.195, 1.05, 0.10, 1.12)
PELVIC = (0.50, 0.70, 0.095, 0.90, 0.05, 0.72)


@dataclass(frozen=True)
class CarpPicture:
    """A sharp picture of one carp; its first pixel is at (x0, y0) of the film's picture."""

    x0: int
    y0: int
    colour: Image  # (rows, columns, 3) premultiplied RGB
    opacity: Image  # (rows, columns) 0-1
    coverage: Image  # (rows, columns) share of each pixel inside the silhouette of body and fins

    def area_px(self) -> float:
        """Return the area of the silhouette of body and fins, px²."""
        return float(self.coverage.sum(dtype=np.float64))

    def centre_px(self) -> tuple[float, float]:
        """Return the mass centre of the silhouette: x and y in the film's picture, px."""
        area = self.area_px()
        across = self.coverage.sum(axis=0, dtype=np.float64)
        down = self.coverage.sum(axis=1, dtype=np.float64)
        return (
            self.x0 + float(across @ np.arange(len(across))) / area,
            self.y0 + float(down @ np.arange(len(down))) / area,
        )


def _tangents_to_head(line: Floats) -> Floats:
    """Return the unit tangents (n, 2) of a midline (n, 2), pointing towards its start, the head."""
    step = line[:-1] - line[1:]
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    at = np.vstack([step[:1], step[:-1] + step[1:], step[-1:]])
    return at / np.linalg.norm(at, axis=1, keepdims=True)


def draw_carp(
    line: Floats,
    fins: tuple[float, float],
    look: FishColours,
    light: tuple[float, float] = (-0.6, -0.8),
    oversample: int = OVERSAMPLE,
    gloss: float = GLOSS,
) -> CarpPicture:
    """Draw a carp along its midline; return its picture with opacity and coverage.

    line (65, 2): px, head to tail, equal arc length; fins: how far the left and right pectoral fins
    are open, 0-1; look: colours of the fish; light: unit vector on the screen towards the light,
    which shades the flanks; oversample: subpixels per pixel in each direction; gloss: grey levels
    that the wet back reflects.
    """
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    pad = 0.30 * length if max(fins) > 0.02 else 0.13 * length
    x0, y0 = np.floor(line.min(axis=0) - pad - 2).astype(int)
    x1, y1 = np.ceil(line.max(axis=0) + pad + 3).astype(int)
    rows, columns = (y1 - y0) * oversample, (x1 - x0) * oversample
    # Subpixel i of pixel p lies at p + (i + 0.5) / oversample - 0.5.
    fine = (line - (x0, y0) + 0.5) * oversample - 0.5
    unit = length * oversample
    picture = np.zeros((rows, columns, 4), np.float32)
    cover = np.zeros((rows, columns), np.float32)
    _draw_fins(picture, cover, fine, unit, fins, look)
    # The distance transform is a few per cent off, so reach a little farther than the outline.
    reach = 1.08 * half_width(np.linspace(0, 1, len(line))) * look.girth * unit + 2 * oversample
    body = _find_body_pixels(fine, rows, columns, reach.astype(np.float32), look.girth, unit)
    colour = _shade_body(body, look, light, gloss)
    opacity = colour[:, 3] * body.part
    flat, flat_cover = picture.reshape(-1, 4), cover.reshape(-1)
    under = flat[body.flat] * (1 - opacity)[:, None]
    under[:, :3] += colour[:, :3] * opacity[:, None]
    under[:, 3] += opacity
    flat[body.flat] = under
    flat_cover[body.flat] = np.maximum(flat_cover[body.flat], body.part)
    size = (int(x1 - x0), int(y1 - y0))
    picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.float32)
    cover = np.asarray(cv2.resize(cover, size, interpolation=cv2.INTER_AREA), np.float32)
    return CarpPicture(int(x0), int(y0), picture[..., :3], picture[..., 3], cover)


def _draw_fins(
    picture: Image,
    cover: Image,
    line: Floats,
    unit: float,
    fins: tuple[float, float],
    look: FishColours,
) -> None:
    """Draw the paired fins into a picture (h, w, 4) and its coverage (h, w), which are changed.

    line (65, 2): midline in subpixels; unit: body length in subpixels; fins: how far the left and
    right ones are open, 0-1; look: colours of the fish.
    """
    tangent = _tangents_to_head(line)
    for root, side, size, breadth, closed, opened in (PECTORAL, PELVIC):
        for sign, open_ in ((1, fins[0]), (-1, fins[1])):
            if open_ > 0.02:
                at = root * (len(line) - 1)
                i = int(at)
                node = line[i] + (at - i) * (line[i + 1] - line[i])
                t = tangent[i]
                left = np.array([t[1], -t[0]])
                width = float(half_width(np.array([root]))[0]) * look.girth
                angle = closed + (opened - closed) * open_
                along = -t * np.cos(angle) + sign * left * np.sin(angle)
                lead = t * np.sin(angle) + sign * left * np.cos(angle)
                _paint_fin(
                    picture, cover, look.fin,
                    node + sign * left * width * side * unit,
                    along * size * unit,
                    lead * size * breadth * (0.45 + 0.55 * open_) * unit,
                )  # fmt: skip


class _BodyPixels(NamedTuple):
    """The n subpixels of a picture that the body covers, (n,) each.

    flat: index in the flattened picture; s, v: body coordinates; left_x: x of the unit vector to
    the fish's left; part: covered share of the subpixel; width2: squared half width at s.
    """

    flat: NDArray[np.intp]
    s: Image
    v: Image
    left_x: Image
    part: Image
    width2: Image


def _find_body_pixels(
    line: Floats, rows: int, columns: int, reach: Image, girth: float, unit: float
) -> _BodyPixels:
    """Find the subpixels of a picture (rows, columns) that the body about a midline covers.

    A distance transform gives the nearest midline pixel; three fixed-point steps turn it into the
    foot of the perpendicular. Only pixels within `reach` of the midline (one value for each point)
    count. girth: width relative to the standard fish; unit: body length in subpixels.
    """
    last = len(line) - 1
    fine = np.linspace(0, last, max(8 * last, int(4 * np.ptp(line, axis=0).sum())))
    nodes = np.arange(last + 1)
    fx, fy = np.interp(fine, nodes, line[:, 0]), np.interp(fine, nodes, line[:, 1])
    ix, iy = np.rint(fx).astype(int), np.rint(fy).astype(int)
    seeds = np.ones((rows, columns), np.uint8)
    seeds[iy, ix] = 0
    far, labels = cv2.distanceTransformWithLabels(
        seeds, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    guess = np.zeros(int(labels.max()) + 1, np.float32)
    guess[labels[iy, ix]] = fine
    index = np.flatnonzero(far < reach.max())
    q = guess[labels.reshape(-1)[index]]
    near = far.reshape(-1)[index] < reach[np.rint(q).astype(np.int32)]
    index, q = index[near], q[near]
    py, px = np.divmod(index, columns)
    px, py = px.astype(np.float32), py.astype(np.float32)

    node = np.hstack([line, _tangents_to_head(line)]).astype(np.float32)
    length = np.float32(np.linalg.norm(np.diff(line, axis=0), axis=1).mean())
    slope = np.diff(node, axis=0)
    for _ in range(3):
        i = np.clip(q.astype(np.int32), 0, last - 1)
        part = q - i
        here, by = node[i], slope[i]
        inner = np.clip(part, 0, 1)
        tx, ty = here[:, 2] + inner * by[:, 2], here[:, 3] + inner * by[:, 3]
        dx = px - here[:, 0] - part * by[:, 0]
        dy = py - here[:, 1] - part * by[:, 1]
        q = np.clip(q - (dx * tx + dy * ty) / length, -3, last + 3)
    v = dx * ty - dy * tx  # the left of the tangent (tx, ty) is (ty, -tx), as y points down
    s, v = q / np.float32(last), v / np.float32(unit)
    grid, squared, steep = width_table()
    w2 = np.interp(s, grid, squared).astype(np.float32) * girth**2
    dw2 = np.interp(s, grid, steep).astype(np.float32) * girth**2
    # Signed distance to the outline w(s)^2 - v^2 = 0, to first order.
    inside = (w2 - v * v) / np.sqrt(dw2 * dw2 + 4 * v * v + 1e-12)
    part = np.clip(inside * np.float32(unit) + 0.5, 0, 1)
    keep = part > 0
    return _BodyPixels(index[keep], s[keep], v[keep], ty[keep], part[keep], w2[keep])


def _shade_body(
    body: _BodyPixels, look: FishColours, light: tuple[float, float], gloss: float
) -> Image:
    """Return the colours of the body's subpixels in the light, (n, 4).

    look: colours of the fish; light, gloss as in `draw_carp`.
    """
    rows, columns = look.skin.shape[:2]
    wide = 128  # cv2.remap takes a picture with sides up to 32767
    short = -len(body.s) % wide
    x = np.pad(body.s * columns - 0.5, (0, short)).reshape(-1, wide).astype(np.float32)
    y = (0.5 - body.v / np.float32(look.girth) / (2 * SKIN_HALF)) * rows - 0.5
    y = np.pad(y, (0, short)).reshape(-1, wide).astype(np.float32)
    colour = cv2.remap(look.skin, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    colour = np.asarray(colour.reshape(-1, 4)[: len(body.s)])
    across = body.v / np.sqrt(np.maximum(body.width2, 1e-6))
    left_x = body.left_x
    lean = light[0] * left_x + light[1] * -np.sqrt(np.clip(1 - left_x**2, 0, 1))
    colour[:, :3] *= (1 + 0.20 * np.clip(across, -1, 1) * lean)[:, None]
    # The wet back shines where it faces the light, most where the body is thick.
    shine = np.exp(-(((across - 0.38 * lean) / 0.20) ** 2)) * np.clip(body.width2 / 0.0081, 0, 1)
    colour[:, :3] += (gloss * shine)[:, None]
    return colour


def _paint_fin(
    picture: Image, cover: Image, fin: Image, root: Floats, along: Floats, lead: Floats
) -> None:
    """Paint a fin into a picture and its coverage, under the parts that are painted later.

    fin: premultiplied picture and coverage; root (2,): where it begins, subpixels; along, lead
    (2,): its length and half its breadth as vectors.
    """
    side = fin.shape[0]
    # Fin picture (column, row) -> drawing: root + along * c + lead * -(2 r - 1) * FIN_HALF.
    to = np.column_stack([along / side, -2 * FIN_HALF * lead / side])
    shift = root + lead * FIN_HALF + to @ np.array([0.5, 0.5])
    corners = np.array([[0, 0], [side, 0], [0, side], [side, side]]) @ to.T + shift
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 1, cover.shape[::-1])
    matrix = np.column_stack([to, shift - low])
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    window = np.s_[low[1] : high[1], low[0] : high[0]]
    new = cv2.warpAffine(np.ascontiguousarray(fin[..., :4]), matrix, size)
    picture[window] = new + picture[window] * (1 - new[..., 3:4])
    reach = cv2.warpAffine(np.ascontiguousarray(fin[..., 4]), matrix, size)
    cover[window] = np.maximum(cover[window], reach)


def blur_drawing(drawing: CarpPicture, sigma_px: float = BLUR_PX) -> tuple[Image, Image]:
    """Blur a fish as the lens does: return colour (rows, columns, 3) and opacity (rows, columns).

    The colour is premultiplied RGB; sigma_px: SD of the blur.
    """
    return (
        np.asarray(cv2.GaussianBlur(drawing.colour, (0, 0), sigma_px), np.float32),
        np.asarray(cv2.GaussianBlur(drawing.opacity, (0, 0), sigma_px), np.float32),
    )
