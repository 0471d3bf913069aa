"""Compiled operations on masks against OpenCV and scikit-image, the references."""

import cv2
import numpy as np
import pytest
from skimage.morphology import skeletonize

from finloop.extract.backbone import close_notches, morph_with_disc
from finloop.extract.background import Scene
from finloop.extract.masks import (
    close_with_disc,
    count_holes,
    find_pieces,
    find_spans,
    measure_distance,
    thin,
    trace_edge,
)
from finloop.extract.matte import _edge_bounds, soft_edge
from finloop.extract.segment import SilhouetteEdge, find_silhouettes, measure_fish


def odd_masks():
    """Masks that are hard: a ring, a line, three pixels, a full picture, a crowd of 500."""
    ring = np.zeros((40, 50), np.uint8)
    cv2.ellipse(ring, (25, 20), (18, 12), 0, 0, 360, 1, 5)
    line, few = np.zeros((2, 9, 30), np.uint8)
    line[4, 3:27] = 1
    few[3, 5], few[4, 6], few[4, 7] = 1, 1, 1
    crowd = np.zeros((160, 200), np.uint8)
    crowd.reshape(20, 8, 25, 8)[:, 2:6, :, 3:6] = 1
    return [ring, line, few, np.ones((30, 20), np.uint8), np.ones((1, 1), np.uint8), crowd]


def random_masks(count):
    """Masks of random blobs and specks, some of which touch the edge of the picture."""
    rng = np.random.default_rng(5)
    for _ in range(count):
        noise = rng.random(rng.integers(1, 48, 2))
        smooth = cv2.GaussianBlur(noise, (0, 0), rng.choice([0.3, 1, 2, 4]))
        yield (smooth > np.quantile(smooth, rng.choice([0.2, 0.5, 0.8]))).astype(np.uint8)


MASKS = [*odd_masks(), *random_masks(300)]


def test_a_skeleton_is_that_of_scikit_image():
    for mask in MASKS:
        assert np.array_equal(thin(mask), skeletonize(mask > 0))


def test_a_thinned_ring_is_a_ring_and_a_line_stays_as_it_is():
    ring, line, *_ = odd_masks()
    assert count_holes(thin(ring)) == 1
    assert np.array_equal(thin(line), line)


@pytest.mark.parametrize("radius", [0, 1, 2, 3, 7])
def test_a_closed_picture_is_that_of_opencv(radius):
    rng, rim = np.random.default_rng(1), radius + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    for mask in MASKS[::3]:
        grey = mask * rng.integers(0, 256, mask.shape).astype(np.uint8)
        for picture in (mask, grey):
            padded = cv2.copyMakeBorder(picture, rim, rim, rim, rim, cv2.BORDER_CONSTANT)
            closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc)[rim:-rim, rim:-rim]
            assert np.array_equal(close_with_disc(picture, radius), closed)


def test_pieces_holes_and_edges_are_those_of_opencv():
    for mask in MASKS:
        chains, tree = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        parents = np.empty(0) if tree is None else tree[0, :, 3]
        first = find_pieces(mask, 1)
        assert len(first) == cv2.connectedComponents(mask)[0] - 1 == (parents < 0).sum()
        assert count_holes(mask) == (parents >= 0).sum()
        edges = {tuple(pixel): trace_edge(mask, 1, pixel) for pixel in first}
        for chain, parent in zip(chains, parents, strict=True):
            if parent < 0:
                assert np.array_equal(edges[tuple(chain[0, 0])], chain[:, 0])


@pytest.mark.parametrize("reach", [0, 3])
def test_spans_hold_what_is_near_and_distances_are_those_of_opencv(reach):
    for mask in MASKS:
        first, stop = find_spans(mask, reach)
        columns = np.arange(mask.shape[1])
        in_span = (columns >= first[:, None]) & (columns < stop[:, None])
        near = cv2.dilate(mask, np.ones((2 * reach + 1,) * 2, np.uint8)) > 0
        assert np.all(in_span[near])
        padded = cv2.copyMakeBorder(mask, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
        depth = cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1]
        found = measure_distance(mask, 0, first, stop, 0.0)
        np.testing.assert_allclose(found[in_span], depth[in_span], rtol=1e-6)
        if mask.any():
            outside = cv2.distanceTransform(1 - mask, cv2.DIST_L2, 3)
            found = measure_distance(mask, 1, first, stop)
            np.testing.assert_allclose(found[near], outside[near], rtol=1e-6)


# -- steps of `extract` against the same steps by OpenCV -----------------------------------------


def drawn_silhouettes():
    """Silhouettes and difference images of drawn bodies: bent, with a notch, curled up, tiny."""
    rng = np.random.default_rng(3)
    for turn in range(6):
        body = np.zeros((60, 70), np.uint8)
        cv2.ellipse(
            body, (35, 30), (25, 6), 30 * turn, 0, 300 if turn % 2 else 360, 255, cv2.FILLED
        )
        cv2.circle(body, (35, 26), 2, 0, cv2.FILLED)  # an eye as bright as the tank
        yield body
    curled = np.zeros((60, 70), np.uint8)
    cv2.ellipse(curled, (35, 30), (20, 18), 0, 0, 340, 255, 8)
    yield curled
    for mask in random_masks(40):
        yield mask * rng.integers(60, 256, mask.shape).astype(np.uint8)


