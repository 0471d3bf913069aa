"""Eq. 5 and the pictures it is taken of."""

from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from finloop.base.cutout import Cutout
from finloop.distance.picture import SPAN, centred, distance, steps
from finloop.io.cutouts import CutoutWriter, open_cutouts
from finloop.sprites.pictures import following, outlines, pictures

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
    assert steps(shown) == pytest.approx(distance(shown, shown).diagonal(1), rel=1e-5)


def test_where_in_its_cut_out_a_fish_lies_does_not_matter():
    a = centred(fish(40, at=(45, 30)), (45, 30), 40, 64)
    b = centred(fish(40, at=(40, 25)), (40, 25), 40, 64)
    assert b == pytest.approx(a, abs=1e-5)


def test_the_mass_centre_comes_to_the_middle():
    picture = centred(fish(40), (45, 30), 40, 65)
    rows, columns = np.nonzero(picture[..., 1] > 0.5)
    wide = 65 / SPAN
    assert columns.min() == pytest.approx(32 - wide / 2, abs=1.6)
    assert columns.max() == pytest.approx(32 + wide / 2, abs=1.6)
    assert rows.mean() == pytest.approx(32, abs=0.2)


def test_fish_of_any_size_come_out_equally_long():
    small = centred(fish(40), (45, 30), 40, 64)
    large = centred(cv2.resize(fish(40), None, fx=3, fy=3), (45 * 3 + 1, 30 * 3 + 1), 120, 64)
    assert np.abs(large - small).mean() < 0.03 * (small > 0).mean()


def test_a_quarter_turn_is_anticlockwise_as_seen():
    plain = centred(fish(40), (45, 30), 40, 64)
    turned = centred(fish(40), (45, 30), 40, 64, 90)
    assert turned == pytest.approx(np.rot90(plain), abs=1 / 255)


# --- pictures behind an edit list


def film_of(folder: Path, turns: list[float]) -> pd.DataFrame:
    """A film of one wedge in one place, turned by so many degrees from frame to frame."""
    headings = np.cumsum([0.0, *turns])
    with CutoutWriter(folder / "film.arrow") as writer:
        for frame, heading in enumerate(headings):
            matrix = cv2.getRotationMatrix2D((45, 30), heading, 1)
            pixels = cv2.warpAffine(fish(40), matrix, (90, 60))
            writer.write(Cutout(7, frame, 100, 200, pixels))
    return pd.DataFrame(
        {
            "track_id": 7,
            "frame": np.arange(len(headings)),
            "x_px": 145.0,
            "y_px": 230.0,
            "heading_deg": headings,
        }
    )


def sprites_of(folder: Path, table: pd.DataFrame, frames: list[int]) -> pd.DataFrame:
    picked = table.iloc[frames].assign(
        row=frames, sequence="straight", step=np.arange(len(frames)), mirrored=False, scale=1.0,
        turn_deg=np.append(np.diff(table["heading_deg"]), 0.0)[frames],
        orientations=ORIENTATIONS,
    )  # fmt: skip
    with CutoutWriter(folder / "sprites.arrow") as writer:
        for frame in frames:
            for sector in range(ORIENTATIONS):
                matrix = cv2.getRotationMatrix2D((45, 45), 15.0 * sector, 1)
                pixels = cv2.warpAffine(
                    np.pad(fish(40), ((15, 15), (0, 0), (0, 0))), matrix, (90, 90)
                )
                writer.write(Cutout(7, frame, 100, 185, pixels))
    return picked.reset_index(drop=True)


def test_what_follows_a_sprite_is_turned_as_the_sprite_that_shows_it(tmp_path):
    table = film_of(tmp_path, [20.0, 20.0, 20.0, 0.0])
    sprites = sprites_of(tmp_path, table, [0, 1, 2])
    with (
        open_cutouts(tmp_path / "film.arrow") as film,
        open_cutouts(tmp_path / "sprites.arrow") as store,
    ):
        after = following(sprites, table, film, 40.0, SIZE)
        shown = pictures(sprites, store, 40.0, SIZE)
    assert shown.shape == (3, SIZE, SIZE, 2)
    pose = distance(after, shown)
    assert (pose < 0.12 * np.linalg.norm(shown[0])).all()  # one wedge, whichever frame it is of


def test_an_outline_is_ahead_and_to_the_left(tmp_path):
    table = film_of(tmp_path, [0.0])
    sprites = sprites_of(tmp_path, table, [0]).assign(scale=2.0)
    with open_cutouts(tmp_path / "sprites.arrow") as store:
        hull = outlines(sprites, store)[0]
    assert hull[:, 0].min() == pytest.approx(-40, abs=3)
    assert hull[:, 0].max() == pytest.approx(40, abs=3)
    blunt = hull[hull[:, 0] > 35]
    assert np.ptp(blunt[:, 1]) == pytest.approx(2 * 40 / 3, abs=4)
