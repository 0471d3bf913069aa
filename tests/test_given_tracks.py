"""Tracks of other programs: read in every format, laid over the film of drawn carp, refused if false.

The truth of three drawn carp is what the programs would have said. Formats that `movement` reads
are written by it, or by the program's own library; those tests need the extra `tracks`.
"""

import json
import pickle
import re
import shutil
from contextlib import chdir
from dataclasses import replace
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hostile import Runs
from scratch import content, prepare

import finloop
import stages.clip
import stages.extract
import stages.features
from finloop.base.errors import FinloopError
from finloop.base.poses import Poses, poses_from_arrays
from finloop.base.schema import lists_to_points
from finloop.base.settings import settings
from finloop.drawn.truth import TRUTH
from finloop.export.tracks import deeplabcut_tables
from finloop.extract.film import Detections
from finloop.extract.given import (
    ExternalTrackLinker,
    FilmSize,
    SilhouetteFit,
    find_keypoint,
    longest_run_frames,
    map_poses_to_clip,
    match_silhouettes,
    measure_silhouette_fit,
    refuse_other_film,
)
from finloop.extract.load_given import find_tracks_path, make_pixels_square
from finloop.extract.settings import ExtractSettings
from finloop.extract.table import GIVEN, tracks_schema
from finloop.extract.tracks import SilhouettePlace
from finloop.features.head import decide_head_end, match_head_end
from finloop.features.metrics import compare_heads_with_external
from finloop.features.table import measure_features
from finloop.io.numbers import load_numbers
from finloop.io.poses import load_poses
from finloop.io.several import JoinedFilm, join_clips
from finloop.io.table import load_table, save_csv_in_blocks, save_table
from finloop.io.video import FRAMES, load_facts, load_mask
from finloop.verbs import Film

FRAMES_OF_FILM, FISH = 24, 3
CARP = ["clip=carp", f"clip.frames={FRAMES_OF_FILM}", f"clip.fish={FISH}", "clip.width_px=360",
        "clip.height_px=270", "clip.body_length_px=50", "clip.colour=false", "clip.seed=3"]  # fmt: skip
NAMES = ("anna", "berta", "carl")
LENGTH = 50.0
needs_movement = pytest.mark.skipif(
    find_spec("movement") is None, reason="the extra `tracks` is not installed: make tracks"
)


def truth_as_poses(truth: pd.DataFrame) -> Poses:
    """What a program that never errs says: head, tail and centre of every carp."""
    table = truth.sort_values(["frame", "fish_id"])
    named = [("head_x_px", "head_y_px"), ("tail_x_px", "tail_y_px"), ("x_px", "y_px")]
    places = np.stack([table[list(pair)].to_numpy() for pair in named], axis=1)
    places = places.reshape(-1, FISH, 3, 2)
    points, frames = ("Nose", "tail_tip", "centre"), np.arange(len(places))
    return poses_from_arrays(NAMES, points, frames, places, np.ones(places.shape[:3]))


def arrays(poses: Poses) -> np.ndarray:
    """Places (frames, individuals, keypoints, 2), NaN where there are none."""
    places = np.full((poses.frames, len(poses.individuals), *poses.places.shape[1:]), np.nan)
    places[poses.frame, poses.individual] = poses.places
    return places


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    """A folder with the clip of drawn carp; and the truth as poses."""
    folder = tmp_path_factory.mktemp("film")
    prepare(folder, *CARP)
    with chdir(folder):
        stages.clip.main()
    return folder, truth_as_poses(load_table(folder / "data/clip/truth.parquet", TRUTH))


def trex(folder: Path, poses: Poses, cm_per_pixel: float = 0.02) -> Path:
    """What TRex exports: a file for each animal."""
    folder.mkdir()
    for number, name in enumerate(poses.individuals):
        rows = poses.individual == number
        head, centre = (poses.places[rows, k].T * cm_per_pixel for k in (0, 2))
        np.savez(
            folder / f"film_{name}.npz", frame=poses.frame[rows], missing=np.zeros(rows.sum()),
            cm_per_pixel=np.array([cm_per_pixel]), ANGLE=np.zeros(rows.sum()),
            **{"X": head[0], "Y": head[1], "X#wcentroid": centre[0], "Y#wcentroid": centre[1]},
        )  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def tracks_run(film, tmp_path_factory):
    """The clip extracted and measured by tracks of a file, here TRex's."""
    source, poses = film
    folder = tmp_path_factory.mktemp("extracted")
    (folder / "data").mkdir()
    (folder / "data/clip").symlink_to(source / "data/clip")
    path = trex(folder / "trex", poses)
    prepare(folder, *CARP, f"extract.tracks_path={path}")
    with chdir(folder):
        stages.extract.main()
        stages.features.main()
    return folder


def table(folder, name):
    schema = {"tracks": tracks_schema(33), "given": GIVEN}[name]
    return load_table(folder / f"data/extract/{name}.parquet", schema)


def numbers(folder, stage):
    return load_numbers(folder / f"reports/{stage}")


# --- a whole film --------------------------------------------------------------------------------


def test_identities_are_those_of_the_file(tracks_run, film):
    tracks, given, poses = table(tracks_run, "tracks"), table(tracks_run, "given"), film[1]
    assert tracks[["track_id", "frame"]].equals(given[["track_id", "frame"]])
    assert set(given["animal"]) == set(NAMES)
    places = arrays(poses)
    animal = given["animal"].map(NAMES.index).to_numpy()
    assert (tracks["track_id"] % FISH == animal).all()
    true = places[tracks["frame"], animal]
    apart = np.hypot(*(tracks[["x_px", "y_px"]].to_numpy() - true[:, 2]).T)
    assert np.median(apart) < 0.5 and apart.max() < 1.5
    told = given[["head_x_px", "head_y_px"]].to_numpy()
    assert np.abs(told - true[:, 0]).max() < 1e-3
    ways = np.linalg.norm(places[:, None, :, 2] - places[:, :, None, 2], axis=-1)
    assert ways[ways > 0].min() > LENGTH / 2  # no carp could have been taken for another


def test_what_became_of_the_places_is_counted(tracks_run):
    made = numbers(tracks_run, "extract")
    assert made["places"] == FRAMES_OF_FILM * FISH
    kinds = ("used", "no_silhouette", "shared", "not_isolated")
    assert sum(made[f"places_{kind}"] for kind in kinds) == made["places"]
    assert made["fish_frames"] == made["places_used"] - made["places_in_short_runs"]
    assert made["fish_frames"] == len(table(tracks_run, "tracks"))
    assert made["places_used_share"] > 0.95
    assert made["animals"] == made["animals_used"] == FISH
    assert made["places_near_a_silhouette_share"] == 1.0


