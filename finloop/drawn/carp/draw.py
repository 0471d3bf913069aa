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
    tangent = np.vstack([step[:1], step[:-1] + step[1:], step[-1:]])
    return tangent / np.linalg.norm(tangent, axis=1, keepdims=True)


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
    margin = 0.30 * length if max(fins) > 0.02 else 0.13 * length  # open fins reach farther
    x0, y0 = np.floor(line.min(axis=0) - margin - 2).astype(int)
    x1, y1 = np.ceil(line.max(axis=0) + margin + 3).astype(int)
    rows, columns = (y1 - y0) * oversample, (x1 - x0) * oversample
    # Subpixel i of pixel p lies at p + (i + 0.5) / oversample - 0.5.
    fine_line = (line - (x0, y0) + 0.5) * oversample - 0.5
    unit = length * oversample  # body length in subpixels
    picture = np.zeros((rows, columns, 4), np.float32)
    cover = np.zeros((rows, columns), np.float32)
    _draw_fins(picture, cover, fine_line, unit, fins, look)
    # The distance transform is a few per cent off, so reach a little farther than the outline.
    reach = 1.08 * half_width(np.linspace(0, 1, len(line))) * look.girth * unit + 2 * oversample
    body = _find_body_pixels(fine_line, rows, columns, reach.astype(np.float32), look.girth, unit)
    colour = _shade_body(body, look, light, gloss)
    body_opacity = colour[:, 3] * body.part
    pixels, pixel_cover = picture.reshape(-1, 4), cover.reshape(-1)
    painted = pixels[body.flat] * (1 - body_opacity)[:, None]
    painted[:, :3] += colour[:, :3] * body_opacity[:, None]
    painted[:, 3] += body_opacity
    pixels[body.flat] = painted
    pixel_cover[body.flat] = np.maximum(pixel_cover[body.flat], body.part)
    size = (int(x1 - x0), int(y1 - y0))
    picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.float32)
    cover = np.asarray(cv2.resize(cover, size, interpolation=cv2.INTER_AREA), np.float32)
    colour, opacity = picture[..., :3], picture[..., 3]
    return CarpPicture(int(x0), int(y0), colour=colour, opacity=opacity, coverage=cover)


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
    for root, root_share, size, breadth, closed_angle, open_angle in (PECTORAL, PELVIC):
        place = root * (len(line) - 1)  # on the midline, in its steps
        i = int(place)
        node = line[i] + (place - i) * (line[i + 1] - line[i])
        forward = tangent[i]
        width = float(half_width(np.array([root]))[0]) * look.girth
        for sign, opening in ((1, fins[0]), (-1, fins[1])):  # the left fin, the right one
            if opening > 0.02:  # a closed fin is hidden under the body
                outwards = sign * np.array([forward[1], -forward[0]])
                angle = closed_angle + (open_angle - closed_angle) * opening
                along = -forward * np.cos(angle) + outwards * np.sin(angle)
                towards_edge = forward * np.sin(angle) + outwards * np.cos(angle)
                _paint_fin(
                    picture, cover, look.fin,
                    root=node + outwards * width * root_share * unit,
                    along=along * size * unit,
                    lead=towards_edge * size * breadth * (0.45 + 0.55 * opening) * unit,
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
    foot of the perpendicular. line (k, 2): midline in subpixels; reach (k,): farthest subpixels
    from it that are tried; girth: width relative to the standard fish; unit: body length in
    subpixels.
    """
    last = len(line) - 1
    # Places along the midline, in its steps, so dense that they touch each of its pixels.
    places = np.linspace(0, last, max(8 * last, int(4 * np.ptp(line, axis=0).sum())))
    column, row = (
        np.rint(np.interp(places, np.arange(last + 1), line[:, axis])).astype(int)
        for axis in range(2)
    )
    is_off_midline = np.ones((rows, columns), np.uint8)
    is_off_midline[row, column] = 0
    distance, labels = cv2.distanceTransformWithLabels(
        is_off_midline, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    place_of_label = np.zeros(int(labels.max()) + 1, np.float32)
    place_of_label[labels[row, column]] = places
    index = np.flatnonzero(distance < reach.max())
    midline_place = place_of_label[labels.reshape(-1)[index]]
    in_reach = distance.reshape(-1)[index] < reach[np.rint(midline_place).astype(np.int32)]
    index, midline_place = index[in_reach], midline_place[in_reach]
    py, px = (number.astype(np.float32) for number in np.divmod(index, columns))
    # Place and tangent at each midline point; `slope` is their change from point to point.
    node = np.hstack([line, _tangents_to_head(line)]).astype(np.float32)
    length = np.float32(np.linalg.norm(np.diff(line, axis=0), axis=1).mean())
    slope = np.diff(node, axis=0)
    for _ in range(3):
        i = np.clip(midline_place.astype(np.int32), 0, last - 1)
        part = midline_place - i
        start, change = node[i], slope[i]
        inner = np.clip(part, 0, 1)
        tx, ty = start[:, 2] + inner * change[:, 2], start[:, 3] + inner * change[:, 3]
        dx = px - start[:, 0] - part * change[:, 0]
        dy = py - start[:, 1] - part * change[:, 1]
        midline_place = np.clip(midline_place - (dx * tx + dy * ty) / length, -3, last + 3)
    v = dx * ty - dy * tx  # the left of the tangent (tx, ty) is (ty, -tx), as y points down
    s, v = midline_place / np.float32(last), v / np.float32(unit)
    grid, squared, squared_slope = width_table()
    w2 = np.interp(s, grid, squared).astype(np.float32) * girth**2
    dw2 = np.interp(s, grid, squared_slope).astype(np.float32) * girth**2
    # Signed distance to the outline w(s)^2 - v^2 = 0, to first order.
    edge_distance = (w2 - v * v) / np.sqrt(dw2 * dw2 + 4 * v * v + 1e-12)
    part = np.clip(edge_distance * np.float32(unit) + 0.5, 0, 1)
    keep = part > 0
    return _BodyPixels(
        index[keep], s[keep], v[keep], left_x=ty[keep], part=part[keep], width2=w2[keep]
    )


def _shade_body(
    body: _BodyPixels, look: FishColours, light: tuple[float, float], gloss: float
) -> Image:
    """Return the colours of the body's subpixels in the light, (n, 4).

    look: colours of the fish; light: unit vector on the screen towards the light; gloss: grey
    levels that the wet back reflects. The colours are RGB and opacity.
    """
    rows, columns = look.skin.shape[:2]
    row_length = 128  # cv2.remap takes a picture with sides up to 32767
    missing = -len(body.s) % row_length
    x = np.pad(body.s * columns - 0.5, (0, missing)).reshape(-1, row_length).astype(np.float32)
    y = (0.5 - body.v / np.float32(look.girth) / (2 * SKIN_HALF)) * rows - 0.5
    y = np.pad(y, (0, missing)).reshape(-1, row_length).astype(np.float32)
    colour = cv2.remap(look.skin, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    colour = np.asarray(colour.reshape(-1, 4)[: len(body.s)])
    across = body.v / np.sqrt(np.maximum(body.width2, 1e-6))
    left_x = body.left_x
    lit = light[0] * left_x + light[1] * -np.sqrt(np.clip(1 - left_x**2, 0, 1))
    colour[:, :3] *= (1 + 0.20 * np.clip(across, -1, 1) * lit)[:, None]
    # The wet back shines where it faces the light, most where the body is thick.
    shine = np.exp(-(((across - 0.38 * lit) / 0.20) ** 2)) * np.clip(body.width2 / 0.0081, 0, 1)
    colour[:, :3] += (gloss * shine)[:, None]
    return colour


def _paint_fin(
    picture: Image, cover: Image, fin: Image, root: Floats, along: Floats, lead: Floats
) -> None:
    """Paint a fin into a picture (h, w, 4) and its coverage (h, w), which are changed.

    fin: premultiplied picture and coverage; root (2,): where it begins, subpixels; along, lead
    (2,): its length and half its breadth as vectors.
    """
    side = fin.shape[0]
    # Fin picture (column, row) -> drawing: root + along * c + lead * -(2 r - 1) * FIN_HALF.
    linear = np.column_stack([along / side, -2 * FIN_HALF * lead / side])
    shift = root + lead * FIN_HALF + linear @ np.array([0.5, 0.5])
    corners = np.array([[0, 0], [side, 0], [0, side], [side, side]]) @ linear.T + shift
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 1, cover.shape[::-1])
    matrix = np.column_stack([linear, shift - low])
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    window = np.s_[low[1] : high[1], low[0] : high[0]]
    painted = cv2.warpAffine(np.ascontiguousarray(fin[..., :4]), matrix, size)
    picture[window] = painted + picture[window] * (1 - painted[..., 3:4])
    fin_cover = cv2.warpAffine(np.ascontiguousarray(fin[..., 4]), matrix, size)
    cover[window] = np.maximum(cover[window], fin_cover)


def blur_drawing(drawing: CarpPicture, sigma_px: float = BLUR_PX) -> tuple[Image, Image]:
    """Blur a fish as the lens does: return colour (rows, columns, 3) and opacity (rows, columns).

    The colour is premultiplied RGB; sigma_px: SD of the blur.
    """
    return (
        np.asarray(cv2.GaussianBlur(drawing.colour, (0, 0), sigma_px), np.float32),
        np.asarray(cv2.GaussianBlur(drawing.opacity, (0, 0), sigma_px), np.float32),
    )
