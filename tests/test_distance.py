"""Eq. 5 and the pictures it is taken of."""

import cv2
import numpy as np
import pandas as pd
import pytest

from finloop.base.cutout import Cutout
from finloop.distance.picture import (
    SPAN,
    all_distances,
    draw_centred_cutout,
    paired_distances,
    successive_distances,
    typical_lengths_px,
)


def fish(scale: int = 1, size: int = 64, turn_deg: float = 0.0, x: int = 45, y: int = 30):
    """A centred picture of a dark wedge, head to the right, 40 px long in its cut-out."""
    corners = np.array([[x - 20, y], [x + 20, y - 6], [x + 20, y + 6]])
    cv2.fillPoly(alpha := np.zeros((60, 90), np.uint8), [corners], 255)
    pixels = cv2.resize(np.dstack([alpha // 3, alpha]), None, fx=scale, fy=scale)
    centre = [7 + scale * x + (scale - 1) / 2, 9 + scale * y + (scale - 1) / 2]
    return draw_centred_cutout(Cutout(0, 0, 7, 9, pixels), centre, 40 * scale, size, turn_deg)


def test_eq_5_is_0_from_a_picture_to_itself_and_the_same_both_ways():
    rng = np.random.default_rng(0)
    a, b = rng.random((2, 5, 8, 8, 2), np.float32)
    assert all_distances(a, a).diagonal() == pytest.approx(0)
    assert all_distances(a, b) == pytest.approx(all_distances(b, a).T)
    brute = [[np.sqrt(((i - j).astype(float) ** 2).sum()) for j in b] for i in a]
    assert all_distances(a, b) == pytest.approx(np.array(brute))
    assert successive_distances(a) == pytest.approx(all_distances(a, a).diagonal(1), rel=1e-5)
    assert paired_distances(a, b) == pytest.approx(all_distances(a, b).diagonal(), rel=1e-5)
    assert paired_distances(a[0], a[0] + 0.5) == pytest.approx(0.5 * np.sqrt(a[0].size))


def test_a_centred_picture_shows_the_fish_in_the_middle_equally_long_and_turned():
    assert fish(x=40, y=25) == pytest.approx(fish(), abs=1e-5)  # wherever it lies in its cut-out
    rows, columns = np.nonzero(fish(size=65)[..., 1] > 0.5)
    long = 65 / SPAN
    assert columns.min() == pytest.approx(32 - long / 2, abs=1.6)
    assert columns.max() == pytest.approx(32 + long / 2, abs=1.6)
    assert rows.mean() == pytest.approx(32, abs=0.2)
    assert np.abs(fish(scale=3) - fish()).mean() < 0.03 * (fish() > 0).mean()
    assert fish(turn_deg=90) == pytest.approx(np.rot90(fish()), abs=1 / 255)  # anticlockwise


# --- typical lengths


def lengths(of_tracks: list[np.ndarray]) -> np.ndarray:
    """The typical lengths of tracks whose rows are so long, one a track."""
    track = np.repeat(np.arange(len(of_tracks)), [len(one) for one in of_tracks])
    table = pd.DataFrame({"track_id": track, "body_length_px": np.concatenate(of_tracks)})
    made = typical_lengths_px(table)
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
