"""Distance maps: Eq. 5 for all pairs, Eqs. 6-8 in bands; laws against brute force, and the stage."""

import numpy as np
import pandas as pd
import pytest
from conftest import TINY_CARP
from scratch import content, prepare, same_but_figures
from tiny_run import copy_of, stage_run

import finloop.distance.map
import stages.distance
from finloop.base.errors import FinloopError
from finloop.distance.map import (
    EXACT,
    PAIRS,
    STEPS,
    MapFacts,
    count_pairs,
    find_comparable_pairs,
    find_comparison_blocks,
    find_frame_kinds,
    find_map_rows,
    find_similar_pairs,
    full_distance_map,
    measure_usual_steps,
    natural_step_table,
    pair_table,
    sort_by_kind_and_area,
    subtract_mean_picture,
)
from finloop.distance.picture import BODY, FILM
from finloop.distance.reel import Reel
from finloop.features.table import FEATURES
from finloop.io.cutouts import open_cutouts
from finloop.io.numbers import load_numbers
from finloop.io.record import load_record
from finloop.io.table import load_table
from finloop.plots.distance import figure9, rows_of_longest_tracks


def brute(pictures: np.ndarray) -> np.ndarray:
    """Eq. 5 as it is written, in float64."""
    flat = pictures.reshape(len(pictures), -1).astype(np.float64)
    return np.array([np.sqrt(((flat - one) ** 2).sum(axis=1)) for one in flat])


def random_pictures(rng: np.random.Generator, count: int, size: int = 8) -> np.ndarray:
    return rng.random((count, size, size, 2), np.float32)


# --- Eq. 5


@pytest.mark.parametrize("count", [1, 2, 1300])
def test_the_full_map_is_brute_force(count):
    pictures = random_pictures(np.random.default_rng(count), count)
    kept = pictures.copy()
    found = full_distance_map(pictures)
    assert found.dtype == np.float32
    assert np.abs(found - brute(pictures)).max() < EXACT
    assert (found == found.T).all()
    assert (found.diagonal() == 0).all()
    assert (pictures == kept).all()


def test_the_full_map_is_symmetric_where_a_product_is_not(monkeypatch):
    """Some BLAS kernels round a block and its transpose differently."""
    rng = np.random.default_rng(7)

    def add_rounding(*arguments):
        block = squared(*arguments)
        return block * (1 + 1e-6 * rng.random(block.shape, np.float32))

    squared = finloop.distance.map._squared_distances
    monkeypatch.setattr(finloop.distance.map, "_squared_distances", add_rounding)
    distances = full_distance_map(random_pictures(rng, 1300))
    assert (distances == distances.T).all()
    assert (distances.diagonal() == 0).all()


@pytest.mark.parametrize("spread", [0.0, 1e-4, 1e-2])
@pytest.mark.parametrize("alone", [0, 140])
def test_close_pictures_do_not_drown_in_bright_ones(spread, alone):
    """A fish that stands still: its float32 product alone would be off by far more."""
    pictures = random_pictures(np.random.default_rng(3), 150, 32)
    pictures[alone:] = pictures[-1] + spread * pictures[alone:]
    assert np.abs(full_distance_map(pictures) - brute(pictures)).max() < EXACT


def test_white_pictures_far_from_their_mean_are_exact_too():
    pictures = np.zeros((40, 64, 64, 2), np.float32)
    pictures[:20] = 1
    pictures += 1e-3 * np.random.default_rng(4).random(pictures.shape, np.float32)
    assert np.abs(full_distance_map(pictures) - brute(pictures)).max() < EXACT


# --- Eqs. 6-8