def close_notches_by_opencv(mask, field):
    """The steps of `close_notches`, each by a function of OpenCV."""
    picture = mask.view(np.uint8)
    padded = cv2.copyMakeBorder(picture, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    radius = int(0.5 * cv2.distanceTransform(padded, cv2.DIST_L2, 3).max() + 0.5)
    closed = morph_with_disc(picture, cv2.MORPH_CLOSE, radius)
    tree = cv2.findContours(closed, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)[1]
    if tree is not None and (tree[0, :, 3] >= 0).any():
        return mask, field
    filled = morph_with_disc(np.where(closed, field, 0), cv2.MORPH_CLOSE, radius)
    return closed.view(bool), np.maximum(filled * closed, field)


def test_notches_are_closed_as_by_opencv():
    unchanged = 0
    for picture in drawn_silhouettes():
        field = cv2.GaussianBlur(picture, (3, 3), 0.85)
        mask = field > 60
        closed, filled = close_notches(mask, field)
        expected, expected_field = close_notches_by_opencv(mask, field)
        assert np.array_equal(closed, expected) and np.array_equal(filled, expected_field)
        unchanged += closed is mask or np.array_equal(closed, mask)
    assert 0 < unchanged < 47


def soft_edge_by_opencv(silhouette, field, film, tank, levels, bounds):
    """The steps of `soft_edge`, distances and sums by OpenCV."""
    body, (contrast, threshold) = silhouette.view(np.uint8), levels
    inside, outside = (cv2.distanceTransform(m, cv2.DIST_L2, 3) for m in (body, 1 - body))
    change = film.astype(np.float32) - tank
    deep = (inside >= min(2.8, 0.5 * float(inside.max()))).astype(np.float32)
    of_fish, count = (
        cv2.boxFilter(picture, -1, (9, 9), normalize=False) for picture in (change * deep, deep)
    )
    distance = np.where(silhouette, inside - 0.5, 0.5 - outside)
    step = np.clip((8 * (distance + 8.0) + 0.5).astype(int), 0, bounds.shape[1] - 1)
    least, most = bounds[:, step]
    mean = of_fish / np.maximum(count, 1)
    share = np.clip(change * mean / np.maximum(mean * mean, threshold**2), least, most)
    share = np.where(least >= 0.99, 1, share)
    share = np.where(count < 0.5, np.minimum(field / contrast, most), share)
    share = np.where(most < 0.01, 0, share)
    return (255 * np.minimum(share, 1) + 0.5).astype(np.uint8)


@pytest.mark.parametrize("edge_px", [2.6, 4.5])
def test_a_soft_edge_is_that_of_opencvs_distances_and_sums(edge_px):
    levels, tank = (100.0, 6.0), np.full((60, 70), 200, np.uint8)
    for body in list(drawn_silhouettes())[:7]:
        blurred = cv2.GaussianBlur(body, (0, 0), 1.2)
        film = cv2.subtract(tank, blurred // 2)
        field = cv2.GaussianBlur(tank - film, (3, 3), 0.85)
        silhouette = field > 50
        alpha = soft_edge(silhouette, field, film, tank, *levels, edge_px)
        expected = soft_edge_by_opencv(silhouette, field, film, tank, levels, _edge_bounds(edge_px))
        difference = np.abs(alpha.astype(int) - expected)
        assert difference.max() <= 1 and np.mean(difference > 0) < 0.002  # of rounding


def test_four_hundred_silhouettes_one_that_fills_the_picture_and_specks_are_all_found():
    frame = np.full((400, 640), 180, np.uint8)
    frame.reshape(20, 20, 20, 32)[:, 6:11, :, 4:28] = 60
    scene = Scene(np.full(frame.shape, 180, np.uint8), "dark", 1.0, 6.0)
    arena, rule = np.full(frame.shape, 255, np.uint8), SilhouetteEdge(0.4, 0.5)
    found = list(find_silhouettes(frame, scene, arena, 20, rule))
    assert len(found) == 400 and len({(s.x0, s.y0) for s in found}) == 400
    assert all(measure_fish(s, frame, scene, 21) for s in found[::100])
    (whole,) = find_silhouettes(np.full_like(frame, 60), scene, arena, 20, rule)
    assert whole.at_border and whole.area_px == frame.size
    speck = scene.background.copy()
    speck[200, 300:303] = 60
    assert not list(find_silhouettes(speck, scene, arena, 20, rule))
    (tiny,) = find_silhouettes(speck, scene, arena, 2, rule)
    assert measure_fish(tiny, speck, scene, 21) is None  # too short for a backbone