def test_heads_of_the_file_agree_with_those_found(tracks_run):
    made = numbers(tracks_run, "features")
    assert made["head_told_share"] == 1.0
    assert made["head_disagreement_share"] == 0.0
    assert made["head_disagreement_median_deg"] < 15
    assert made["truth_head_tail_swaps"] == made["truth_identity_changes"] == 0


def test_swapped_heads_decide_and_are_reported(tracks_run):
    tracks, given = table(tracks_run, "tracks"), table(tracks_run, "given")
    swapped = (given["track_id"] == 1).to_numpy()
    line = lists_to_points(tracks, "backbone")
    heads = given[["head_x_px", "head_y_px"]].to_numpy()
    told = match_head_end(line, heads, np.full(heads.shape, np.nan))
    ends = np.where((told == 1)[:, None], line[:, -1], line[:, 0])  # the tail as it was told
    given.loc[swapped, ["head_x_px", "head_y_px"]] = ends[swapped]
    made = compare_heads_with_external(tracks, given, 25.0)
    assert made["head_disagreement_share"] == pytest.approx(swapped.mean())
    p = settings("features")
    plain, _ = measure_features(tracks, 25.0, p)
    led, _ = measure_features(tracks, 25.0, p, given)
    head, tail = (["head_x_px", "head_y_px"], ["tail_x_px", "tail_y_px"])
    assert np.allclose(led.loc[swapped, head], plain.loc[swapped, tail])
    assert np.allclose(led.loc[~swapped, head], plain.loc[~swapped, head])
    total = led["head_confidence"] + plain["head_confidence"]
    assert np.allclose(total[swapped], 1.0, atol=1e-5)  # ours stays: it says that they are wrong


def test_the_same_again_and_nothing_where_it_fails(tracks_run, monkeypatch):
    monkeypatch.chdir(tracks_run)
    first = content(tracks_run / "data/extract")
    assert "given.parquet" in first
    prepare(tracks_run, *CARP, "extract.tracks_path=/nowhere")
    with pytest.raises(FinloopError, match="nothing at"):
        stages.extract.main()
    assert content(tracks_run / "data/extract") == first


def test_the_verbs_take_tracks_of_centres_alone(film, tmp_path):
    places = arrays(film[1])[:, :, 2].copy()
    ghost = np.tile([300.0, 20.0], (FRAMES_OF_FILM, 1))[:, None]
    ghost[2:] = np.nan
    np.save(tmp_path / "a.npy", np.concatenate([places, ghost], axis=1))
    clip = film[0] / "data/clip"
    facts = load_facts(clip / "facts.json")
    shown = Film(clip, facts, load_mask(clip / "arena.png", facts.width_px, facts.height_px))
    tracks = finloop.track(shown, tmp_path, tracks_path=str(tmp_path / "a.npy"))
    assert set(tracks.given["animal"]) == {"1", "2", "3"}
    assert tracks.given[["head_x_px", "tail_x_px"]].isna().all(axis=None)
    plain, _ = measure_features(tracks.table, 25.0, settings("features"))
    pd.testing.assert_frame_equal(finloop.measure(tracks), plain, check_dtype=False, rtol=1e-5)


def test_what_is_used_is_said():
    unused = {"no_silhouette": 0, "shared": 50, "not_isolated": 0, "in_short_runs": 75}
    numbers = {"places_used_share": 0.875, "animals": 4, "animals_used": 3, "places": 1000}
    numbers |= {f"places_{why}": count for why, count in unused.items()}
    used, unseen = stages.extract.describe_used_positions(numbers)
    assert "87.5%" in used and "4 animals 1 never" in unseen
    assert "5.0% share a silhouette; 7.5% are in runs" in used and "no silhouette" not in used
    assert len([*stages.extract.describe_used_positions(numbers | {"animals_used": 4})]) == 1
    assert not [*stages.extract.describe_used_positions({})]


def test_each_of_several_films_has_its_tracks(tmp_path):
    for name in ("a.mp4", "aDLC_resnet.h5", "b.mp4", "b_1.h5", "b_2.h5", "[c].mp4", "[c]x.h5"):
        (tmp_path / name).touch()
    pattern = "{folder}/{name}*.h5"
    assert find_tracks_path(tmp_path / "a.mp4", pattern) == str(tmp_path / "aDLC_resnet.h5")
    assert find_tracks_path(tmp_path / "[c].mp4", pattern) == str(tmp_path / "[c]x.h5")
    assert find_tracks_path(Path("b.mp4"), f"{tmp_path}/{{name}}_2.h5") == str(tmp_path / "b_2.h5")
    for film, said in (("b.mp4", "2 tracks of"), ("d.mp4", "0 tracks of")):
        with pytest.raises(FinloopError, match=said):
            find_tracks_path(tmp_path / film, pattern)
    (tmp_path / "aDLC_resnet_filtered.h5").touch()
    filtered = str(tmp_path / "aDLC_resnet_filtered.h5")
    assert find_tracks_path(tmp_path / "a.mp4", pattern) == filtered
    with pytest.raises(FinloopError, match="several films, and one file"):
        find_tracks_path(tmp_path / "a.mp4", "a.h5")


def test_several_films_of_another_programs_tracks_become_one(
    film, tracks_run, tmp_path, monkeypatch
):
    """The same film and tracks twice; a third film has no tracks, and is left out."""
    clip, code = tmp_path / "data/clip", "{folder}/{name}"
    for name in "abc":
        shutil.copytree(film[0] / "data/clip", clip / "films" / name)
        if name < "c":
            shutil.copytree(tracks_run / "trex", tmp_path / name)
    join_clips(clip, [JoinedFilm(name, str(tmp_path / f"{name}.mp4")) for name in "abc"])
    prepare(tmp_path, *CARP, f"extract.tracks_path='{code}'")
    monkeypatch.chdir(tmp_path)
    stages.extract.main()
    tracks, given = table(tmp_path, "tracks"), table(tmp_path, "given")
    alone = table(tracks_run, "given")
    assert tracks[["track_id", "frame"]].equals(given[["track_id", "frame"]])
    assert set(given["animal"]) == {f"{name}-{animal}" for name in "ab" for animal in NAMES}
    ends = ["head_x_px", "head_y_px"]
    for name, start in (("a", 0), ("b", FRAMES_OF_FILM)):
        rows = given["animal"].str.startswith(name)
        assert np.array_equal(given.loc[rows, ends], alone[ends])
        assert (given.loc[rows, "frame"].to_numpy() == alone["frame"] + start).all()
    assert numbers(tmp_path, "extract")["films_left_out"] == 1


# --- places and silhouettes ----------------------------------------------------------------------


