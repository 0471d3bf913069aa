"""The postures of a film as codes: their round trip, the tail, the memory, hard films."""

import numpy as np
import pandas as pd
import pytest

from finloop.base.errors import FinloopError
from finloop.base.settings import settings
from finloop.features.memory import measure_memory_frames
from finloop.io.record import load_json, remake_hint, save_record
from finloop.io.table import load_list_columns, save_table
from finloop.pose import compute_film_poses
from finloop.pose.film import POSES, restore_poses
from finloop.puppet.pose import mirror_posture

LENGTH = 60.0


def film(bends, tails=0.0, backwards=False):
    """A table of tracks and its features: animals whose backbone bends by so much, radians."""
    bends = np.asarray(bends, float)
    n, points = len(bends), 17
    arc = np.linspace(0, 1, points)
    reach = LENGTH + np.broadcast_to(tails, n)
    angle = bends[:, None] * arc[:-1] ** 2
    step = np.stack([-np.cos(angle), np.sin(angle)], -1) * (reach / (points - 1))[:, None, None]
    lines = np.concatenate([np.zeros((n, 1, 2)), np.cumsum(step, 1)], 1) + 200.0
    along = arc * reach[:, None]
    half = np.where(along < LENGTH, 8 * np.sqrt(np.sin(np.pi * np.minimum(along / LENGTH, 1))), 1)
    shown = lines[:, ::-1] if backwards else lines
    tracks = pd.DataFrame({
        "backbone_x_px": list(shown[..., 0]), "backbone_y_px": list(shown[..., 1]),
        "half_width_px": list(half[:, ::-1] if backwards else half),
    })  # fmt: skip
    features = pd.DataFrame({
        "track_id": 3, "frame": np.arange(n), "x_px": lines[..., 0].mean(1),
        "y_px": lines[..., 1].mean(1), "heading_deg": 0.0, "body_length_px": LENGTH,
        "head_x_px": lines[:, 0, 0], "head_y_px": lines[:, 0, 1],
    })  # fmt: skip
    return tracks, features


def swinging(n=200):
    return 0.6 * np.sin(2 * np.pi * np.arange(n) / 20)


def test_postures_come_back_from_files_as_they_were(tmp_path):
    tracks, features = film(swinging())
    poses = compute_film_poses(tracks, features, settings("pose"))
    save_table(tmp_path / "poses.parquet", poses.code_table(features), POSES)
    save_record(tmp_path / "shapes.json", poses.facts)
    (codes,) = load_list_columns(tmp_path / "poses.parquet", POSES, "codes")
    again = load_json(
        tmp_path / "shapes.json",
        lambda facts: restore_poses(features, codes, facts),
        *remake_hint("pose"),
    )
    assert np.array_equal(again.codes, poses.codes)
    assert np.array_equal(again.pose.posture, poses.pose.posture)
    assert again.facts == poses.facts
    assert not again.shapes.nearest_codes(again.codes).clamped.any()
    with pytest.raises(FinloopError, match="rows"):
        load_json(
            tmp_path / "shapes.json", lambda facts: restore_poses(features[:9], codes, facts),
            *remake_hint("pose"),
        )  # fmt: skip


def test_few_codes_stand_for_the_backbones_and_mirror_as_they_do():
    tracks, features = film(swinging())
    poses = compute_film_poses(tracks, features, settings("pose"))
    line = np.stack([np.stack(tracks[f"backbone_{axis}_px"]) for axis in "xy"], -1)
    assert np.abs(poses.pose.backbone_px() - line).max() < 1.0
    assert poses.codes.shape[1] <= 3
    other = poses.shapes.decode(poses.codes @ poses.shapes.mirror_matrix)
    assert other == pytest.approx(mirror_posture(poses.shapes.decode(poses.codes)), abs=1e-6)


def test_a_backbone_from_tail_to_head_is_turned_round():
    one, other = (
        compute_film_poses(*film(swinging(), backwards=back), settings("pose"))
        for back in (False, True)
    )
    assert np.allclose(one.pose.posture, other.pose.posture)


def test_the_film_says_whether_a_tail_is_counted_apart():
    seen = np.resize([0.0, 15.0, 30.0, 45.0, 60.0], 200)
    for tails, apart in ((seen, True), (20.0, False), (0.0, False)):
        poses = compute_film_poses(*film(swinging(), tails), settings("pose"))
        assert poses.trunk == apart, poses.tail_spread
    for word, apart in (("yes", True), ("no", False)):
        p = settings("pose", separate_tail=word)
        assert compute_film_poses(*film(swinging(), seen), p).trunk == apart


def test_a_posture_is_remembered_for_a_part_of_its_beat():
    # Of a sine of 20 frames the mean square reaches half of its mean after a sixth of the beat.
    tracks, features = film(swinging())
    poses = compute_film_poses(tracks, features, settings("pose"))
    assert poses.memory_frames == pytest.approx(20 / 6, abs=0.4)
    noise = np.random.default_rng(0).normal(size=(500, 2))
    assert measure_memory_frames(noise, np.zeros(500, int)) < 1


@pytest.mark.parametrize("bends", [[0.0] * 10, swinging(10), [0.3] * 10])
def test_ten_frames_and_a_fish_that_never_bends(bends):
    poses = compute_film_poses(*film(bends), settings("pose"))
    assert len(poses.codes) == 10 and np.isfinite(poses.codes).all()
    assert np.isfinite(poses.shapes.variance_shares).all() and poses.memory_frames > 0
    assert not poses.shapes.nearest_codes(poses.codes).clamped.any()
    near = poses.shapes.nearest_codes(poses.codes + 1.0)
    assert np.isfinite(near.codes).all() and near.clamped.all()


def test_one_frame_is_too_few():
    with pytest.raises(FinloopError, match="two or more postures"):
        compute_film_poses(*film([0.1]), settings("pose"))