def random_groups(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Kinds and areas, many of them equal or exactly a threshold apart."""
    count = int(rng.integers(1, 700))
    kind = rng.integers(0, rng.integers(1, 6), count)
    area = rng.random(count).astype(np.float32)
    if rng.random() < 0.6:
        area = (np.round(area * 20) / 20).astype(np.float32)
    return kind, area, float(rng.choice([0.0, 0.05, 0.1, 0.3, 1.0]))


@pytest.mark.parametrize("seed", range(12))
def test_bands_are_exactly_what_eqs_7_and_8_let_through(seed):
    rng = np.random.default_rng(seed)
    kind, area, threshold = random_groups(rng)
    pictures = random_pictures(rng, len(kind), 4)
    true = brute(pictures)
    rows = sort_by_kind_and_area(kind, area)
    centred = subtract_mean_picture(pictures[rows])
    table = pair_table(find_similar_pairs(centred, kind[rows], area[rows], threshold), rows)
    gap = np.abs(area.astype(float)[:, None] - area.astype(float))
    wanted = np.triu((kind[:, None] == kind) & (gap <= threshold), 1)
    assert (np.triu(find_comparable_pairs(kind, area, threshold), 1) == wanted).all()
    assert (np.stack([table["i"], table["j"]]) == np.nonzero(wanted)).all()  # sorted, each once
    assert np.abs(table["distance"].to_numpy() - true[wanted]).max(initial=0) < EXACT


def test_what_is_skipped_is_not_computed():
    rng = np.random.default_rng(5)
    kind, area = np.sort(rng.integers(0, 4, 4000)), rng.random(4000)
    rows = sort_by_kind_and_area(kind, area)
    kind, area = kind[rows], area[rows]
    blocks = list(find_comparison_blocks(kind, area, 0.1))
    for one, other in blocks:
        assert len({*kind[one], *kind[other]}) == 1
        assert area[other].max() - area[one].min() <= 0.1 + np.ptp(area[one])
    wanted = np.count_nonzero(np.triu(find_comparable_pairs(kind, area, 0.1), 1))
    assert wanted <= count_pairs(blocks) < 1.6 * wanted < 0.1 * len(kind) ** 2 / 2
    assert count_pairs(find_comparison_blocks(np.zeros(300), np.zeros(300), 0.0)) == 300 * 299 // 2


def table_of(types, orientations, tracks=None) -> pd.DataFrame:
    count = len(types)
    return pd.DataFrame({
        "track_id": np.zeros(count, int) if tracks is None else tracks, "frame": np.arange(count),
        "swimming_type": np.array(types, np.int8), "orientation": np.array(orientations, np.int8),
    })  # fmt: skip


def test_orientation_counts_only_as_filmed():
    every = [(kind, turn) for kind in (-1, 0, 1) for turn in range(1, 25)]
    features = table_of(*zip(*every, strict=True))
    filmed, body = find_frame_kinds(features, FILM), find_frame_kinds(features, BODY)
    assert len(set(filmed)) == 72
    swims = features["swimming_type"].to_numpy()
    assert ((body[:, None] == body) == (swims[:, None] == swims)).all()


# --- natural steps


@pytest.mark.parametrize(
    ("frames", "later"), [(1, [1, 2, 3, 0, 0, 6, 0]), (2, [2, 3, 0, 0, 0, 0, 0])]
)
def test_a_step_leads_so_many_frames_on_in_its_track_and_over_no_gap(frames, later):
    """later: the row to which each row's step leads, 0 for none."""
    features = table_of([0] * 7, [1] * 7, tracks=[3, 3, 3, 3, 8, 8, 8])
    features["frame"] = [0, 1, 2, 3, 0, 2, 3]
    pictures = random_pictures(np.random.default_rng(7), 7)
    rows = np.array([4, 0, 5, 2, 3, 1, 6])
    centred = subtract_mean_picture(pictures[rows])
    table = natural_step_table(features, centred, np.argsort(rows), frames)
    expected = np.where(later, brute(pictures)[np.arange(7), later], np.nan)
    assert table["step"].to_numpy() == pytest.approx(expected, abs=EXACT, nan_ok=True)
    assert measure_usual_steps(table)[0] == pytest.approx(np.nanmedian(expected), abs=EXACT)


@pytest.mark.parametrize("steps", [[0.0, 0.0, 3.0, np.nan], [np.nan]])
def test_a_film_that_stands_still_is_refused(steps):
    with pytest.raises(FinloopError, match="half change nothing"):
        measure_usual_steps(pd.DataFrame({"step": steps}))


def test_figure9_shows_steps_and_tints_the_pairs_that_are_skipped():
    far = np.abs(np.subtract.outer(np.arange(6.0), np.arange(6.0)))
    compared = far < 3
    every, like = figure9(far, compared, np.zeros(6, int), natural_step=2.0).axes[:2]
    np.testing.assert_allclose(every.images[0].get_array(), far / 2)
    np.testing.assert_array_equal(np.ma.getmaskarray(like.images[0].get_array()), ~compared)


def test_the_picture_shows_the_longest_tracks_in_time_order():
    features = pd.DataFrame({"track_id": [1] * 3 + [2] * 9 + [5] * 4})
    assert list(rows_of_longest_tracks(features, 9)) == list(range(3, 12))
    assert list(rows_of_longest_tracks(features, 11)) == [*range(3, 12), 12, 13]
    assert list(rows_of_longest_tracks(features, 99)) == list(range(16))


# --- the stage


features_run = stage_run("features")
workspace = copy_of("features_run")


def run_stage(folder, *overrides):
    """Run the stage; its three artifacts and its metrics."""
    prepare(folder, *TINY_CARP, *overrides)
    stages.distance.main()
    at = folder / "data/distance"
    return (
        load_table(at / "pairs.parquet", PAIRS),
        load_table(at / "steps/steps.parquet", STEPS),
        load_record(at / "steps/facts.json", MapFacts, "distance"),
        load_numbers(folder / "reports/distance"),
    )


def film(folder, pose, size):
    """The feature table and all pictures of it."""
    features = load_table(folder / "data/features/features.parquet", FEATURES)
    with open_cutouts(folder / "data/extract/cutouts.arrow") as store:
        return features, Reel(features, store).draw_rows(np.arange(len(features)), size, pose)


@pytest.mark.parametrize("pose", [BODY, FILM])
def test_the_map_of_a_part_is_that_part_of_the_map(workspace, pose, capsys):
    small = [f"frame_of_reference={pose}", "max_distance_steps=null", "picture_size_px=24"]
    small = [f"distance.{one}" for one in small]
    whole, every, _, _ = run_stage(workspace, *small)
    pairs, steps, _, metrics = run_stage(workspace, *small, "distance.max_rows=40")
    features = load_table(workspace / "data/features/features.parquet", FEATURES)
    rows = find_map_rows(features, steps)
    assert len(rows) == len(steps) == metrics["frames"] < len(features)
    assert metrics["film_mapped_pct"] == pytest.approx(100 * len(rows) / len(features), rel=1e-3)
    assert "distance.max_rows" in capsys.readouterr().err
    inside = whole[np.isin(whole[["i", "j"]], rows).all(axis=1)]
    np.testing.assert_array_equal(pairs[["i", "j"]], inside[["i", "j"]])
    np.testing.assert_allclose(pairs["distance"], inside["distance"], atol=EXACT)
    for name in ("step", "as_filmed"):
        same = steps[name].notna().to_numpy()
        assert same.any()
        np.testing.assert_allclose(steps[name][same], every[name][rows[same]], atol=EXACT)


@pytest.mark.usefixtures("no_drawing")
@pytest.mark.parametrize(
    ("pose", "keep", "threshold"),
    [(BODY, "null", 0.1), (FILM, 1.5, 0.1), (FILM, "null", 0.0), (BODY, 4.0, 0.0)],
)
def test_the_stage_keeps_what_eq_6_says(workspace, pose, keep, threshold):
    pairs, steps, facts, metrics = run_stage(
        workspace, f"distance.frame_of_reference={pose}", f"distance.max_distance_steps={keep}", "distance.picture_size_px=24",
        f"distance.motion_area_threshold={threshold}",
    )  # fmt: skip
    features, pictures = film(workspace, pose, 24)
    true = brute(pictures)
    area, swims, turn = (
        features[name].to_numpy(float)
        for name in ("motion_area_rel", "swimming_type", "orientation")
    )
    wanted = (swims[:, None] == swims) & (np.abs(area[:, None] - area) <= threshold)
    wanted &= (turn[:, None] == turn) | (pose == BODY)
    most = np.inf if keep == "null" else keep * facts.step_median
    wanted = np.triu(wanted & (true <= most), 1)
    assert (pairs[["i", "j"]].to_numpy() == np.argwhere(wanted)).all()
    assert np.abs(pairs["distance"].to_numpy() - true[wanted]).max(initial=0) < EXACT
    assert steps["step"].to_numpy()[:-1] == pytest.approx(true.diagonal(1), abs=EXACT)
    assert np.isnan(steps["step"].iloc[-1])
    filmed = brute(film(workspace, FILM, 24)[1]).diagonal(1)
    assert steps["as_filmed"].to_numpy()[:-1] == pytest.approx(filmed, abs=EXACT)
    assert (facts.frame_of_reference, facts.size, facts.area_threshold) == (pose, 24, threshold)
    assert facts.step_median == pytest.approx(np.median(true.diagonal(1)), abs=EXACT)
    assert metrics["pairs"] == len(features) * (len(features) - 1) // 2
    assert metrics["pairs_kept"] == len(pairs) <= metrics["pairs_computed"]
    assert metrics["pairs_inexact"] == 0


def test_the_stage_makes_the_same_again(workspace, request):
    run_stage(workspace)
    once = content(workspace / "data") | content(workspace / "reports")
    request.getfixturevalue("no_drawing")
    stages.distance.main()
    assert same_but_figures(once, content(workspace / "data") | content(workspace / "reports"))


@pytest.mark.usefixtures("no_drawing")
def test_nothing_kept_is_told_and_is_a_table_all_the_same(workspace, capsys):
    pairs, steps, _, metrics = run_stage(workspace, "distance.max_distance_steps=1e-6")
    assert len(pairs) == metrics["pairs_kept"] == 0
    assert len(steps) == metrics["frames"]
    assert "no two frames are similar enough" in capsys.readouterr().err