def spot(x, y, isolated=True, long=10, wide=4):
    """A silhouette that is a rectangle about a place."""
    left, top, right, bottom = x - long, y - wide, x + long, y + wide
    corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
    outline = np.array(corners, np.int32)[:, None]
    box = (left, top, right + 1, bottom + 1)
    return SilhouettePlace(x, y, 4.0 * long * wide, box, isolated, outline)


def place_array(*places):
    return np.array(places, float)[:, None]


@pytest.mark.parametrize(
    ("places", "spots", "outcomes"),
    [
        ([(50, 50)], [(50, 50)], [("used", 0)]),
        ([(55, 53)], [(50, 50), (90, 50)], [("used", 0)]),
        ([(50, 62)], [(50, 50)], [("used", 0)]),  # beside it, within a body length
        ([(50, 75)], [(50, 50)], [("no silhouette", None)]),
        ([(50, 50)], [], [("no silhouette", None)]),
        ([(45, 50), (55, 50)], [(50, 50)], [("shared", 0), ("shared", 0)]),
        ([(50, 50), (50, 62)], [(50, 50)], [("used", 0), ("no silhouette", None)]),
        ([(50, 40), (50, 62)], [(50, 50)], [("shared", 0), ("shared", 0)]),
        ([(50, 50), (50, 66)], [(50, 50), (50, 75)], [("used", 0), ("used", 1)]),
        ([(53, 50)], [(47, 50), (52, 50), (60, 50)], [("used", 1)]),  # they overlap
        ([(50, 50)], [(50, 50, False)], [("not isolated", 0)]),
    ],
)
def test_a_place_takes_the_silhouette_that_it_is_in_or_near(places, spots, outcomes):
    silhouettes = [spot(*one) for one in spots]
    assert match_silhouettes(place_array(*places), silhouettes, 20.0) == outcomes
    mirrored = match_silhouettes(place_array(*places[::-1]), silhouettes, 20.0)
    assert mirrored == outcomes[::-1]


def test_only_given_points_count():
    points = np.array([[(41, 50), (np.nan, np.nan), (59, 50)]])
    assert match_silhouettes(points, [spot(50, 50), spot(50, 60)], 20.0) == [("used", 0)]


def poses_at(places, frames=None, names=None):
    """Poses of one point for each animal: places (frames, animals, 2)."""
    places = np.asarray(places, float)[:, :, None]
    frames = np.arange(len(places)) if frames is None else np.asarray(frames)
    names = names or tuple("abcdefgh"[: places.shape[1]])
    return poses_from_arrays(names, ("centre",), frames, places)


def file_settings(**changes):
    return settings("extract", tracks_path="somewhere", **changes)


def map_poses(poses, shown=None, size=(200, 150), frames=None, **changes):
    shown = np.arange(poses.frames) if shown is None else np.asarray(shown)
    film_size = FilmSize(int(shown.max()) + 1 if frames is None else frames, *size)
    return map_poses_to_clip(poses, shown, film_size, file_settings(**changes))


def run(told, frames, cuts=(), least=3):
    """Track numbers by frame of toy silhouettes, and what the run has counted."""
    followed = ExternalTrackLinker(told, 20.0, least)
    seen = (Detections(["fish"] * len(spots), spots, [object()] * len(spots)) for spots in frames)
    rows = [(f.track_id, f.frame) for _, ready in followed.link_frames(seen, cuts) for f in ready]
    return sorted(rows), followed


def test_a_gap_or_a_cut_ends_a_track_and_the_animal_stays():
    count = 20
    places = np.stack([np.linspace([30, y], [130, y], count) for y in (30, 90)], 1)
    places[8:10, 1] = np.nan
    film = [[spot(*map(int, place)) for place in (frame[0], (frame[0][0], 90))] for frame in places]
    rows, followed = run(map_poses(poses_at(places)), film, cuts=[15])
    assert {track for track, _ in rows} == {0, 2, 1, 3, 5}
    frames = {k: [frame for track, frame in rows if track == k] for k in range(6)}
    assert frames[0] == list(range(15)) and frames[2] == list(range(15, 20))
    assert (frames[1], frames[3], frames[5]) == ([*range(8)], [*range(10, 15)], [*range(15, 20)])
    assert followed.short == 0 and followed.outcomes == {(0, "used"): 20, (1, "used"): 18}


def test_short_runs_are_dropped_and_counted():
    places = np.full((10, 1, 2), np.nan)
    places[[0, 1, 4, 5, 6]] = 50
    rows, followed = run(map_poses(poses_at(places)), [[spot(50, 50)]] * 10)
    assert rows == [(0, 4), (0, 5), (0, 6)] and followed.short == 2


def test_tracks_with_too_many_gaps_are_refused_by_their_gaps():
    """Every 7th place is infinite: no run is as long as a track."""
    places = np.full((30, 2, 2), 50.0) + [[0, 0], [40, 40]]
    places[::7] = np.inf
    told = map_poses(poses_at(places))
    rows, followed = run(told, [[spot(50, 50), spot(90, 90)]] * 30, least=8)
    assert not rows and longest_run_frames(told) == 6
    error = followed.no_track_error()
    assert "for 6 frames at most, and 5 of 30 frames have no place" in error.came
    assert "places: 50 used" in error.came
    assert "8 frames on end" in error.wanted and "fill the gaps" in error.do


def test_places_without_gaps_are_not_told_to_fill_them():
    told = map_poses(poses_at(np.full((30, 1, 2), 50.0)), tracks_px_per_unit=1.5)
    assert (told.points == 75).all()
    rows, followed = run(told, [[spot(75, 75, isolated=False)]] * 30)
    error = followed.no_track_error()
    assert not rows and longest_run_frames(told) == 30
    assert "30 not isolated" in error.came and "extract.tracks_path=null" in error.do
    assert "fill" not in error.do
    places = np.full((12, 2, 2), np.nan)
    places[:6, 0] = places[6:, 1] = 50.0
    told = map_poses(poses_at(places))
    assert longest_run_frames(told) == 6  # runs of two animals are not added up


def test_infinite_places_end_the_stage_with_their_gaps(film, tmp_path, monkeypatch):
    places = arrays(film[1])[:, :, 2].copy()
    places[::7] = np.inf
    np.save(tmp_path / "a.npy", places)
    (tmp_path / "data").mkdir()
    (tmp_path / "data/clip").symlink_to(film[0] / "data/clip")
    prepare(tmp_path, *CARP, f"extract.tracks_path={tmp_path}/a.npy",
            "extract.min_track_frames=8")  # fmt: skip
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FinloopError, match=r"6 frames at most(?s:.*)fill the gaps"):
        stages.extract.main()
    assert not (tmp_path / "data/extract").exists()


