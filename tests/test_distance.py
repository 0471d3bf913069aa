"""Eq. 5 and the pictures it is taken of."""

import cv2
import numpy as np
import pandas as pd
import pytest

from finloop.distance.picture import (
    SPAN,
    centre_cutout,
    distance,
    successive_distances,
    typical_length,
)

ORIENTATIONS = 24  # conf/features/default.yaml

SIZE = 64


def fish(
    length: int, height: int = 60, width: int = 90, at: tuple[int, int] = (45, 30)
) -> np.ndarray:
    """A dark wedge, head to the right, with its alpha; premultiplied."""
    pixels = np.zeros((height, width, 2), np.uint8)
    x, y = at
    corners = np.array(
        [
            [x - length // 2, y],
            [x + length // 2, y - length // 6],
            [x + length // 2, y + length // 6],
        ]
    )
    cv2.fillPoly(alpha := np.zeros((height, width), np.uint8), [corners], 255)
    pixels[..., 0], pixels[..., 1] = alpha // 3, alpha
    return pixels


def test_a_picture_has_no_distance_from_itself_and_the_same_both_ways():
    rng = np.random.default_rng(0)
    a, b = rng.random((2, 5, 8, 8, 2), np.float32)
    assert distance(a, a).diagonal() == pytest.approx(0)
    assert distance(a, b) == pytest.approx(distance(b, a).T)
    brute = [[np.sqrt(((i - j).astype(float) ** 2).sum()) for j in b] for i in a]
    assert distance(a, b) == pytest.approx(np.array(brute))


def test_steps_are_the_distances_of_neighbours():
    shown = np.random.default_rng(1).random((6, 4, 4, 2), np.float32)
    assert successive_distances(shown) == pytest.approx(
        distance(shown, shown).diagonal(1), rel=1e-5
    )


def test_where_in_its_cut_out_a_fish_lies_does_not_matter():
    a = centre_cutout(fish(40, at=(45, 30)), (45, 30), 40, 64)
    b = centre_cutout(fish(40, at=(40, 25)), (40, 25), 40, 64)
    assert b == pytest.approx(a, abs=1e-5)


def test_the_mass_centre_comes_to_the_middle():
    picture = centre_cutout(fish(40), (45, 30), 40, 65)
    rows, columns = np.nonzero(picture[..., 1] > 0.5)
    wide = 65 / SPAN
    assert columns.min() == pytest.approx(32 - wide / 2, abs=1.6)
    assert columns.max() == pytest.approx(32 + wide / 2, abs=1.6)
    assert rows.mean() == pytest.approx(32, abs=0.2)


def test_fish_of_any_size_come_out_equally_long():
    small = centre_cutout(fish(40), (45, 30), 40, 64)
    large = centre_cutout(cv2.resize(fish(40), None, fx=3, fy=3), (45 * 3 + 1, 30 * 3 + 1), 120, 64)
    assert np.abs(large - small).mean() < 0.03 * (small > 0).mean()


def test_a_quarter_turn_is_anticlockwise_as_seen():
    plain = centre_cutout(fish(40), (45, 30), 40, 64)
    turned = centre_cutout(fish(40), (45, 30), 40, 64, 90)
    assert turned == pytest.approx(np.rot90(plain), abs=1 / 255)


# --- pictures behind an edit list


def lengths(of_tracks: list[np.ndarray]) -> np.ndarray:
    """The typical lengths of tracks whose rows are so long, one a track."""
    track = np.repeat(np.arange(len(of_tracks)), [len(one) for one in of_tracks])
    table = pd.DataFrame({"track_id": track, "body_length_px": np.concatenate(of_tracks)})
    made = typical_length(table)
    assert (made.groupby(track).nunique() == 1).all()
    return made.groupby(track).first().to_numpy()


def bending(rng: np.random.Generator, rows: int, length: float, spread: float) -> np.ndarray:
    """Lengths (rows,) of an animal whose posture lasts 20 rows."""
    posture = np.repeat(rng.normal(0, spread, rows // 20 + 1), 20)[:rows]
    return length * (1 + posture) + rng.normal(0, 0.1, rows)


def test_an_animal_that_is_lost_and_found_keeps_its_length():
    rng = np.random.default_rng(0)
    tracks = [bending(rng, rows, 60, 0.2) for rows in (1000, 800, 600, 40, 25, 60, 12, 300)]
    medians = np.array([np.median(one) for one in tracks])
    assert abs(medians - 60).max() > 8
    assert lengths(tracks) == pytest.approx(60, rel=0.05)


def test_animals_of_different_lengths_keep_theirs():
    rng = np.random.default_rng(0)
    true = [40, 60, 61, 75, 40, 75]
    tracks = [bending(rng, 200, length, 0.03) for length in true]
    assert lengths(tracks) == pytest.approx(true, rel=0.03)
    assert lengths([3 * one for one in tracks]) == pytest.approx(3 * lengths(tracks))
    assert lengths(tracks[:1]) == pytest.approx(np.median(tracks[0]))
    assert lengths([np.full(5, 40.0), np.full(9, 60.0), np.full(1, 50.0)]).tolist() == [40, 60, 50]
