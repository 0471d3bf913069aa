"""Compiled operations on small masks, which kernels call for every silhouette.

A silhouette of some hundred pixels lies in a box of some thousand, and the time goes into the box.
So scalar loops visit only the *spans*: in each row the columns from the first to the last pixel
that can matter. Loops over the whole box run over all rows at once, many pixels at a time.

OpenCV and scikit-image are the references: `tests/test_masks.py` compares every function.

Glossary: a *mask* is a picture (h, w) of 0 and 1, uint8 or bool. `first`, `stop` (h,): the span of
each row, half-open, empty where stop ≤ first.
"""

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Ints, Mask, Picture
from finloop.base.kernel import kernel

# px, lengths of a step to the side and across (Borgefors 1986), as in `cv2.distanceTransform`
_STRAIGHT, _ACROSS = np.float32(0.955), np.float32(1.3693)
FAR = 1e9  # px, more than any distance
# Steps to the eight neighbours, anticlockwise as seen, from the one to the right.
_X, _Y = np.array([1, 1, 0, -1, -1, -1, 0, 1]), np.array([0, -1, -1, -1, 0, 1, 1, 1])


@kernel
def find_spans(mask: Picture | Mask, reach: int) -> tuple[Ints, Ints]:
    """Return first and stop (h,): the columns of each row that hold a mask's pixels.

    The mask (h, w) is first made wider by `reach` pixels on all sides.
    """
    height, width = mask.shape
    own_first, own_stop = np.full(height, width), np.zeros(height, np.int64)
    for y in range(height):
        row, highest = mask[y], mask[y, 0]
        for x in range(width):
            highest = max(highest, row[x])
        if not highest:
            continue
        x = 0
        while not row[x]:
            x += 1
        own_first[y], x = x, width - 1
        while not row[x]:
            x -= 1
        own_stop[y] = x + 1
    first, stop = np.full(height, width), np.zeros(height, np.int64)
    for y in range(height):
        for near in range(max(y - reach, 0), min(y + reach + 1, height)):
            if own_first[near] < own_stop[near]:
                first[y] = min(first[y], max(own_first[near] - reach, 0))
                stop[y] = max(stop[y], min(own_stop[near] + reach, width))
    return first, stop


@kernel
def measure_distance(
    mask: Picture, target: int, first: Ints, stop: Ints, beyond: float = FAR
) -> NDArray[np.float32]:
    """Return the distance [px] of each pixel of a mask (h, w) to the nearest one of value `target`.

    It is measured in the spans `first` to `stop`; 0 elsewhere. beyond: distance of all that
    is outside of the picture or of the spans. Equals `cv2.distanceTransform` with DIST_L2 and a
    mask of 3, up to the order of float32 sums, which OpenCV chooses by the processor.
    """
    height, width = mask.shape
    # With a rim: each pixel has neighbours.
    ways = np.full((height + 2, width + 2), np.float32(beyond), np.float32)
    for y in range(height):
        above, here, row = ways[y], ways[y + 1], mask[y]
        for x in range(first[y], stop[y]):
            least = np.float32(0)
            if row[x] != target:
                least = min(above[x + 1], here[x]) + _STRAIGHT
                least = min(min(above[x], above[x + 2]) + _ACROSS, least)
            here[x + 1] = least
    distance = np.zeros((height, width), np.float32)
    for i in range(height):
        y = height - 1 - i
        below, here = ways[y + 2], ways[y + 1]
        for j in range(stop[y] - first[y]):
            x = stop[y] - 1 - j
            least = here[x + 1]
            if least > _STRAIGHT:
                least = min(least, min(below[x + 1], here[x + 2]) + _STRAIGHT)
                least = min(least, min(below[x], below[x + 2]) + _ACROSS)
                here[x + 1] = least
            distance[y, x] = least
    return distance


