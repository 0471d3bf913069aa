"""Draw one carp in one pose: colours, opacity, and the exact coverage of every pixel."""

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.drawn.carp.skin import FIN_HALF, SKIN_HALF, FishColours, Image, half_width, width_table

OVERSAMPLE = 3  # subpixels per pixel in each direction
BLUR_PX = 0.6  # SD of the lens's blur
GLOSS = 20.0  # grey levels that the wet back reflects
LIGHT = (-0.6, -0.8)  # unit vector on the screen towards the light: from the upper left


class FinShape(NamedTuple):
    """The shape of a pair of fins: where they begin, how large they are, how far they open.

    s: place of the root along the body, 0 = snout, 1 = tail end; root_share: its distance from the
    midline, as a share of the half width; length: body lengths; breadth: fin lengths; closed_rad,
    open_rad: angle between fin and tail when closed and when open.
    """

    s: float
    root_share: float
    length: float
    breadth: float
    closed_rad: float
    open_rad: float


PECTORAL = FinShape(0.235, 0.78, 0.195, 1.05, 0.10, 1.12)
PELVIC = FinShape(0.50, 0.70, 0.095, 0.90, 0.05, 0.72)


@dataclass(frozen=True)
class CarpPicture:
    """A sharp picture of one carp, and where it lies in the film's picture."""

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
    """Return the unit tangents (n, 2) of a midline (n, 2), which point towards the head."""
    step = line[:-1] - line[1:]
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    tangent = np.vstack([step[:1], step[:-1] + step[1:], step[-1:]])  # inside, of both neighbours
    return tangent / np.linalg.norm(tangent, axis=1, keepdims=True)


def draw_carp(line: Floats, fins: tuple[float, float], colours: FishColours) -> CarpPicture:
    """Return the picture of a carp along a midline, with opacity and coverage.

    line (65, 2): px, head to tail, equal arc length; fins: how far the left and right paired fins
    are open, 0-1; colours: of the fish.
    """
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    margin = 0.30 * length if max(fins) > 0.02 else 0.13 * length  # open fins reach farther
    # The picture's first pixel, and the one after its last; it is painted in subpixels.
    x0, y0 = np.floor(line.min(axis=0) - margin - 2).astype(int)
    x1, y1 = np.ceil(line.max(axis=0) + margin + 3).astype(int)
    rows, columns = (y1 - y0) * OVERSAMPLE, (x1 - x0) * OVERSAMPLE
    # Subpixel i of pixel p lies at p + (i + 0.5) / OVERSAMPLE - 0.5.
    fine_line = (line - (x0, y0) + 0.5) * OVERSAMPLE - 0.5
    length_subpx = length * OVERSAMPLE
    picture = np.zeros((rows, columns, 4), np.float32)
    coverage = np.zeros((rows, columns), np.float32)
    _draw_fins(picture, coverage, fine_line, length_subpx, fins, colours.fin)
    _draw_body(picture, coverage, fine_line, length_subpx, colours.skin)  # over the fins' roots
    # From subpixels to pixels.
    size = (int(x1 - x0), int(y1 - y0))
    picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.float32)
    coverage = np.asarray(cv2.resize(coverage, size, interpolation=cv2.INTER_AREA), np.float32)
    return CarpPicture(
        int(x0), int(y0), colour=picture[..., :3], opacity=picture[..., 3], coverage=coverage
    )


def _draw_fins(
    picture: Image, coverage: Image, line: Floats, length_subpx: float, fins: tuple[float, float],
    fin_picture: Image,
) -> None:  # fmt: skip
    """Draw the paired fins into a picture (h, w, 4) and its coverage (h, w), both changed in place.

    Both are in subpixels. line (65, 2): midline in subpixels, head to tail; length_subpx: of the
    body; fins: how far the left and right ones are open, 0-1; fin_picture: `FishColours.fin`.
    """
    tangent = _tangents_to_head(line)
    for shape in (PECTORAL, PELVIC):
        place = shape.s * (len(line) - 1)  # on the midline, in its steps
        i = int(place)
        middle = line[i] + (place - i) * (line[i + 1] - line[i])
        forward = tangent[i]
        root_offset = float(half_width(np.array([shape.s]))[0]) * shape.root_share * length_subpx
        for sign, opening in ((1, fins[0]), (-1, fins[1])):  # the left fin, the right one
            if opening > 0.02:  # a closed fin is hidden under the body
                outwards = sign * np.array([forward[1], -forward[0]])  # y points down
                angle = shape.closed_rad + (shape.open_rad - shape.closed_rad) * opening
                along = -forward * np.cos(angle) + outwards * np.sin(angle)
                towards_edge = forward * np.sin(angle) + outwards * np.cos(angle)
                spread = 0.45 + 0.55 * opening  # a fin that closes folds like a fan
                fin_length = shape.length * length_subpx
                _paint_fin(
                    picture, coverage, fin_picture,
                    root=middle + outwards * root_offset,
                    along=along * fin_length,
                    half_breadth=towards_edge * fin_length * shape.breadth * spread,
                )  # fmt: skip


