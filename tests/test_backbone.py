"""The backbone: lengths of skeletons drawn by hand, laws of what is traced through drawn shapes."""

import cv2
import numpy as np
import pytest
from scipy import ndimage
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import cdist
from skimage.morphology import skeletonize

from finloop.extract.backbone import (
    close_notches,
    find_longest_path,
    quantile_above,
    refine_outline,
    resample_line,
    smoothing_matrix,
    trace_backbone,
)

ROOT2 = np.sqrt(2)
SIZE = (161, 171)  # of the pictures that shapes are drawn into
FLOOR = 6.0
ANGLES = [0, 17, 45, 61, 90, 133]


# -- the longest geodesic, on skeletons drawn by hand ---------------------------------------------


def skeleton(drawing):
    return np.array([[letter != "." for letter in line] for line in drawing.split()])


def longest(pixels, weight=None):
    ones = np.ones(pixels.shape, np.float32)
    return find_longest_path(pixels, ones if weight is None else weight)


def steps(line):
    return np.hypot(*np.diff(line, axis=0).T)


STROKE = """
    .......
    .#####.
    .......
"""
CORNER = """
    .#.....
    ..#....
    ..#....
"""
TEE = """
    #######
    ...#...
    ...#...
    .......
    .......
"""
LONG_TEE = """
    ..###..
    ...#...
    ...#...
    ...#...
    ...#...
"""
WYE = """
    #.....#
    .#...#.
    ..#.#..
    ...#...
    ...#...
"""
FIG4 = """
    .....#......
    .....#......
    ############
    ........#...
    .........#..
"""
PIECES = """
    ########.
    .........
    ##..#####
"""
LOOP = """
    .###.
    #...#
    #...#
    .###.
"""
FORK = """
    .......
    ....##.
    ####...
    ....#..
    .....#.
"""


@pytest.mark.parametrize(
    ("drawing", "length"),
    [
        ("#", 0),
        ("##", 1),
        (STROKE, 4),
        (CORNER, 1 + ROOT2),
        (TEE, 6),  # along the bar
        (LONG_TEE, 3 + ROOT2),  # down the stem, from one end of the bar by a diagonal step
        (WYE, 6 * ROOT2),  # from arm to arm
        (FORK, 3 + 2 * ROOT2),  # the lower prong
        (FIG4, 11),  # the paper's Fig. 4: A to D, without the side branches
        (PIECES, 7),  # the piece of the most pixels
        (LOOP, 3 + 2 * ROOT2),  # half of the way round
        (".", 0),
    ],
)
def test_lengths_of_skeletons_drawn_by_hand(drawing, length):
    pixels = skeleton(drawing)
    for view in (pixels, pixels.T, pixels[::-1], pixels[:, ::-1]):
        assert steps(longest(np.ascontiguousarray(view))).sum() == pytest.approx(length)


def test_a_long_thin_fin_loses_to_a_short_thick_head():
    # Body, ahead of the joint a head (h), and aside a fin (f) that is longer.
    drawing = """
        .......f...
        .......f...
        .......f...
        .......f...
        .......f...
        ########hh.
    """
    letters = np.array([list(line) for line in drawing.split()])
    paper = longest(letters != ".")
    assert 0 in paper[[0, -1], 1]  # weights of one: the paper's rule is taken in by the fin
    width = np.where(letters == "f", 1, 4).astype(np.float32)
    ours = longest(letters != ".", width)
    assert sorted(ours[[0, -1], 0]) == [0, 9]
    assert ours[:, 1].min() >= 4


def blob(seed):
    """A random patch without holes."""
    noise = np.random.default_rng(seed).standard_normal((40, 40))
    patches = ndimage.label(ndimage.gaussian_filter(noise, 3) > 0.02)[0]
    largest = patches == 1 + np.argmax(np.bincount(patches.ravel())[1:])
    return ndimage.binary_fill_holes(largest)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("weighted", [False, True])