def test_frames_of_the_film_are_found_in_a_clip_that_begins_late_repeats_and_drops():
    places = np.stack([np.arange(20.0) * 5 + 20, np.full(20, 40.0)], 1)[:, None]
    shown = [5, 6, 6, 8, 9]
    told = map_poses(poses_at(places), shown, frames=20)
    assert [told.points[told.rows_of_frame(k)][0, 0, 0] for k in range(5)] == [45, 50, 50, 60, 65]
    rows = told.find_rows(np.arange(5), np.zeros(5, int))
    assert told.points[rows, 0, 0].tolist() == [45, 50, 50, 60, 65]
    scaled = map_poses(poses_at(places / 2), shown, frames=20, tracks_px_per_unit=2.0)
    np.testing.assert_allclose(scaled.points, told.points)


def test_points_of_little_confidence_count_as_not_given(monkeypatch):
    poses = poses_at(np.full((4, 1, 2), 50.0))
    doubtful = Poses(**vars(poses) | {"confidence": np.array([[0.1], [0.9], [np.nan], [0.2]])})
    assert np.diff(map_poses(doubtful).stop).sum() == 3 and len(map_poses(doubtful).points) == 3
    monkeypatch.setattr(ExtractSettings, "tracks_least_confidence", 0.95)
    with pytest.raises(FinloopError, match=r"confidence of 0\.95"):
        map_poses(Poses(**vars(doubtful) | {"confidence": np.full((4, 1), 0.5)}))


# --- head and tail -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("centre", "Nose", "tailBase", "tail_tip"), ("Nose", "tail_tip")),
        (("head", "snout", "tail"), ("snout", "tail")),
        (("HEAD", "body"), ("HEAD", None)),
        (("a", "b"), (None, None)),
    ],
)
def test_keypoints_of_head_and_tail_are_known_or_named(names, expected):
    places = np.arange(len(names))[:, None] + np.full((3, 1, len(names), 2), 50.0)
    told = map_poses(poses_from_arrays(("x",), names, np.arange(3), places))
    for name, place in zip(expected, (told.head, told.tail), strict=True):
        assert (place == 50 + names.index(name)).all() if name else np.isnan(place).all()
    assert find_keypoint(names, names[1], (), "tracks_head_keypoint") == names[1]
    assert find_keypoint(names, "none", names, "tracks_head_keypoint") is None
    with pytest.raises(FinloopError, match="no keypoint 'nose'"):
        find_keypoint(names, "nose", (), "tracks_head_keypoint")


def test_which_end_is_told_to_be_the_head():
    line = np.linspace([0, 0], [40, 0], 9)[None].repeat(5, 0)
    none = [np.nan, np.nan]
    head = np.array([[1, 2], [38, 1], none, none, [1, 0]])
    tail = np.array([[41, 0], none, [-2, 0], none, [3, 0]])
    assert match_head_end(line, head, tail).tolist() == [1, -1, -1, 0, 1]


def test_a_head_that_is_told_now_and_then_leads_the_frames_between():
    line = np.linspace([40, 0], [0, 0], 9)[None] + np.arange(30)[:, None, None] * [2.0, 0]
    widths = np.tile(np.linspace(6, 2, 9), (30, 1))
    first, sure = decide_head_end(line, widths, 25.0)
    assert first.all()
    told = np.zeros(30, np.int8)
    told[[3, 20]] = -1
    led, doubt = decide_head_end(line, widths, 25.0, told)
    assert not led.any()
    assert np.allclose(sure + doubt, 1)


# --- bad input -----------------------------------------------------------------------------------


def moving(frames=30, animals=3, seed=0):
    """Animals that swim about in a tank of 200×150 px, and their silhouettes."""
    rng = np.random.default_rng(seed)
    rounds = rng.uniform(0, 2 * np.pi, animals) + np.arange(frames)[:, None] * 0.4
    places = np.stack([100 + 60 * np.cos(rounds), 75 + 45 * np.sin(1.7 * rounds)], -1)
    return places, [[spot(*place.astype(int)) for place in frame] for frame in places]


def map_and_fit(places, film, names=None):
    told = map_poses(poses_at(places, names=names))
    frames = list(range(len(film)))
    return told, measure_silhouette_fit(told, frames, film, 12.0)


def test_tracks_of_this_film_fit_and_those_of_another_do_not():
    places, film = moving()
    told, good = map_and_fit(places, film)
    assert good.share == 1.0 > good.least_share > good.chance
    refuse_other_film(told, good)
    told, bad = map_and_fit(moving(seed=5)[0] + 3, film)
    with pytest.raises(FinloopError, match=f"{bad.share:.0%} show an animal"):
        refuse_other_film(told, bad)


def test_animals_that_rest_fit_at_all_moments():
    places = np.tile([[[50.0, 50.0], [120.0, 90.0]]], (20, 1, 1))
    told, good = map_and_fit(places, [[spot(50, 50), spot(120, 90)]] * 20)
    assert good.chance == good.share == 1.0
    needed = [SilhouetteFit(1.0, chance, 9, (), 1).least_share for chance in (0.0, 0.4, 0.9)]
    assert needed == [0.5, 0.7, 0.9]  # between chance and all
    refuse_other_film(told, good)


def test_more_animals_than_there_are_is_said():
    places, film = moving()
    ghosts = np.stack([np.tile([5.0 + 35 * k, 5.0], (30, 1)) for k in range(5)], axis=1)
    told, bad = map_and_fit(np.concatenate([places, ghosts], axis=1), film, tuple("abcdefgh"))
    assert bad.lost == (3, 4, 5, 6, 7) and bad.seen == 3
    said = r"8 animals(.|\n)*At most 3 silhouettes(.|\n)*d, e, f, g, h"
    with pytest.raises(FinloopError, match=said):
        refuse_other_film(told, bad)


@pytest.mark.parametrize(
    ("places", "changes", "said"),
    [
        (np.random.default_rng(0).random((9, 2, 2)), {}, "shares of the picture"),
        (np.full((9, 2, 2), 400.0), {}, "100% of the places lie outside"),
        (np.full((9, 2, 2), 50.0), {"tracks_px_per_unit": 10.0}, "outside the picture"),
        (np.full((9, 2, 2), -50.0), {}, "outside the picture"),
        (np.full((60, 2, 2), 50.0), {"frames": 9, "shown": range(9)}, "film has 9 frames"),
        (np.full((9, 2, 2), 50.0), {"frames": 90, "shown": range(90)}, "to at least its middle"),
        (np.full((9, 2, 2), 50.0), {"frames": 90, "shown": range(40, 50)}, "not from clip.start_s"),
    ],
)
def test_other_units_and_other_lengths_are_said(places, changes, said):
    with pytest.raises(FinloopError) as caught:
        map_poses(poses_at(places), **changes)
    assert said in str(caught.value)