def _draw_body(
    picture: Image, coverage: Image, line: Floats, length_subpx: float, skin: Image
) -> None:
    """Draw the body into a picture (h, w, 4) and its coverage (h, w), both changed in place.

    Both are in subpixels. line (65, 2): midline in subpixels, head to tail; length_subpx: of the
    body; skin: `FishColours.skin`.
    """
    rows, columns = coverage.shape
    body = _find_body_pixels(line, rows, columns, length_subpx)
    shaded = _shade_body(body, skin)
    opacity = shaded[:, 3] * body.coverage
    pixels, pixel_coverage = picture.reshape(-1, 4), coverage.reshape(-1)  # views
    painted = pixels[body.flat_index] * (1 - opacity)[:, None]
    painted[:, :3] += shaded[:, :3] * opacity[:, None]
    painted[:, 3] += opacity
    pixels[body.flat_index] = painted
    pixel_coverage[body.flat_index] = np.maximum(pixel_coverage[body.flat_index], body.coverage)


class _BodyPixels(NamedTuple):
    """The n subpixels of a picture that the body covers, as arrays (n,).

    flat_index: in the flattened picture; s: place along the body, 0 snout, 1 tail end; v: distance
    from the midline, body lengths, + to the left; left_x: x of the unit vector to the fish's left;
    coverage: covered share of the subpixel; squared_width: half width of the body at s, squared.
    """

    flat_index: NDArray[np.intp]
    s: Image
    v: Image
    left_x: Image
    coverage: Image
    squared_width: Image