def test_the_path_is_a_walk_and_no_pair_is_farther_apart(seed, weighted):
    mask = blob(seed)
    pixels = skeletonize(mask)
    distance = ndimage.distance_transform_edt(mask) if weighted else np.ones(mask.shape)
    path = longest(pixels, distance.astype(np.float32)).astype(int)
    assert pixels[path[:, 1], path[:, 0]].all()
    assert len(np.unique(path, axis=0)) == len(path)
    assert np.abs(np.diff(path, axis=0)).max() == 1

    places = np.argwhere(pixels)[:, ::-1]  # every pair, by another library
    weight = distance[places[:, 1], places[:, 0]]
    edge = np.abs(places[:, None] - places).max(-1) == 1
    length = np.hypot(*(places[:, None] - places).T) * (weight[:, None] + weight) / 2
    best = dijkstra(csr_matrix(np.where(edge, length, 0)), directed=False)
    best = best[np.isfinite(best)].max()
    along = distance[path[:, 1], path[:, 0]]
    mine = (steps(path) * (along[1:] + along[:-1]) / 2).sum()
    # A skeleton's joints are little triangles, on which two sweeps may miss a pixel.
    assert 0.99 * best <= mine <= best + 1e-4


# -- a backbone through a drawn shape ------------------------------------------------------------


def shape(bend=0.0, degrees=0.0, length=80.0, end=1.0, thick=7.0):
    """Midline (n, 2) of a body that bends by `bend` radians, and its half width, `end` at the ends.

    y is down: positive angles and bends are anticlockwise as seen.
    """
    share = np.linspace(0, 1, 161)
    direction = np.radians(degrees) + bend * (share - 0.5)
    line = np.stack([np.cos(direction), -np.sin(direction)], 1).cumsum(0) * length / 161
    line += np.array([78.3, 83.6]) - line.mean(0)
    return line, end + thick * np.sin(np.pi * (1 - share) ** 1.6)


def draw_discs(line, half_width, contrast=100.0):
    """Mask and difference image of discs strung on a line, soft over one pixel."""
    inside = np.full(SIZE, -9.0)
    for (px, py), width in zip(line, half_width, strict=True):
        left, top = int(px) - 10, int(py) - 10
        y, x = np.ogrid[top : top + 22, left : left + 22]
        here = inside[top : top + 22, left : left + 22]
        np.maximum(here, width - np.hypot(x - px, y - py), out=here)
    field = np.round(contrast * np.clip(inside + 0.5, 0, 1)).astype(np.uint8)
    return field > contrast / 2, field


def whole(line, half_width):
    """The midline carried on straight to the tips of the drawn shape, in steps of 0.1 px."""
    ends = []
    for at, inner, width in ((0, 1, half_width[0]), (-1, -2, half_width[-1])):
        out = (line[at] - line[inner]) / np.hypot(*(line[at] - line[inner]))
        ends.append(line[at] + out * np.arange(0, width + 0.05, 0.1)[:, None])
    return resample_line(np.vstack([ends[0][::-1], line, ends[1]]), 1000)


def backbone(mask, field, points=33, floor=FLOOR):
    found = trace_backbone(np.ascontiguousarray(mask), np.ascontiguousarray(field), points, floor)
    assert found is not None
    return found


def aside(one, other):
    """Distances of the points of one line from another line."""
    return cdist(one, resample_line(np.asarray(other), 1000)).min(1)


@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("bend", [0.0, 0.8, -1.6])
@pytest.mark.parametrize(("end", "thick"), [(1.0, 7.0), (6.0, 0.0)], ids=["fish", "capsule"])
def test_a_backbone_is_as_long_as_the_midline_and_lies_on_it(degrees, bend, end, thick):
    line, half_width = shape(bend, degrees, end=end, thick=thick)
    found = backbone(*draw_discs(line, half_width))
    true = whole(line, half_width)
    assert found.length_px == pytest.approx(steps(true).sum(), rel=0.01)
    assert found.length_px == pytest.approx(steps(found.points_px).sum())
    assert aside(found.points_px, true).mean() < 0.2
    assert aside(found.points_px, true).max() < 1.0
    assert cdist(found.points_px[[0, -1]], true[[0, -1]]).min(1).max() < 1.5
    assert np.ptp(steps(found.points_px)) < 0.05 * steps(found.points_px).mean()
    middle = half_width[80]
    assert found.half_width_px[16] == pytest.approx(middle, abs=0.2)
    assert found.half_width_px.shape == (33,)