def test_a_few_frames_more_or_fewer_are_no_fault():
    places = np.full((40, 1, 2), 50.0)
    assert map_poses(poses_at(places), range(38), frames=38).stop[-1] == 38
    assert map_poses(poses_at(places), range(60), frames=60).stop[-1] == 40


@pytest.mark.parametrize(
    ("name", "made", "said"),
    [
        (".", None, "is unknown"),
        ("a.txt", b"1 2 3", "is unknown"),
        ("a.xlsx", b"PK", "is a spreadsheet"),
        ("a.csv", b"p,q\n1,2\n", "is unknown"),
        ("a.csv", b"", "is unknown"),
        ("a.csv", b"\xff\xfe\x00scorer", "cannot be read"),
        ("a.npz", b"no zip", "tracks of TRex"),
        ("a.npy", b"\x93NUMPY", "tracks of idtracker.ai"),
        ("a.npy", None, "does not say where any animal is"),
        ("a.parquet", b"PAR1", "tracks of idtracker.ai"),
    ],
)
def test_a_file_that_is_none_is_said(tmp_path, name, made, said):
    if made is not None:
        (tmp_path / name).write_bytes(made)
    elif name == "a.npy":
        np.save(tmp_path / name, np.full((5, 2, 2), np.nan))
    with pytest.raises(FinloopError, match=said):
        load_poses(tmp_path / name, None, 25.0)


def test_the_missing_extra_is_named(tmp_path, monkeypatch):
    missing = "finloop.io.poses.extra.import_module"
    monkeypatch.setattr(missing, lambda name: __import__("no_" + name))
    (tmp_path / "tracks.nwb").write_bytes(b"any")
    with pytest.raises(FinloopError, match="extra `tracks`") as caught:
        load_poses(tmp_path / "tracks.nwb", None, 25.0)
    assert caught.value.do == "make tracks"


def test_a_clip_without_its_frames_is_said(film, tracks_run, tmp_path, monkeypatch):
    shutil.copytree(film[0] / "data/clip", tmp_path / "data/clip")
    (tmp_path / "data/clip/frames.parquet").unlink()
    path = tracks_run / "trex"
    prepare(tmp_path, *CARP, f"extract.tracks_path={path}")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FinloopError, match=r"frames\.parquet"):
        stages.extract.main()
    late = pd.DataFrame({"frame": range(24), "source_frame": range(100, 124)})
    save_table(tmp_path / "data/clip/frames.parquet", late, FRAMES)
    with pytest.raises(FinloopError, match="frames 100 … 123"):
        stages.extract.main()


# --- formats -------------------------------------------------------------------------------------


def idtracker(places, **more):
    """What idtracker.ai keeps of its trajectories."""
    return {
        "trajectories": places, "identities_labels": list(NAMES), "frames_per_second": 25.0,
        "video_paths": [Path("film.mp4")], "areas": {"mean": np.ones(3)}, "length_unit": None, **more,
    }  # fmt: skip


def long_table(places):
    frame, animal = (one.ravel() for one in np.indices(places.shape[:2]))
    x, y = places.reshape(-1, 2).T
    return pd.DataFrame({"frame": frame, "time": frame / 25, "individual": animal, "x": x, "y": y})


def write_idtracker(kind: str, folder: Path, places: np.ndarray) -> Path:
    """Write trajectories as idtracker.ai does; return what a user names."""
    named = {"identities_labels": list(NAMES)}
    match kind:
        case "npy":
            home = folder / "session_film" / "trajectories"
            home.mkdir(parents=True)
            np.save(home / "trajectories.npy", np.array(idtracker(places), dtype=object))
            return home.parent
        case "pickle":
            (folder / "with_gaps.pickle").write_bytes(pickle.dumps(idtracker(places)))
            return folder
        case "csv folder":
            home = folder / "trajectories_csv"
            home.mkdir()
            axes = [f"{c}{k}" for k in (1, 2, 3) for c in "xy"]
            wide = pd.DataFrame(places.reshape(len(places), -1), columns=axes)
            wide.insert(0, "time", np.arange(len(places)) / 25)
            wide.to_csv(home / "trajectories.csv", index=False)
            (home / "attributes.json").write_text(json.dumps(named))
            return home / "trajectories.csv"
        case "tidy csv":
            long_table(places).to_csv(folder / "trajectories_tidy.csv", index=False)
            (folder / "attributes_tidy.json").write_text(json.dumps(named))
            return folder / "trajectories_tidy.csv"
        case "parquet":
            plain = pa.Table.from_pandas(long_table(places))
            facts = {"idtrackerai_attributes": json.dumps(named)} | plain.schema.metadata
            pq.write_table(plain.replace_schema_metadata(facts), folder / "trajectories.parquet")
            return folder / "trajectories.parquet"
    h5py = pytest.importorskip("h5py", reason="the extra `tracks` is not installed: make tracks")
    with h5py.File(folder / "trajectories.h5", "w") as file:
        file.create_dataset("trajectories", data=places)
        file.attrs.update(named)
    return folder / "trajectories.h5"


def test_other_columns_of_a_wide_csv_of_idtracker_are_left_out(tmp_path):
    path = tmp_path / "trajectories.csv"
    path.write_text("seconds,x1,y1,p1,x2,y2,p2\n0,1,2,0.9,3,4,0.8\n0.04,5,6,1,7,8,1\n")
    assert arrays(load_poses(path, None, 25.0))[:, :, 0].tolist() == [
        [[1, 2], [3, 4]],
        [[5, 6], [7, 8]],
    ]


@pytest.mark.parametrize("kind", ["npy", "pickle", "csv folder", "tidy csv", "parquet", "h5"])
def test_trajectories_of_idtracker(tmp_path, film, kind):
    places = arrays(film[1])[:, :, 2].copy()
    places[3, 1] = np.nan
    poses = load_poses(write_idtracker(kind, tmp_path, places), None, 25.0)
    assert (poses.individuals, poses.keypoints) == (NAMES, ("centre",))
    assert poses.frames == FRAMES_OF_FILM
    np.testing.assert_allclose(arrays(poses)[:, :, 0], places, atol=1e-9)
    assert len(poses.frame) == FRAMES_OF_FILM * FISH - 1 and np.isnan(poses.confidence).all()


def test_of_a_session_the_file_is_read_that_needs_no_optional_package(tmp_path, film):
    session = write_idtracker("npy", tmp_path, arrays(film[1])[:, :, 2])
    (session / "trajectories/trajectories.h5").write_bytes(b"")
    assert load_poses(session, "idtracker.ai", 25.0).individuals == NAMES


def test_old_trajectories_without_names_and_a_bare_array(tmp_path, film):
    places = arrays(film[1])[:, :, 2]
    np.save(tmp_path / "a.npy", places)
    np.save(tmp_path / "b.npy", np.array({"trajectories": places}, dtype=object))
    for name in "ab":
        poses = load_poses(tmp_path / f"{name}.npy", None, 25.0)
        assert poses.individuals == ("1", "2", "3")
        np.testing.assert_array_equal(arrays(poses)[:, :, 0], places)