def _find_pixels_near_midline(
    line: Floats, rows: int, columns: int, length_subpx: float
) -> tuple[NDArray[np.intp], Image]:
    """Return the subpixels that the body may cover, and the nearest midline point of each.

    The results (n,) are the index in the flattened picture, and the nearest place on the midline (0
    at the head, k − 1 at the tail end), to about a subpixel. line (k, 2): midline in subpixels;
    length_subpx: of the body.
    """
    last = len(line) - 1
    # The distance transform is a few per cent off, so reach a little farther than the outline.
    reach = 1.08 * half_width(np.linspace(0, 1, len(line))) * length_subpx + 2 * OVERSAMPLE
    reach = reach.astype(np.float32)
    # Places along the midline, so dense that they touch each of its pixels.
    places = np.linspace(0, last, max(8 * last, int(4 * np.ptp(line, axis=0).sum())))
    column, row = (
        np.rint(np.interp(places, np.arange(last + 1), line[:, axis])).astype(int)
        for axis in range(2)
    )
    is_off_midline = np.ones((rows, columns), np.uint8)
    is_off_midline[row, column] = 0
    # Of each subpixel: its distance from the midline, and which of the midline's is nearest.
    distance, labels = cv2.distanceTransformWithLabels(
        is_off_midline, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    place_of_label = np.zeros(int(labels.max()) + 1, np.float32)
    place_of_label[labels[row, column]] = places
    index = np.flatnonzero(distance < reach.max())
    midline_place = place_of_label[labels.reshape(-1)[index]]
    in_reach = distance.reshape(-1)[index] < reach[np.rint(midline_place).astype(np.int32)]
    return index[in_reach], midline_place[in_reach]


def _find_body_pixels(line: Floats, rows: int, columns: int, length_subpx: float) -> _BodyPixels:
    """Return the subpixels of a picture (rows, columns) that the body along a midline covers.

    line (k, 2): midline in subpixels, head to tail; length_subpx: of the body.
    """
    last = len(line) - 1
    index, midline_place = _find_pixels_near_midline(line, rows, columns, length_subpx)
    py, px = (number.astype(np.float32) for number in np.divmod(index, columns))
    # x, y and the tangent's x, y at each midline point, and their change from point to point.
    nodes = np.hstack([line, _tangents_to_head(line)]).astype(np.float32)
    changes = np.diff(nodes, axis=0)
    step_length = np.float32(np.linalg.norm(np.diff(line, axis=0), axis=1).mean())
    # Three fixed-point steps move each place to the foot of the perpendicular from its pixel.
    for _ in range(3):
        i = np.clip(midline_place.astype(np.int32), 0, last - 1)
        share = midline_place - i  # outside 0-1 beyond the midline's ends
        node, change = nodes[i], changes[i]
        inner = np.clip(share, 0, 1)
        tx, ty = node[:, 2] + inner * change[:, 2], node[:, 3] + inner * change[:, 3]
        dx = px - node[:, 0] - share * change[:, 0]
        dy = py - node[:, 1] - share * change[:, 1]
        # The tangent points to the head, so a pixel ahead of the place lies at a smaller one.
        along = dx * tx + dy * ty
        midline_place = np.clip(midline_place - along / step_length, -3, last + 3)
    v = dx * ty - dy * tx  # the left of the tangent (tx, ty) is (ty, -tx), as y points down
    s, v = midline_place / np.float32(last), v / np.float32(length_subpx)
    squared_width, coverage = _body_coverage(s, v, length_subpx)
    keep = coverage > 0
    return _BodyPixels(
        index[keep], s[keep], v[keep], left_x=ty[keep], coverage=coverage[keep],
        squared_width=squared_width[keep],
    )  # fmt: skip


def _body_coverage(s: Image, v: Image, length_subpx: float) -> tuple[Image, Image]:
    """Return the body's squared half width (n,) at s, and the covered share (n,) of each subpixel.

    s, v (n,): body coordinates of the subpixels; length_subpx: of the body. Widths are in body
    lengths.
    """
    grid, squared, squared_slope = width_table()
    squared_width = np.interp(s, grid, squared).astype(np.float32)
    slope = np.interp(s, grid, squared_slope).astype(np.float32)
    # Distance to the outline w² - v² = 0, + inside, to first order: the value over its gradient.
    gradient = np.sqrt(slope * slope + 4 * v * v + 1e-12)
    edge_distance = (squared_width - v * v) / gradient
    return squared_width, np.clip(edge_distance * np.float32(length_subpx) + 0.5, 0, 1)


def _shade_body(body: _BodyPixels, skin: Image) -> Image:
    """Return the lit RGB and opacity (n, 4) of the n subpixels that the body covers.

    skin: a picture (rows, columns, 4) of the whole skin, RGB and opacity, the snout at column 0.
    """
    # The colour of the skin at each subpixel.
    rows, columns = skin.shape[:2]
    row_length = 128  # cv2.remap takes a picture with sides up to 32767
    missing = -len(body.s) % row_length
    x = np.pad(body.s * columns - 0.5, (0, missing)).reshape(-1, row_length).astype(np.float32)
    y = (0.5 - body.v / (2 * SKIN_HALF)) * rows - 0.5
    y = np.pad(y, (0, missing)).reshape(-1, row_length).astype(np.float32)
    colour = cv2.remap(skin, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    colour = np.asarray(colour.reshape(-1, 4)[: len(body.s)])
    across = body.v / np.sqrt(np.maximum(body.squared_width, 1e-6))  # ±1 at the edges, + = left
    left_x = body.left_x
    # How much the fish's left faces the light, −1 … 1. Of the vector to the left only x is known;
    # its y counts as upwards, towards the light, on either side.
    lit = LIGHT[0] * left_x + LIGHT[1] * -np.sqrt(np.clip(1 - left_x**2, 0, 1))
    colour[:, :3] *= (1 + 0.20 * np.clip(across, -1, 1) * lit)[:, None]
    # The wet back shines where it faces the light, most where the body is thick.
    thickness = np.clip(body.squared_width / 0.0081, 0, 1)  # 0.09²: the widest part
    shine = np.exp(-(((across - 0.38 * lit) / 0.20) ** 2)) * thickness
    colour[:, :3] += (GLOSS * shine)[:, None]
    return colour


def _paint_fin(
    picture: Image, coverage: Image, fin: Image, root: Floats, along: Floats, half_breadth: Floats
) -> None:
    """Paint one fin into a picture (h, w, 4) and its coverage (h, w), both changed in place.

    fin (side, side, 5): premultiplied RGB, opacity and coverage; root (2,): where it begins,
    subpixels; along, half_breadth (2,): vectors from the root to its tip and from its middle to its
    leading edge.
    """
    side = fin.shape[0]
    # Column c, row r (0-1) of the fin -> root + along * c - half_breadth * (2 r - 1) * FIN_HALF.
    linear = np.column_stack([along / side, -2 * FIN_HALF * half_breadth / side])
    shift = root + half_breadth * FIN_HALF + linear @ np.array([0.5, 0.5])
    corners = np.array([[0, 0], [side, 0], [0, side], [side, side]]) @ linear.T + shift
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 1, coverage.shape[::-1])
    # Painted into the part of the picture, from low to high, that the fin touches.
    matrix = np.column_stack([linear, shift - low])
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    window = np.s_[low[1] : high[1], low[0] : high[0]]
    painted = cv2.warpAffine(np.ascontiguousarray(fin[..., :4]), matrix, size)
    picture[window] = painted + picture[window] * (1 - painted[..., 3:4])
    fin_coverage = cv2.warpAffine(np.ascontiguousarray(fin[..., 4]), matrix, size)
    coverage[window] = np.maximum(coverage[window], fin_coverage)


def blur_drawing(drawing: CarpPicture) -> tuple[Image, Image]:
    """Return a carp's premultiplied RGB (h, w, 3) and opacity (h, w), blurred as by a lens."""
    return (
        np.asarray(cv2.GaussianBlur(drawing.colour, (0, 0), BLUR_PX), np.float32),
        np.asarray(cv2.GaussianBlur(drawing.opacity, (0, 0), BLUR_PX), np.float32),
    )