VIEWS = {  # a picture, and the points in it, seen otherwise
    "turned by 90°": (np.rot90, lambda p: np.stack([p[:, 1], SIZE[1] - 1 - p[:, 0]], 1)),
    "upside down": (lambda z: z[::-1, ::-1], lambda p: np.array(SIZE)[::-1] - 1 - p),
    "mirrored": (lambda z: z[:, ::-1], lambda p: p * (-1, 1) + (SIZE[1] - 1, 0)),
    "rows as columns": (lambda z: z.T, lambda p: p[:, ::-1]),
}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("degrees", ANGLES)
def test_another_view_of_a_fish_has_the_same_backbone(view, degrees):
    see, go = VIEWS[view]
    mask, field = draw_discs(*shape(1.2, degrees))
    one, other = backbone(mask, field), backbone(see(mask), see(field))
    # Not exactly: thinning takes pixels off one side first.
    assert aside(go(one.points_px), other.points_px).mean() < 0.1
    assert other.length_px == pytest.approx(one.length_px, rel=0.005)


def test_place_contrast_and_number_of_points_do_not_matter():
    mask, field = draw_discs(*shape(1.2, 30))
    one, elsewhere, strong, fine = (
        backbone(mask, field), backbone(mask[3:, 7:], field[3:, 7:]), backbone(mask, 2 * field),
        backbone(mask, field, 65),
    )  # fmt: skip
    assert np.allclose(elsewhere.points_px + (7, 3), one.points_px, atol=1e-9)
    assert np.allclose(strong.points_px, one.points_px)
    assert np.allclose(strong.half_width_px, one.half_width_px)
    assert one.points_px.shape == (33, 2) and fine.points_px.shape == (65, 2)
    assert fine.length_px == pytest.approx(one.length_px, rel=0.01)
    assert aside(one.points_px, fine.points_px).mean() < 0.1


def test_a_haze_below_the_floor_does_not_lengthen_a_pale_fish():
    mask, field = draw_discs(*shape(0.0, 0), contrast=10.0)
    clear = backbone(mask, field)
    hazy = np.maximum(field, 5)
    assert backbone(mask, hazy).length_px == pytest.approx(clear.length_px, rel=0.02)
    assert backbone(mask, hazy, floor=0.0).length_px > 1.3 * clear.length_px


@pytest.mark.parametrize("long", [8, 15, 22])
@pytest.mark.parametrize("degrees", ANGLES)
def test_an_open_fin_does_not_move_the_backbone(degrees, long):
    line, half_width = shape(0.8, degrees)
    plain = backbone(*draw_discs(line, half_width))
    at, along = line[50], (line[51] - line[50]) / np.hypot(*(line[51] - line[50]))
    tip = at + (along[::-1] * (-1, 1)) * (half_width[50] + long) + 6 * along
    fin = np.linspace(at, tip, 60)
    finned = backbone(*draw_discs(np.vstack([line, fin]), np.append(half_width, np.full(60, 1.5))))
    assert aside(plain.points_px, finned.points_px).max() < 0.3
    assert finned.length_px == pytest.approx(plain.length_px, rel=0.002)


@pytest.mark.parametrize("side", [1, -1])
def test_an_eye_as_dark_as_the_tank_does_not_lead_the_backbone_aside(side):
    off = []
    for degrees in ANGLES:
        line, half_width = shape(0.4, degrees, length=120.0, end=2.0)
        mask, field = draw_discs(line, half_width)
        plain = backbone(mask, field).points_px
        along = (line[15] - line[14]) / np.hypot(*(line[15] - line[14]))
        eye = line[14] + 0.8 * side * half_width[14] * along[::-1] * (-1, 1)
        y, x = np.mgrid[: SIZE[0], : SIZE[1]]
        field[np.hypot(x - eye[0], y - eye[1]) < 2.6] = 0
        found = backbone(field > 50, field).points_px
        off.append(cdist(plain[[0, -1]], found[[0, -1]]).min(1).max())
    assert np.mean(off) < 0.3


def test_a_neighbour_beyond_the_tail_is_no_part_of_the_fish():
    line, half_width = shape(0.0, 0, thick=9.0)
    mask, field = draw_discs(line, half_width)
    beside = field.copy()
    beside[:, int(line[-1, 0]) + 5 :] = 90
    assert np.allclose(backbone(mask, field).points_px, backbone(mask, beside).points_px)