def as_spreadsheet(text, encoding, separator):
    """A CSV as a spreadsheet of another country saves it."""
    if separator == ";":
        text = text.replace(",", ";").replace(".", ",")
    return text.replace(",", separator if separator == "\t" else ",").encode(encoding)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_csv_of_any_spreadsheet_gives_the_same_tracks(tmp_path, film, encoding, separator):
    path = tmp_path / "plain.csv"
    save_csv_in_blocks(path, deeplabcut_tables(film[1]), decimals=3)
    text = path.read_text("utf-8").replace("anna", "änne")
    path.write_text(text, "utf-8")
    other = tmp_path / "other.csv"
    other.write_bytes(as_spreadsheet(text, encoding, separator))
    plain, same = (load_poses(file, None, 25.0) for file in (path, other))
    assert same.individuals == plain.individuals and "änne" in same.individuals
    np.testing.assert_array_equal(same.places, plain.places)
    np.testing.assert_allclose(
        arrays(plain)[:, [plain.individuals.index(n) for n in ("änne", "berta", "carl")]],
        arrays(film[1]), atol=1e-3,
    )  # fmt: skip


CSV_OF_PROGRAMS = {
    "DeepLabCut": "scorer,D,D,D\nbodyparts,nose,nose,nose\ncoords,x,y,likelihood\n0,1.5,2,1\n3,4,5,1\n",
    "LightningPose": "scorer,D,D,D,set\nbodyparts,nose,nose,nose,\ncoords,x,y,likelihood,\n"
    "0,1.5,2,1,train\n3,4,5,1,unused\n",
    "SLEAP": "track,frame_idx,instance.score,nose.x,nose.y,nose.score\na,0,1,1.5,2,1\na,3,1,4,5,1\n",
    "idtracker.ai": "frame,time,individual,x,y\n0,0,0,1.5,2\n3,0.1,0,4,5\n",
    "FastTrack": "xHead,yHead,tHead,xTail,yTail,tTail,xBody,yBody,tBody,curvature,imageNumber,id\n"
    "1.5,2,0,7,8,0,3,4,0,0.1,0,5\n4,5,0,7,8,0,3,4,0,0.1,3,5\n",
    "TRex": "frame,X (px),Y (px),missing\n0,1.5,2,0\n3,4,5,0\n",
}  # fmt: skip
HANDLED = {
    "as it is": lambda text: text,
    "Windows": lambda text: text.replace("\n", "\r\n"),
    "old Mac": lambda text: text.replace("\n", "\r"),
    "blank lines": lambda text: f"\n{text}\n\n",
    "empty rows": lambda text: text + "," * text.split("\n")[0].count(",") + "\n",
    "two marks": lambda text: f"\ufeff\ufeff{text}",
    "comments": lambda text: f"# by a program, version 2\n# of a film\n{text}",
    "Excel": lambda text: "sep=;\r\n" + text.replace(",", ";"),
    "tabs": lambda text: text.replace(",", "\t"),
    "bars": lambda text: text.replace(",", "|"),
    "spaces of no width": lambda text: text.replace(".5", ".5\u00a0"),
    "spaces": lambda text: text.replace(",", ", "),
    "quotes": lambda text: re.sub(r"[^,\n]+", lambda cell: f'"{cell[0]}"', text).replace(
        ".5", ",5"
    ),
}


@pytest.mark.parametrize("program", CSV_OF_PROGRAMS)
@pytest.mark.parametrize("handle", HANDLED.values(), ids=HANDLED)
@pytest.mark.parametrize("ending", ["CSV", "txt"])
def test_a_csv_that_went_through_other_hands_is_read(tmp_path, program, handle, ending):
    path = tmp_path / f"käfer 1DLC_filtered.{ending}"
    path.write_bytes(handle(CSV_OF_PROGRAMS[program]).encode())
    poses = load_poses(path, None, 25.0)
    assert poses.frame.tolist() == [0, 3]
    assert poses.places[:, 0].tolist() == [[1.5, 2], [4, 5]]


@pytest.mark.parametrize("program", CSV_OF_PROGRAMS)
def test_a_csv_that_cannot_be_read_is_shown(tmp_path, program):
    path = tmp_path / "a.csv"
    path.write_text("name,colour\nfish,red\n")
    for software in (None, program):
        with pytest.raises(FinloopError, match="begins with name,colour / fish,red"):
            load_poses(path, software, 25.0)


@pytest.mark.parametrize(
    ("aspect", "rotation", "scale"),
    [("2", 0, (2, 1)), ("2", 90, (1, 2)), ("1/2", 180, (1, 2)), ("1", 0, (1, 1))],
)
def test_tracks_follow_pixels_that_are_made_square(film, aspect, rotation, scale):
    facts = replace(
        load_facts(film[0] / "data/clip/facts.json"), pixel_aspect=Fraction(aspect),
        rotation_deg=rotation,
    )  # fmt: skip
    square = make_pixels_square(film[1], facts)
    np.testing.assert_allclose(square.places, film[1].places * scale)


def test_keypoints_that_belong_to_no_animal_are_left_out_and_named(tmp_path, capsys):
    head = [
        "scorer" + ",DLC" * 9, "individuals" + ",a" * 3 + ",b" * 3 + ",single" * 3,
        "bodyparts" + ",nose" * 6 + ",corner" * 3, "coords" + ",x,y,likelihood" * 3,
    ]  # fmt: skip
    rows = ["0,1,2,0.9,3,4,0.8,5,6,0.7", "1,1,3,0.9,,,,5,6,0.7"]
    (tmp_path / "a.csv").write_text("\n".join(head + rows))
    poses = load_poses(tmp_path / "a.csv", None, 25.0)
    assert poses.individuals == ("a", "b") and poses.keypoints == ("nose",)
    assert poses.places[:, 0].tolist() == [[1, 2], [3, 4], [1, 3]]
    assert poses.confidence.ravel().tolist() == [0.9, 0.8, 0.9]
    assert "single has other keypoints than the animals (corner)" in capsys.readouterr().err


def test_the_only_animal_is_known_beside_keypoints_of_nobody(tmp_path):
    head = ["scorer,D,D,D,D", "individuals,single,single,a,a", "bodyparts,corner,corner,nose,nose"]
    (tmp_path / "a.csv").write_text("\n".join([*head, "coords,x,y,x,y", "0,9,9,1,2"]))
    poses = load_poses(tmp_path / "a.csv", None, 25.0)
    assert poses.individuals == ("a",) and poses.places.tolist() == [[[1, 2]]]