@kernel
def find_pieces(picture: Picture, level: int) -> Ints:
    """Return the first pixel (n, 2) x, y of each connected piece of a picture (h, w).

    A piece has pixels at or above a grey level; pixels that touch at a corner are connected. The
    first pixel is the leftmost one in the highest row. The pieces come in the order of these
    pixels, row by row. Runs of pixels are joined with those of the row above.
    """
    height, width = picture.shape
    most = height * (width // 2 + 1)
    runs = np.empty((most, 3), np.int64)  # first column, column after the last, and row
    piece = np.empty(most, np.int64)  # an earlier run of the same piece, or the run itself
    count, before = 0, 0  # `before` is the first run of the row before
    for y in range(height):
        here, row, x = count, picture[y], 0
        highest = np.uint8(0)
        for u in range(width):
            highest = max(highest, row[u])
        while x < width and highest >= level:
            if row[x] < level:
                x += 1
                continue
            runs[count, 0], runs[count, 2] = x, y
            while x < width and row[x] >= level:
                x += 1
            runs[count, 1], piece[count] = x, count
            for above in range(before, here):
                if runs[above, 0] <= x and runs[above, 1] >= runs[count, 0]:
                    one, other = _first_run(piece, above), _first_run(piece, count)
                    piece[max(one, other)] = min(one, other)
            count += 1
        before = here
    first, pieces = np.empty((count, 2), np.int64), 0
    for run in range(count):
        if piece[run] == run:
            first[pieces, 0], first[pieces, 1] = runs[run, 0], runs[run, 2]
            pieces += 1
    return first[:pieces].copy()


@kernel
def _first_run(piece, run):  # type: ignore[no-untyped-def]
    """Return the first run of the piece to which a run belongs so far."""
    while piece[run] != run:
        run = piece[run]
    return run


@kernel
def trace_edge(picture: Picture, level: int, first: Ints) -> NDArray[np.int32]:
    """Return the edge (m, 2) x, y of a piece of a picture, as a closed chain of its own pixels.

    level: least grey level of the piece; first: x, y of its first pixel (`find_pieces`). The chain
    runs anticlockwise as seen. Equals `cv2.findContours` with CHAIN_APPROX_NONE (Suzuki and Abe
    1985).
    """
    x0, y0 = first[0], first[1]
    turn = 4  # from the left, where the piece is not, clockwise to the last pixel of the chain
    for _ in range(7):
        turn = (turn - 1) % 8
        if _is_in_piece(picture, level, x0 + _X[turn], y0 + _Y[turn]):
            break
    chain, length = np.empty((64, 2), np.int32), 0
    last_x, last_y = x0 + _X[turn], y0 + _Y[turn]
    if not _is_in_piece(picture, level, last_x, last_y):  # a single pixel
        chain[0, 0], chain[0, 1] = x0, y0
        return chain[:1].copy()
    x, y = x0, y0
    while True:
        if length == len(chain):
            longer = np.empty((2 * length, 2), np.int32)
            longer[:length] = chain
            chain = longer
        chain[length, 0], chain[length, 1] = x, y
        length += 1
        turn = (turn + 1) % 8
        while not _is_in_piece(picture, level, x + _X[turn], y + _Y[turn]):
            turn = (turn + 1) % 8
        next_x, next_y = x + _X[turn], y + _Y[turn]
        if next_x == x0 and next_y == y0 and x == last_x and y == last_y:
            return chain[:length].copy()
        x, y, turn = next_x, next_y, (turn + 4) % 8


@kernel
def _is_in_piece(picture, level, x, y):  # type: ignore[no-untyped-def]
    """Return whether a pixel lies in the picture and is at or above a grey level."""
    height, width = picture.shape
    return 0 <= x < width and 0 <= y < height and picture[y, x] >= level


@kernel
def close_with_disc(picture: Picture, radius: int) -> Picture:
    """Return a picture (h, w) uint8 closed with a disc: dark parts narrower than it are filled.

    Equals `cv2.morphologyEx` with MORPH_CLOSE and an ellipse of 2 · radius + 1 px, on a picture
    with a rim of zeros.
    """
    height, width = picture.shape
    # All rows one after the other: one long loop is faster than many short ones. The rim keeps
    # what wraps around from row to row, and what has no neighbours, away from the picture.
    rim = 2 * radius + 1
    wide = width + rim + 1
    starts = np.arange(rim, rim + height) * wide
    flat = np.zeros((height + 2 * rim) * wide, np.uint8)
    for y in range(height):
        flat[starts[y] : starts[y] + width] = picture[y]
    dilated = _dilate_rows(flat, wide, radius)
    for i in range(dilated.size):
        dilated[i] ^= np.uint8(255)
    eroded = _dilate_rows(dilated, wide, radius)
    closed = np.empty((height, width), np.uint8)
    for y in range(height):
        row = eroded[starts[y] : starts[y] + width]
        for x in range(width):
            closed[y, x] = row[x] ^ np.uint8(255)
    return closed


@kernel
def _dilate_rows(flat, width, radius):  # type: ignore[no-untyped-def]
    """Return the largest value within a disc around each pixel of rows of one `width`, joined.

    A disc is made of rows: the largest value within so many pixels to both sides is made from that
    within one pixel less, and serves all rows of the disc that are so wide.
    """
    size, rim = flat.size, radius * width
    result, row, wider = np.zeros(size, np.uint8), flat.copy(), np.zeros(size, np.uint8)
    target = result[rim : size - rim]
    for reach in range(radius + 1):
        if reach:
            left, middle, right, between = row[:-2], row[1:-1], row[2:], wider[1:-1]
            for i in range(between.size):
                between[i] = max(left[i], right[i])
            if reach == 1:
                for i in range(between.size):
                    between[i] = max(between[i], middle[i])
            row, wider = wider, row
        for dy in range(-radius, radius + 1):
            if _disc_half_width(dy, radius) == reach:
                source = row[rim + dy * width : size - rim + dy * width]
                for i in range(target.size):
                    target[i] = max(target[i], source[i])
    return result


@kernel
def _disc_half_width(dy, radius):  # type: ignore[no-untyped-def]
    """Return how many pixels a disc reaches to each side, `dy` rows from its middle.

    Equals `cv2.getStructuringElement` with MORPH_ELLIPSE.
    """
    if radius == 0:
        return 0
    square = (radius * radius - dy * dy) * (1.0 / (radius * radius))
    return int(np.rint(radius * np.sqrt(square)))


@kernel
def count_holes(mask: Picture) -> int:
    """Return how many holes a mask (h, w) has: parts of 0 that its pixels enclose.

    It is the number of pieces less the Euler number, which counts windows of 2×2 pixels (Gray
    1971): those with one pixel, less those with three, less twice those with two at a corner.
    """
    height, width = mask.shape
    quads = 0
    above, here = np.zeros(width + 2, np.int64), np.zeros(width + 2, np.int64)
    for y in range(height + 1):
        here[:] = 0
        if y < height:
            for x in range(width):
                here[x + 1] = mask[y, x]
        for x in range(width + 1):
            count = above[x] + above[x + 1] + here[x] + here[x + 1]
            is_corner = count == 2 and above[x] == here[x + 1]
            quads += (count == 1) - (count == 3) - 2 * is_corner
        above, here = here, above
    return len(find_pieces(mask, 1)) - quads // 4


def _removal_table() -> Picture:
    """Return in which of two turns `thin` removes a pixel with given neighbours: (256,).

    Bit k of an index says whether neighbour k is in the mask, clockwise from the upper left. 1: the
    first turn, 2: the second, 3: both, 0: neither. These are the conditions of Zhang and Suen, but
    scikit-image decides otherwise of 25 neighbourhoods, so that diagonal lines get one pixel wide.
    """
    table = np.zeros(256, np.uint8)
    for index in range(256):
        near = [index >> k & 1 for k in range(8)]
        up, right, down, left = near[1::2]
        steps = sum(near[k - 1] < near[k] for k in range(8))  # from 0 to 1 on the way round
        if steps == 1 and 2 <= sum(near) <= 6:
            first = not (up and right and down) and not (right and down and left)
            second = not (up and right and left) and not (up and down and left)
            table[index] = first + 2 * second
    table[[48, 129]] = 0
    table[[3, 6, 11, 12, 14, 131, 134, 161, 194, 198]] = 1
    table[[24, 26, 56, 96, 104, 108, 176, 192, 224]] = 2
    table[[10, 40, 130, 160]] = 3
    return table


_REMOVAL = _removal_table()


@kernel
def thin(mask: Picture | Mask) -> Picture:
    """Return the skeleton (h, w) of a mask: its pieces, thinned to lines one pixel wide (§2.2).

    Pixels at the edge are removed in turns where their neighbours stay connected (Zhang and Suen
    1984). Equals `skimage.morphology.skeletonize`. Only pixels with a neighbour outside are looked
    at, so the work grows with the area and not with the box.
    """
    height, width = mask.shape
    wide = width + 2
    live = np.zeros((height + 2) * wide, np.uint8)  # with a rim: each pixel has neighbours
    for y in range(height):
        row = live[(y + 1) * wide + 1 : (y + 1) * wide + 1 + width]
        for x in range(width):
            row[x] = mask[y, x]
    clockwise = np.array([-wide - 1, -wide, -wide + 1, 1, wide + 1, wide, wide - 1, -1])
    edge, is_edge = np.empty(live.size, np.int64), np.zeros(live.size, np.bool_)
    removed, count = np.empty(live.size, np.int64), 0
    for pixel in range(wide, live.size - wide):
        if live[pixel] and _neighbour_index(live, pixel, wide) < 255:
            edge[count], is_edge[pixel] = pixel, True
            count += 1
    idle = 0  # turns without a removal
    turn = 1
    while idle < 2 or turn == 2:
        removals, kept = 0, 0
        for k in range(count):
            pixel = edge[k]
            if _REMOVAL[_neighbour_index(live, pixel, wide)] & turn:
                removed[removals] = pixel
                removals += 1
            else:
                edge[kept] = pixel
                kept += 1
        count, idle, turn = kept, 0 if removals else idle + 1, 3 - turn
        for k in range(removals):
            live[removed[k]] = 0
        for k in range(removals):
            for step in clockwise:
                pixel = removed[k] + step
                if live[pixel] and not is_edge[pixel]:
                    edge[count], is_edge[pixel] = pixel, True
                    count += 1
    skeleton = np.empty((height, width), np.uint8)
    for y in range(height):
        skeleton[y] = live[(y + 1) * wide + 1 : (y + 1) * wide + 1 + width]
    return skeleton


@kernel
def _neighbour_index(live, pixel, wide):  # type: ignore[no-untyped-def]
    """Return the index in `_REMOVAL` of a pixel of joined rows, from its eight neighbours."""
    above, below = pixel - wide, pixel + wide
    upper = live[above - 1] + 2 * live[above] + 4 * live[above + 1] + 8 * live[pixel + 1]
    lower = live[below + 1] + 2 * live[below] + 4 * live[below - 1] + 8 * live[pixel - 1]
    return upper + 16 * lower