def test_a_gap_that_closes_a_ring_is_no_notch():
    line, half_width = shape(2 * np.pi - 0.3, 0, thick=6.0)
    mask, field = draw_discs(line, half_width)
    whole_one, filled = close_notches(mask, field)
    assert np.array_equal(whole_one, mask)
    assert np.array_equal(filled, field)


def blank(*filled):
    mask = np.zeros((20, 24), bool)
    for part in filled:
        mask[part] = True
    return mask


RADIUS = np.hypot(*np.mgrid[-10:10, -12:12])


@pytest.mark.parametrize(
    "mask",
    [blank(), blank(np.s_[5, 5]), blank(np.s_[5:7, 5:7]), blank(np.s_[5, 3:7]), RADIUS < 7.5,
     blank(np.s_[5:15, 5:15]), np.ones((20, 24), bool)],
    ids=["nothing", "a pixel", "2x2", "four pixels", "a disc", "a square", "everything"],
)  # fmt: skip
def test_what_has_no_length_has_no_backbone(mask):
    assert trace_backbone(mask, 100 * mask.astype(np.uint8), 33, FLOOR) is None


@pytest.mark.parametrize(
    "mask",
    [blank(np.s_[5, 3:15]), np.eye(20, 24, dtype=bool), blank(np.s_[:3, :]),
     (RADIUS < 8.5) & (RADIUS > 5), blank(np.s_[5], np.s_[12:14, 5:9])],
    ids=["one pixel wide", "a diagonal", "along the edge", "a ring", "two pieces"],
)  # fmt: skip
@pytest.mark.parametrize("level", [100, 0])
def test_what_is_no_fish_still_ends_well(mask, level):
    found = trace_backbone(mask, level * mask.astype(np.uint8), 33, FLOOR)
    if found is not None:
        assert np.isfinite(found.points_px).all()
        assert np.isfinite(found.half_width_px).all()
        assert 0 < found.length_px < 60


# -- its parts --------------------------------------------------------------------------------------


@pytest.mark.parametrize("points", [17, 33, 65])
def test_the_smoother_lets_parabolas_pass_and_takes_out_a_zigzag(points):
    matrix, s = smoothing_matrix(points), np.linspace(-1, 1, points)
    for power in range(3):
        assert np.allclose(matrix @ s**power, s**power, atol=1e-6)
    assert np.allclose(matrix, matrix[::-1, ::-1], atol=1e-6)  # no end is favoured
    assert np.abs(matrix @ (-1.0) ** np.arange(points))[4:-4].max() < 0.2
    wave = np.sin(np.pi * s)  # as long as the fish
    assert np.abs(matrix @ wave - wave).max() < 0.15


def test_resampling_gives_equal_steps_along_the_same_line():
    line = np.array([[0, 0], [3, 0], [3, 4], [10, 4.0]])  # 14 long, corners at 3 and 7
    out = resample_line(line, 15)
    assert np.allclose(out[[0, 3, 7, 14]], line)
    assert np.allclose(steps(out), 1)
    assert np.allclose(resample_line(line[::-1], 15), out[::-1])
    assert np.allclose(resample_line(out, 15), out)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("points", [60, 128])
def test_the_outline_of_a_soft_disc_is_its_circle(turn, points):
    y, x = np.mgrid[:40, :40]
    centre, radius = np.array([19.3, 20.6]), 11.4
    inside = np.clip(radius - np.hypot(x - centre[0], y - centre[1]) + 0.5, 0, 1)
    alpha = np.round(255 * inside).astype(np.uint8)
    chain = cv2.findContours((alpha > 127).astype(np.uint8), cv2.RETR_EXTERNAL, 1)[0][0][:, 0]
    edge = refine_outline(alpha, chain[::turn].copy(), points)
    assert edge.shape == (points, 2)
    assert np.hypot(*(edge - centre).T) == pytest.approx(radius, abs=0.12)
    assert steps(np.vstack([edge, edge[:1]])) == pytest.approx(2 * np.pi * radius / points, rel=0.1)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("threshold", [0.0, 6.0, 6.5, 99.9])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.8])
def test_the_level_that_a_share_of_the_pixels_stays_below(seed, threshold, share):
    patch = np.random.default_rng(seed).integers(0, 120, (9, 11), np.uint8)
    level, above = quantile_above(patch, threshold, share), patch[patch > threshold]
    assert (above < level).mean() <= share < (above <= level).mean()