def test_the_analysis_csv_of_sleap_is_read(tmp_path):
    rows = ["b,4,0.9,7,8,0.7,,,", "a,0,0.9,1,2,0.9,3,4,0.8", "a,4,0.9,5,6,0.9,,,"]
    head = "track,frame_idx,instance.score,nose.x,nose.y,nose.score,tail.x,tail.y,tail.score"
    path = tmp_path / "labels.analysis.csv"
    path.write_text("\n".join([head, *rows]))
    poses = load_poses(path, None, 25.0)
    assert set(poses.individuals) == {"a", "b"} and poses.keypoints == ("nose", "tail")
    assert poses.frame.tolist() == [0, 4, 4] and poses.frames == 5
    first = poses.individual == poses.individuals.index("a")
    assert poses.places[first][:, 0].tolist() == [[1, 2], [5, 6]]
    assert np.isnan(poses.places[~first][:, 1]).all()
    path.write_text("\n".join([head, rows[1], rows[1]]))
    with pytest.raises(FinloopError, match=r"animal a in frame 0(.|\n)*track the animals in SLEAP"):
        load_poses(path, None, 25.0)


def test_tracking_txt_of_fasttrack_gives_head_centre_and_tail_of_every_animal(tmp_path, film):
    poses, rows = film[1], []
    for animal, frame, places in zip(poses.individual, poses.frame, poses.places, strict=True):
        (hx, hy), (tx, ty), (x, y) = places
        row = [hx, hy, 1.5, tx, ty, 0.2, x, y, 3.1, 0.01, 180.5, frame, 2 * animal]
        rows.append("\t".join(map(str, row)))
    named = [f"{axis}{part}" for part in ("Head", "Tail", "Body") for axis in "xyt"]
    head = "\t".join([*named, "curvature", "areaBody", "imageNumber", "id"])
    (tmp_path / "Tracking_Result").mkdir()
    path = tmp_path / "Tracking_Result" / "tracking.txt"
    path.write_text("\n".join([head, *rows]) + "\n")
    for given in (path, path.parent):
        found = load_poses(given, None, 25.0)
        assert found.individuals == ("0", "2", "4") and found.keypoints == (
            "head",
            "centre",
            "tail",
        )
        np.testing.assert_allclose(arrays(found), arrays(poses)[:, :, [0, 2, 1]])
    path.write_text("\n".join([head, rows[0], rows[0]]))
    with pytest.raises(FinloopError, match="animal 0 in frame 0"):
        load_poses(path, None, 25.0)
    path.write_text("\n".join(line.replace("imageNumber", "image") for line in [head, *rows]))
    with pytest.raises(FinloopError, match=r"imageNumber(.|\n)*begins with xHead"):
        load_poses(path, "FastTrack", 25.0)


def test_labelled_pictures_and_half_a_head_are_no_tracks(tmp_path):
    head = "scorer,D,D\nbodyparts,nose,nose\ncoords,x,y\n"
    for text, said in (
        (head + "labeled-data/a/img1.png,1,2\n", "its rows are named"),
        ("scorer,D,D\nbodyparts,nose,nose\n0,1,2\n", "cannot be read as tracks of DeepLabCut"),
        (head.replace(",", ";") + "0;1.234,5;2\n", "'1.234,5' is no number"),
        (head + "0,1,2\n1,x,3\n", "'x' is no number"),
    ):
        (tmp_path / "a.csv").write_text(text)
        with pytest.raises(FinloopError, match=said):
            load_poses(tmp_path / "a.csv", None, 25.0)


def test_a_pickle_that_would_run_something_is_refused(tmp_path, capsys):
    np.save(tmp_path / "a.npy", np.array({"trajectories": Runs()}, dtype=object))
    with pytest.raises(FinloopError, match=r"would run builtins\.print"):
        load_poses(tmp_path / "a.npy", None, 25.0)
    assert capsys.readouterr().out == ""


class Kind:
    """A pickle of a numpy kind, with a name or a state that points into memory."""

    def __init__(self, name, state=None):
        self.name, self.state = name, state

    def __reduce__(self):
        made = (np.dtype, (self.name,))
        return made if self.state is None else (*made, self.state)


@pytest.mark.parametrize(
    "kind",
    [
        Kind("f8,O"),
        Kind("V16"),
        Kind("V8", (3, "|", None, ("a",), {"a": (np.dtype("O"), 0)}, 8, 1, 16)),
        Kind("f8", (3, "<", None, ("a",), {"a": (np.dtype("f8"), 0)}, 8, 1, 0)),
    ],
)
def test_a_pickle_with_a_kind_that_points_into_memory_is_refused(tmp_path, kind):
    (tmp_path / "a.pickle").write_bytes(pickle.dumps({"trajectories": [kind]}))
    with pytest.raises(FinloopError, match="it holds an array"):
        load_poses(tmp_path / "a.pickle", None, 25.0)


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("kind", [">f4", "<f8", "int16"])
def test_arrays_in_a_pickle_of_any_protocol_are_read(tmp_path, protocol, kind):
    places = np.arange(24).reshape(4, 3, 2).astype(kind)
    record = {"trajectories": places, "identities_labels": np.array(["x", "y", "z"])}
    (tmp_path / "a.pickle").write_bytes(pickle.dumps(record, protocol))
    poses = load_poses(tmp_path / "a.pickle", None, 25.0)
    assert poses.individuals == ("x", "y", "z")
    np.testing.assert_array_equal(arrays(poses)[:, :, 0], places)


@pytest.mark.parametrize("kind", ["table", "fixed"])
def test_the_head_of_a_deeplabcut_h5_runs_nothing(tmp_path, kind, capsys):
    h5py = pytest.importorskip("h5py", reason="the extra `tracks` is not installed: make tracks")
    labels = [("D", "nose", part) for part in ("x", "y", "likelihood")]
    values = np.array([[1.0, 2.0, 0.9], [3.0, 4.0, 0.8]])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("df_with_missing")
        if kind == "table":
            rows = np.zeros(2, [("index", "i8"), ("values_block_0", "f8", 3)])
            rows["index"], rows["values_block_0"] = [0, 1], values
            group["table"] = rows
            group.attrs["non_index_axes"] = np.void(pickle.dumps([(1, labels)], 0))
        else:
            group.attrs["axis0_nlevels"] = 3
            for k, level in enumerate((["D"], ["nose"], ["x", "y", "likelihood"])):
                group[f"axis0_level{k}"] = np.array(level, "S")
                group[f"axis0_label{k}"] = [0, 1, 2] if k == 2 else [0, 0, 0]
            group["axis1"], group["block0_values"] = [0, 1], values
    poses = load_poses(tmp_path / "a.h5", None, 25.0)
    assert poses.places[:, 0].tolist() == [[1, 2], [3, 4]]
    if kind == "table":
        with h5py.File(tmp_path / "a.h5", "a") as file:
            file["df_with_missing"].attrs["non_index_axes"] = np.void(pickle.dumps(Runs(), 0))
        with pytest.raises(FinloopError, match=r"would run \w+\.print"):
            load_poses(tmp_path / "a.h5", None, 25.0)
        assert capsys.readouterr().out == ""


