"""Rest: where the film shows an animal that stays as it is; as laws."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from finloop.edit.bodies import Bodies, resting_rows
from finloop.puppet import Pose

STILL = np.r_[5:9, 20]
TURNS, BENDS, MOVES = 30, 40, 50


def film(size=1.0, cut=None):
    """Sixty rows that move on by one, but for some that stay; one only turns, one only bends."""
    rng = np.random.default_rng(0)
    way, heading, bend = np.ones(60), rng.normal(0, 20, 60), rng.normal(0, 0.2, 60)
    for only in (TURNS, BENDS, MOVES):
        way[only] = heading[only] = bend[only] = 0
    way[STILL] = heading[STILL] = bend[STILL] = 0
    heading[TURNS], bend[BENDS], way[MOVES] = 20, 0.2, 1
    posture = np.zeros((60, 6))  # two straight halves, and the bend between them
    posture[:, 0], posture[:, 3], posture[:, 4:] = 0.5, bend.cumsum(), 0.5
    place = size * way.cumsum()
    pose = Pose(place, -place, np.radians(heading.cumsum()), np.full(60, size), posture)
    goes_on = np.arange(60) < 59
    if cut is not None:
        goes_on[cut] = False
    return Bodies(SimpleNamespace(pose=pose), goes_on, pd.DataFrame())


def test_an_animal_rests_where_neither_place_nor_heading_nor_posture_changes():
    assert np.flatnonzero(resting_rows(film(), 0.01)).tolist() == STILL.tolist()


def test_rest_is_the_same_for_a_film_of_any_size():
    assert np.array_equal(resting_rows(film(7.0), 0.01), resting_rows(film(), 0.01))


def test_the_first_row_of_a_track_follows_on_nothing_and_is_no_rest():
    assert not resting_rows(film(cut=5), 0.01)[6]


@pytest.mark.parametrize(("share", "count"), [(0.0, 0), (1e3, 59)])
def test_the_share_decides(share, count):
    assert resting_rows(film(), share).sum() == count
