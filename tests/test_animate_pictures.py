"""Pictures behind an edit list: the film's steps, seams, cross-fades; ground truth from wedges."""

from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from finloop.base.cutout import Cutout
from finloop.base.settings import settings
from finloop.distance.picture import SPAN, all_distances, draw_centred_cutout
from finloop.distance.reel import Reel
from finloop.edit.bodies import Bodies
from finloop.edit.ghosts import LOOKS, measure_ghosts, tank_colour
from finloop.edit.modes import MODES
from finloop.edit.pictures import (
    Pictures,
    draw_edit_list,
    drawn_step_distances,
    measure_discontinuities,
    remove_ghost_fades,
)
from finloop.edit.schema import FRAME, SPRITE, row_picture
from finloop.features.table import find_orientations, wrap_deg
from finloop.io.cutouts import CutoutWriter, open_cutouts
from finloop.pose import FilmPoses, compute_film_poses
from finloop.sprites.orient import sprite_outlines
from stages.animate import find_doubts

ORIENTATIONS = 24  # conf/features/default.yaml

LENGTH, SIZE = 40.0, 64


def fish(length: int = 40, wide: float = 1 / 3) -> np.ndarray:
    """A dark wedge about (45, 45), head to the right, with its alpha; premultiplied."""
    half = max(1, round(length * wide / 2))
    corners = np.array(
        [[45 - length // 2, 45], [45 + length // 2, 45 - half], [45 + length // 2, 45 + half]]
    )
    cv2.fillPoly(alpha := np.zeros((90, 90), np.uint8), [corners], 255)
    return np.dstack([alpha // 3, alpha])


def rotate(pixels: np.ndarray, degrees: float) -> np.ndarray:
    return cv2.warpAffine(pixels, cv2.getRotationMatrix2D((45, 45), degrees, 1), (90, 90))


def film_of(folder: Path, *tracks: list[tuple[float, float]]) -> pd.DataFrame:
    """A film of wedges in one place: heading and width of each frame."""
    rows = [
        (track, frame, heading, wide)
        for track, frames in enumerate(tracks, 7)
        for frame, (heading, wide) in enumerate(frames)
    ]
    with CutoutWriter(folder / "film.arrow") as writer:
        for track, frame, heading, wide in rows:
            writer.write(Cutout(track, frame, 100, 200, rotate(fish(wide=wide), heading)))
    table = pd.DataFrame(rows, columns=["track_id", "frame", "heading_deg", "wide"])
    return table.assign(x_px=145.0, y_px=245.0, body_length_px=LENGTH)


def sprites_of(folder: Path, table: pd.DataFrame, rows: list[int]) -> pd.DataFrame:
    """Sprites of some rows of the film."""
    turn = np.append(wrap_deg(np.diff(table["heading_deg"])), 0.0)
    picked = table.iloc[rows].assign(
        row=rows, sequence="straight", step=np.arange(len(rows)), mirrored=False, scale=1.0,
        turn_deg=turn[rows], orientations=ORIENTATIONS,
    )  # fmt: skip
    with CutoutWriter(folder / "sprites.arrow", sprites=True) as writer:
        for sprite, row in enumerate(picked.itertuples()):
            for number in range(1, ORIENTATIONS + 1):
                pixels = rotate(fish(wide=row.wide), 15.0 * (number - 1))
                key = int(row.track_id), int(row.frame), 100, 200, pixels, sprite, number
                writer.write(Cutout(*key))
    return picked.reset_index(drop=True)


@contextmanager
def open_reel(folder: Path, table: pd.DataFrame, sprites: pd.DataFrame):
    stores = (folder / name for name in ("film.arrow", "sprites.arrow"))
    with open_cutouts(next(stores)) as film, open_cutouts(next(stores)) as store:
        yield Reel(table, film, sprites, store)


@pytest.fixture
def pictures(tmp_path):
    """Two tracks that turn and grow wider, five sprites of the first one's frames."""
    wider, narrower = (
        [(10.0 * i, 0.2 + 0.03 * i) for i in range(8)],
        [(90.0 - 5 * i, 0.5 - 0.03 * i) for i in range(6)],
    )
    table = film_of(tmp_path, wider, narrower)
    sprites = sprites_of(tmp_path, table, [0, 1, 2, 4, 5])
    with open_reel(tmp_path, table, sprites) as reel:
        yield Pictures(reel, SIZE, Bodies(poses_of(table), reel.has_next_frame, sprites))


def poses_of(table: pd.DataFrame) -> FilmPoses:
    """The postures of the wedges, none of which is bent."""
    angle = np.radians(table["heading_deg"].to_numpy(float))
    ahead = np.stack([np.cos(angle), -np.sin(angle)], -1)
    places = np.linspace(LENGTH / 2, -LENGTH / 2, 5)
    lines = table[["x_px", "y_px"]].to_numpy()[:, None] + places[:, None] * ahead[:, None]
    made = table.assign(head_x_px=lines[:, 0, 0], head_y_px=lines[:, 0, 1])
    tracks = pd.DataFrame({
        "backbone_x_px": list(lines[..., 0]), "backbone_y_px": list(lines[..., 1]),
        "half_width_px": list(np.full(lines.shape[:2], 5.0)),
    })  # fmt: skip
    return compute_film_poses(tracks, made, settings("pose"))


PICTURE = ["kind", "source", "orientation", "rotation_deg", "scale", "mirrored"]
PARTNER = [f"partner_{name}".removesuffix("_source") for name in PICTURE]


def edit_of(shown: Pictures, *ticks: tuple[str, int, float]) -> pd.DataFrame:
    """An edit list of (kind, row or sprite, heading), without cross-fades."""
    rows = []
    for kind, number, heading in ticks:
        if kind == FRAME:
            rotation = wrap_deg(heading - shown.reel.features["heading_deg"][number])
            rows.append((kind, number, pd.NA, float(rotation), 1.0, False, heading))
        else:
            sector = int(find_orientations(np.array(heading), ORIENTATIONS))
            rest = float(wrap_deg(heading - 15.0 * (sector - 1)))
            rows.append((kind, number, sector, rest, 1.0, False, heading))
    table = pd.DataFrame(rows, columns=[*PICTURE, "heading_deg"]).astype({"orientation": "Int8"})
    return table.assign(
        partner_kind=None, partner_orientation=pd.array([pd.NA] * len(rows), "Int8"), partner=pd.array([pd.NA] * len(rows), "Int32"),
        partner_rotation_deg=np.nan, partner_scale=np.nan, weight=0.0,
        partner_mirrored=False, pose=None,
    )  # fmt: skip


def add_fade(edit: pd.DataFrame, tick: int, other: pd.Series, weight: float) -> pd.DataFrame:
    edit = edit.copy()
    for name, value in zip(PARTNER, other[PICTURE], strict=True):
        edit.loc[tick, name] = value
    edit.loc[tick, "weight"] = weight
    return edit


def test_what_follows_a_sprite_is_turned_as_the_sprite_that_shows_it(tmp_path):
    table = film_of(tmp_path, [(20.0 * i, 1 / 3) for i in range(4)])
    sprites = sprites_of(tmp_path, table, [0, 1, 2])
    with open_reel(tmp_path, table, sprites) as reel:
        after, drawn = reel.draw_frames_after_sprites(SIZE), reel.draw_sprites(SIZE)
    assert drawn.shape == (3, SIZE, SIZE, 2)
    one_wedge = 0.12 * np.linalg.norm(drawn[0])  # in any frame
    assert (all_distances(after, drawn) < one_wedge).all()


def test_an_outline_is_ahead_and_to_the_left(tmp_path):
    table = film_of(tmp_path, [(0.0, 1 / 3)] * 2)
    sprites = sprites_of(tmp_path, table, [0]).assign(scale=2.0)
    with open_reel(tmp_path, table, sprites) as reel:
        hull = sprite_outlines(reel)[0]
    assert hull[:, 0].min() == pytest.approx(-40, abs=3)
    assert hull[:, 0].max() == pytest.approx(40, abs=3)
    blunt = hull[hull[:, 0] > 35]
    assert np.ptp(blunt[:, 1]) == pytest.approx(2 * 40 / 3, abs=4)


# --- what an edit list draws


def test_a_frame_and_a_sprite_of_it_are_drawn_alike(pictures):
    for heading in (0.0, 100.0, -37.0):
        edit = edit_of(pictures, (FRAME, 4, heading), (SPRITE, 3, heading), (SPRITE, 0, heading))
        one, same, other = (
            pictures(r.kind, r.source, r.orientation, r.rotation_deg, r.scale, False)
            for r in edit.itertuples()
        )
        far = np.linalg.norm(one - other)
        assert np.linalg.norm(one - same) < 0.4 * far


def test_a_picture_is_the_cut_out_itself_at_the_drawn_size(pictures):
    for row in (0, 5, 9):
        cutout, centre = pictures.reel.cutouts[row], pictures.reel.centres_px[row]
        wanted = draw_centred_cutout(cutout, centre, LENGTH, SIZE, 25.0)
        assert np.array_equal(pictures(FRAME, row, pd.NA, 25.0, 1.0, False), wanted)
    drawn = (pictures(FRAME, 0, pd.NA, 0.0, scale, False)[..., 1] for scale in (1.0, 2.0))
    one, twice = map(np.sum, drawn)
    assert twice > 2.5 * one  # 4, but for what reaches beyond the edge
    assert SPAN < 2


def test_a_still_picture_makes_no_step_and_a_turn_does(pictures):
    edit = edit_of(pictures, (FRAME, 2, 0.0), (FRAME, 2, 0.0), (FRAME, 2, 40.0))
    found = drawn_step_distances(edit, pictures)
    assert found[0] == 0 and found[1] > 5


@pytest.mark.parametrize("kind", [FRAME, SPRITE])
def test_a_drawn_cross_fade_lies_between_its_pictures(pictures, kind):
    plain = edit_of(pictures, (kind, 0, 0.0), (kind, 0, 0.0), (kind, 4, 90.0))
    whole = drawn_step_distances(plain, pictures)
    for weight in (0.25, 0.5):
        made = drawn_step_distances(add_fade(plain, 1, plain.loc[2], weight), pictures)
        assert made == pytest.approx([weight * whole[1], (1 - weight) * whole[1]], rel=1e-4)


# --- seams


def test_natural_play_has_no_seam_however_it_is_turned(pictures):
    heading = pictures.reel.features["heading_deg"].to_numpy()
    for rotation_deg in (0.0, 77.0, -140.0):
        edit = edit_of(pictures, *((FRAME, row, heading[row] + rotation_deg) for row in range(8)))
        assert [len(part) for part in measure_discontinuities(edit, pictures)] == [0, 0]
    edit = edit_of(pictures, *((SPRITE, number, 0.0) for number in (0, 1, 2)))
    assert len(measure_discontinuities(edit, pictures)[0]) == 0


@pytest.mark.parametrize("rotation_deg", [0.0, 90.0, 33.0])
def test_a_jump_is_as_far_as_the_frame_it_leaves_out(pictures, rotation_deg):
    # Rows 0, 1, 2, then row 10 in place of row 3, headed as row 3 would have been.
    headings = [
        rotation_deg,
        rotation_deg + 10,
        rotation_deg + 20,
        rotation_deg + 30,
        rotation_deg + 25,
    ]
    rows = [0, 1, 2, 10, 11]
    edit = edit_of(pictures, *((FRAME, row, h) for row, h in zip(rows, headings, strict=True)))
    found, ticks = measure_discontinuities(edit, pictures)
    assert list(ticks) == [3]
    ahead = [
        draw_centred_cutout(
            pictures.reel.cutouts[row], pictures.reel.centres_px[row], LENGTH, SIZE, -angle
        )
        for row, angle in ((3, 30.0), (10, 80.0))
    ]
    assert found == pytest.approx(np.linalg.norm(ahead[1] - ahead[0]), rel=1e-3)
    fade = add_fade(edit, 3, edit.loc[2], 0.5)  # does not count
    assert measure_discontinuities(fade, pictures)[0] == pytest.approx(found)
    turned = {name: edit[name] + [0, 0, 0, 40, 40] for name in ("rotation_deg", "heading_deg")}
    askew = edit.assign(**turned)
    assert measure_discontinuities(askew, pictures)[0][0] > 2 * found[0]


def test_a_frame_without_a_next_one_is_held_against_itself(pictures):
    edit = edit_of(pictures, (FRAME, 7, 70.0), (FRAME, 7, 70.0))
    found, ticks = measure_discontinuities(edit, pictures)
    assert list(ticks) == [1] and found == pytest.approx(0)


def test_a_picture_that_is_held_has_one_seam(pictures):
    edit = edit_of(pictures, *((SPRITE, number, 0.0) for number in (0, 1, 1, 1, 1, 2)))
    assert list(measure_discontinuities(edit, pictures)[1]) == [2]


def test_a_jump_of_sprites_is_what_the_film_does_not_show(pictures):
    edit = edit_of(pictures, *((SPRITE, number, 50.0) for number in (0, 1, 2, 0, 0, 1, 3, 4)))
    found, ticks = measure_discontinuities(edit, pictures)
    pose = all_distances(pictures.sprite_successors, pictures.right_facing_sprites)
    assert list(ticks) == [3, 4, 6]
    assert found == pytest.approx([pose[2, 0], pose[0, 0], pose[1, 3]], rel=1e-5)


def test_a_switch_between_sprite_and_frame_is_a_jump(pictures):
    # Sprite 0 is row 0: after it comes row 1, whichever way it is drawn.
    natural = edit_of(pictures, (SPRITE, 0, 40.0), (FRAME, 1, 40.0))
    found, ticks = measure_discontinuities(natural, pictures)
    assert list(ticks) == [1]
    wrong = edit_of(pictures, (SPRITE, 0, 40.0), (FRAME, 8, 40.0))
    assert found[0] < 0.3 * measure_discontinuities(wrong, pictures)[0][0]
    # And after row 0, drawn at 40°, comes row 1 at 50°: sprite 1.
    natural = edit_of(pictures, (FRAME, 0, 40.0), (SPRITE, 1, 50.0))
    found, ticks = measure_discontinuities(natural, pictures)
    assert list(ticks) == [1]
    wrong = edit_of(pictures, (FRAME, 0, 40.0), (SPRITE, 1, 90.0))
    assert found[0] < 0.3 * measure_discontinuities(wrong, pictures)[0][0]


# --- poses


def in_own_pose(edit: pd.DataFrame, shown: Pictures) -> pd.DataFrame:
    """The edit list, every tick posed as it was filmed."""
    edit = edit.copy()
    for tick, row in enumerate(edit.itertuples()):
        body = shown.bodies.body_in_edit_row(row_picture(row))
        edit.at[tick, "pose"] = shown.bodies.codes(body)
    return edit


def plain_and_posed(edit: pd.DataFrame, shown: Pictures):
    own = draw_edit_list(in_own_pose(edit, shown), shown)
    return zip(draw_edit_list(edit, shown), own, strict=True)


def test_in_its_own_pose_a_picture_is_drawn_as_without_one(pictures):
    edit = edit_of(pictures, *((FRAME, row, 33.0 * row) for row in range(5)))
    edit["mirrored"] = [False, True, False, True, False]
    for one, posed in plain_and_posed(edit, pictures):
        assert np.abs(one - posed).max() < 0.02
    assert len(measure_discontinuities(in_own_pose(edit, pictures), pictures)[0]) == 4


def test_a_sprite_in_its_own_pose_is_its_row_turned(pictures):
    edit = edit_of(pictures, *((SPRITE, number, 40.0 * number) for number in range(4)))
    step = drawn_step_distances(edit_of(pictures, (FRAME, 0, 0.0), (FRAME, 1, 0.0)), pictures)[0]
    for one, posed in plain_and_posed(edit, pictures):
        assert np.linalg.norm(one - posed) < 2 * step  # the stored one was sampled twice


def test_a_mirrored_picture_is_mirrored_about_its_heading(pictures):
    drawn = [pictures(FRAME, 3, pd.NA, -30.0, 1.0, flip) for flip in (False, True, False)]
    one, other, back = drawn
    assert np.abs(one[::-1] - other).max() < 0.2  # its heading is 30°: both head right
    assert np.array_equal(one, back)


# --- ghosts


def test_what_is_unlike_does_not_fade_and_what_is_alike_does(pictures):
    edit = edit_of(pictures, *((FRAME, row, 0.0) for row in (0, 1, 2, 3, 4, 5)))
    alike = edit_of(pictures, (FRAME, 2, 0.0), (FRAME, 2, 0.0)).loc[0]
    unlike = edit_of(pictures, (FRAME, 2, 90.0)).loc[0]
    for tick, other, weight in (
        (0, alike, 0.6),
        (1, alike, 0.3),
        (3, unlike, 0.6),
        (5, alike, 0.4),
    ):
        edit = add_fade(edit, tick, other, weight)
    kept = edit.copy()
    clean = remove_ghost_fades(edit, pictures, 8.0)
    pd.testing.assert_frame_equal(edit, kept)
    assert list(clean["weight"]) == [0.6, 0.3, 0.0, 0.0, 0.0, 0.4]
    gone = clean.loc[3, PARTNER]
    assert gone.drop("partner_mirrored").isna().all()
    same = [c for c in edit.columns if not c.startswith("partner") and c != "weight"]
    pd.testing.assert_frame_equal(clean[same], edit[same])
    assert list(remove_ghost_fades(edit, pictures, 1e9)["weight"]) == list(edit["weight"])
    assert not remove_ghost_fades(edit, pictures, 0.0)["weight"].any()


GROUND = tank_colour(np.full((4, 5), 204, np.uint8))


def ghosts_of(edit: pd.DataFrame, shown: Pictures) -> list[str]:
    """What makes a ghost of the cross-faded tick, by name."""
    ghosts = measure_ghosts(edit.assign(tick=range(len(edit))), shown, GROUND)
    assert list(ghosts.tick) == [1]
    return [name for name, far in zip(LOOKS, (ghosts.beyond > ghosts.limit)[0], strict=True) if far]


def test_a_double_image_is_a_ghost_and_a_picture_mixed_with_itself_is_none(pictures):
    plain = edit_of(pictures, *((FRAME, row, 0.0) for row in (1, 2, 2)))
    crossed = edit_of(pictures, (FRAME, 2, 90.0)).loc[0]
    for weight in (0.3, 0.7):
        assert not ghosts_of(add_fade(plain, 1, plain.loc[2], weight), pictures)
        found = ghosts_of(add_fade(plain, 1, crossed, weight), pictures)
        assert {"area", "contrast", "half_transparent"} <= {*found}


def test_unlike_outlines_are_a_ghost_as_they_are_and_none_in_one_pose(tmp_path):
    tracks = [[(20.0 * i, wide) for i in range(6)] for wide in (1 / 4, 2 / 3)]
    table = film_of(tmp_path, *tracks)
    with open_reel(tmp_path, table, sprites_of(tmp_path, table, [0])) as reel:
        shown = Pictures(reel, SIZE, Bodies(poses_of(table), reel.has_next_frame, reel.sprites))
        plain = edit_of(shown, *((FRAME, row, 0.0) for row in (1, 2, 8)))
        for weight in (0.3, 0.7):
            edit = add_fade(plain, 1, plain.loc[2], weight)
            assert "half_transparent" in ghosts_of(edit, shown)
            assert not ghosts_of(in_own_pose(edit, shown), shown)


def test_a_mode_with_double_images_becomes_a_finding():
    numbers = {mode: {"ghosts_pct": 0.4, "trials_film_pct": 9.0} for mode in MODES}
    assert find_doubts(numbers).empty
    numbers["network"]["ghosts_pct"] = 2.2
    doubts = find_doubts(numbers)
    assert list(doubts["mode"]) == ["Network"] and "2.2 %" in doubts["doubt"][0]


def test_a_ghost_once_gone_does_not_come_back(pictures):
    edit = edit_of(pictures, *((FRAME, row, 0.0) for row in (0, 1, 2, 3)))
    alike, unlike = (edit_of(pictures, (FRAME, 2, h)).loc[0] for h in (0.0, 90.0))
    for tick, other, weight in ((1, unlike, 0.75), (2, alike, 0.5), (3, alike, 0.25)):
        edit = add_fade(edit, tick, other, weight)
    assert not remove_ghost_fades(edit, pictures, 8.0)["weight"].any()