def test_tracks_of_trex(tmp_path, film):
    poses = load_poses(trex(tmp_path / "data", film[1]).parent, None, 25.0)
    assert (poses.individuals, poses.keypoints) == (NAMES, ("head", "centre"))
    np.testing.assert_allclose(arrays(poses), arrays(film[1])[:, :, [0, 2]], atol=1e-9)
    one = load_poses(tmp_path / "data/film_berta.npz", None, 25.0)
    assert one.individuals == ("berta",)
    np.testing.assert_allclose(one.places, poses.places[poses.individual == 1])


def test_what_trex_has_interpolated_is_left_out_and_no_posture_is_no_head(tmp_path):
    x = np.array([1.0, 2.0, np.inf, 4.0])
    fields = {"X": x, "Y": x, "X#wcentroid": x, "Y#wcentroid": x}
    fields |= {"frame": [7, 8, 9, 10], "missing": [0, 1, 0, 0], "cm_per_pixel": [0.1]}
    np.savez(tmp_path / "f_id0.npz", **fields)
    poses = load_poses(tmp_path / "f_id0.npz", None, 25.0)
    assert poses.frame.tolist() == [7, 10]
    assert np.isnan(poses.places[:, 0]).all() and poses.places[:, 1, 0].tolist() == [10, 40]
    table = pd.DataFrame({"frame": [1, 2], "X (cm)": [3, 4], "Y (cm)": [5, 6], "missing": [0, 0]})
    table.to_csv(tmp_path / "f_id1.csv", index=False)
    poses = load_poses(tmp_path / "f_id1.csv", None, 25.0)
    assert poses.places[:, 0].tolist() == [[3, 5], [4, 6]]
    (tmp_path / "film.settings").write_text("analysis_range = [0,9]\ncm_per_pixel = 0.5\n")
    poses = load_poses(tmp_path / "f_id1.csv", None, 25.0)
    assert poses.places[:, 0].tolist() == [[6, 10], [8, 12]]


@pytest.fixture
def dataset(film):
    """The truth as movement's dataset, in seconds."""
    load = pytest.importorskip("movement.io.load_poses")
    places = arrays(film[1])
    return load.from_numpy(
        position_array=places.transpose(0, 3, 2, 1), confidence_array=np.ones(places.shape[:3]).transpose(0, 2, 1),
        individual_names=list(NAMES), keypoint_names=list(film[1].keypoints), fps=25, source_software="truth",
    )  # fmt: skip


def by_library(folder, dataset, poses, kind):
    """The truth as each program writes it, by movement or the program's own library."""
    from movement.io import save_poses

    path = folder / f"a.{kind.split()[1]}"
    match kind:
        case "DeepLabCut csv":
            save_csv_in_blocks(path, deeplabcut_tables(poses), decimals=4)
        case "DeepLabCut h5":
            save_poses.to_dlc_file(dataset, path, split_individuals=False)
        case "SLEAP h5":
            save_poses.to_sleap_analysis_file(dataset, path)
        case "SLEAP slp":
            save_slp(path, poses)
        case "movement nc":
            dataset.to_netcdf(path, engine="h5netcdf")
    if path.exists():
        return path
    from pynwb import NWBHDF5IO

    for name, file in zip(NAMES, save_poses.to_nwb_file(dataset), strict=True):
        with NWBHDF5IO(folder / f"{name}.nwb", mode="w") as io:
            io.write(file)
    return folder


def save_slp(path, poses):
    import sleap_io as sio

    skeleton, video = sio.Skeleton(list(poses.keypoints)), sio.Video("film.mp4", open_backend=False)
    tracks = [sio.Track(name) for name in NAMES]
    frames = [
        sio.LabeledFrame(video=video, frame_idx=int(frame), instances=[
            sio.PredictedInstance.from_numpy(
                poses.places[row], skeleton=skeleton, point_scores=np.ones(3), score=1.0,
                track=tracks[poses.individual[row]],
            )
            for row in np.flatnonzero(poses.frame == frame)
        ])
        for frame in np.unique(poses.frame)
    ]  # fmt: skip
    sio.Labels(frames).save(str(path))


@needs_movement
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "kind", ["DeepLabCut csv", "DeepLabCut h5", "SLEAP h5", "SLEAP slp", "movement nc", "NWB files"]
)
def test_what_movement_reads(tmp_path, film, dataset, kind):
    poses = load_poses(by_library(tmp_path, dataset, film[1], kind), None, 25.0)
    order = [poses.individuals.index(name) for name in NAMES]
    points = [poses.keypoints.index(name) for name in film[1].keypoints]
    assert sorted(poses.individuals) == list(NAMES) and poses.frames == FRAMES_OF_FILM
    np.testing.assert_allclose(arrays(poses)[:, order][:, :, points], arrays(film[1]), atol=1e-3)
    np.testing.assert_allclose(poses.confidence, 1)


@needs_movement
@pytest.mark.filterwarnings("ignore")
def test_one_animal_of_lightning_pose_and_three_dimensions_of_anipose(tmp_path, dataset):
    from movement.io import save_poses

    one = dataset.sel(individuals=["berta"])
    save_poses.to_lp_file(one, tmp_path / "a.csv")
    (path,) = tmp_path.glob("a*.csv")
    for software in (None, "LightningPose"):
        poses = load_poses(path, software, 25.0)
        position = one.position.transpose("time", "individuals", "keypoints", "space")
        np.testing.assert_allclose(arrays(poses), position, atol=1e-3)
    columns = [f"{k}_{c}" for k in "pq" for c in ("x", "y", "z", "error", "ncams", "score")]
    columns += [f"center_{k}" for k in range(3)]
    columns += [f"M_{i}{j}" for i in range(3) for j in range(3)]
    flat = pd.DataFrame(np.ones((4, len(columns))), columns=columns).assign(fnum=range(4))
    flat.to_csv(tmp_path / "b.csv", index=False)
    with pytest.raises(FinloopError, match="3 dimensions"):
        load_poses(tmp_path / "b.csv", None, 25.0)


@needs_movement
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["a.slp", "a.nwb", "a.nc", "a.h5"])
def test_a_damaged_file_is_said(tmp_path, name):
    (tmp_path / name).write_bytes(b"\x89HDF\r\n\x1a\n and no more")
    with pytest.raises(FinloopError, match="cannot be read as tracks"):
        load_poses(tmp_path / name, None, 25.0)
