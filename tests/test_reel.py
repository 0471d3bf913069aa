"""Reel: one row number for tables and pictures; a sprite is a number and an orientation."""

from itertools import product

import numpy as np
import pandas as pd
import pytest

from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.distance.picture import BODY, FILM, all_distances
from finloop.distance.reel import Reel, sprite_store_row

ORIENTATIONS, SIZE = 4, 24


class Held(list):
    """Cut-outs in memory, as a store."""

    @property
    def index(self):
        key = ["track_id", "frame", "sprite", "orientation"]
        return pd.DataFrame([(*one[:2], *one[5:]) for one in self], columns=key)


def smear(number):
    """A picture (12, 12, 2) that is like no other, nothing at its border."""
    rng = np.random.default_rng(number)
    alpha = np.pad(rng.integers(50, 256, (8, 8)), 2)
    return np.dstack([alpha // 2, alpha]).astype(np.uint8)


def reel():
    """Two tracks, of which one lacks a frame; three sprites."""
    features = pd.DataFrame({
        "track_id": [3, 3, 3, 8, 8], "frame": [5, 6, 8, 0, 1], "x_px": 20.5, "y_px": 30.5,
        "heading_deg": [0.0, 30.0, 60.0, -90.0, 170.0], "body_length_px": [8.0, 8.0, 8.0, 12.0, 12.0],
    })  # fmt: skip
    film = Held(
        Cutout(one.track_id, one.frame, 15, 25, smear(one.Index)) for one in features.itertuples()
    )
    rows = [1, 4, 0]
    sprites = features.iloc[rows].reset_index(drop=True)
    sprites = sprites.assign(
        row=rows, mirrored=[False, False, True], scale=1.0, turn_deg=7.0, orientations=ORIENTATIONS
    )
    store = Held(
        Cutout(0, 0, 15, 25, smear(100 + n), *key)
        for n, key in enumerate(product(range(3), range(1, ORIENTATIONS + 1)))
    )
    return Reel(features, film, sprites, store)


@pytest.mark.parametrize("count", [1, 4, 24, 120])
def test_sprite_row_is_a_bijection(count):
    rows = [sprite_store_row(s, o, count) for s, o in product(range(7), range(1, count + 1))]
    assert rows == list(range(7 * count))


def test_a_sprite_in_an_orientation_is_the_picture_of_its_row():
    one = reel()
    assert np.array_equal(one.read_sprite(2, 3).pixels, smear(100 + 2 * ORIENTATIONS + 2))


def test_the_next_frame_is_of_the_same_track_without_a_gap():
    one = reel()
    assert one.has_next_frame.tolist() == [True, False, False, True, False]
    assert one.next_rows(np.arange(5)).tolist() == [1, 1, 2, 4, 4]
    assert int(one.next_rows(3)) == 4


@pytest.mark.parametrize(("delta", "frames"), [(1, 1), (5, 1), (7, 1), (10, 2), (100, 20)])
def test_the_ends_of_a_step_are_a_fifth_of_delta_apart(delta, frames):
    """Whatever the camera's rate; in one track, and over no gap."""
    count = 3 * delta
    displacement = np.where(np.arange(count) < count - delta, 0.1, np.nan)
    tracks = [
        pd.DataFrame({"track_id": track, "frame": np.arange(count), "displacement": displacement})
        for track in (2, 5)
    ]
    tracks[1].loc[count - 1, "frame"] += 1
    table = pd.concat(tracks, ignore_index=True).assign(x_px=20.5, y_px=30.5)
    film = Held(Cutout(one.track_id, one.frame, 15, 25, smear(1)) for one in table.itertuples())
    first, later = Reel(table, film).step_ends
    assert set(later - first) == {frames}
    last = 2 * count - 1 - frames
    assert first.tolist() == [*range(count - frames), *range(count, last)]


@pytest.mark.parametrize("pose", [FILM, BODY])
@pytest.mark.parametrize("lot", [1, 2, 100])
def test_a_step_is_eq_5_to_the_next_frame(monkeypatch, pose, lot):
    monkeypatch.setattr("finloop.distance.reel._BATCH", lot)
    one = reel()
    shown = one.draw_rows(np.arange(5), SIZE, pose)
    wanted = np.append(all_distances(shown, shown).diagonal(1), np.nan)
    wanted[~one.has_next_frame] = np.nan
    np.testing.assert_allclose(one.measure_steps(SIZE, pose, np.arange(5)), wanted, rtol=1e-5)


def test_a_row_s_picture_does_not_depend_on_what_else_is_asked():
    one = reel()
    whole = one.draw_rows(np.arange(5), SIZE, BODY)
    some = np.array([4, 0, 4])
    assert np.array_equal(one.draw_rows(some, SIZE, BODY), whole[some])
    level = one.draw_aligned_rows(some, np.zeros(3), SIZE)
    assert np.array_equal(level, one.draw_rows(some, SIZE, FILM))


def test_what_comes_after_a_sprite_is_the_film_s_next_frame_turned_on():
    one = reel()
    after = one.draw_frames_after_sprites(SIZE)
    own = one.draw_row(1, SIZE, one.length_px, -30.0)  # nothing follows: itself, headed right
    assert np.array_equal(after[0], own)
    ahead = one.draw_row(1, SIZE, one.length_px, 7.0)[::-1]  # mirrored
    assert np.array_equal(after[2], ahead)


@pytest.mark.parametrize("change", ["cut-outs", "sprites", "pictures of sprites", "order"])
def test_what_is_not_of_one_film_is_refused(change):
    one = reel()
    film, sprites, store = one.cutouts, one.sprites, one.store
    if change == "cut-outs":
        film = Held(reversed(film))
    elif change == "sprites":
        sprites = sprites.assign(row=[1, 4, 99])
    elif change == "pictures of sprites":
        store = Held(store[1:])
    else:
        store = Held([store[1], store[0], *store[2:]])
        change = "pictures of sprites"
    with pytest.raises(FinloopError, match=change):
        Reel(one.features, film, sprites, store)
