"""Motion of one animal, looks of another: laws, ground truth of drawn carp, bad input."""

import shutil
from contextlib import chdir
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pandas as pd
import pytest
import scipy
from conftest import TINY_CARP
from scipy.interpolate import CubicSpline
from scratch import prepare
from tiny_run import stage_run

import stages.clip
import stages.plots.retarget
import stages.render
import stages.retarget
from finloop.base.errors import FinloopError
from finloop.base.poses import poses_from_arrays
from finloop.base.schema import lists_to_points
from finloop.base.settings import settings
from finloop.drawn.truth import TRUTH
from finloop.edit.schema import EDIT
from finloop.export.tracks import deeplabcut_tables
from finloop.io.numbers import load_numbers
from finloop.io.table import load_table, save_csv_in_blocks
from finloop.plots.retarget import MOMENTS, choose_ticks_to_draw
from finloop.project import Project
from finloop.puppet import Pose
from finloop.puppet.pose import backbone_directions
from finloop.retarget import JoinParameters, Track, retarget_track, track_from_poses
from finloop.retarget.load import film_track_files, load_track
from finloop.retarget.motion import forward_share, resample_track
from finloop.retarget.place import find_placement, find_points_outside, find_shift_into
from finloop.retarget.posture import align_postures, fit_postures, most_likely_codes, places_on_body
from finloop.retarget.rows import FilmRows, find_cheapest_rows
from finloop.retarget.track import body_keypoint_numbers, resample_body_lines
from stages.stamps import file_stamp

OTHERS = JoinParameters(settings("jumps"), settings("animate"), settings("matching").join)
NAMES = ("centre", "tail_tip", "b2", "left_eye", "Nose", "b1", "b3")
ALONG = (None, 1.0, 0.5, None, 0.0, 0.25, 0.75)  # of the body, of these points
STEPS = 32  # of a backbone


def how(**changes):
    return settings("retarget", **({"tracks": "x", "placement": "given"} | changes))


folder = stage_run("distance", "jumps")


@pytest.fixture(scope="module")
def material(folder):
    """The same as `Material`, with mirror images."""
    with chdir(folder):
        with Project() as project:
            whole = stages.retarget.load_retarget_data(project)
            look = whole.look[: len(whole.reel)]
            yield whole._replace(look=np.concatenate([look, look]))


@pytest.fixture(scope="module")
def carp(tmp_path_factory):
    """The true midlines (frames, 65, 2) of another drawn carp, smaller, of another skin."""
    path = tmp_path_factory.mktemp("carp")
    prepare(path, *TINY_CARP, "clip.seed=9", "clip.body_length_px=50", "clip.frames=60")
    with chdir(path):
        stages.clip.main()
    truth = load_table(path / "data/clip/truth.parquet", TRUTH)
    return lists_to_points(truth, "backbone").astype(float)


def tracker_poses(line):
    """What a program that never errs says of midlines (frames, 65, 2): an eye and the middle, too."""
    places = np.stack(
        [line[:, round(64 * along)] if along is not None else line.mean(1) for along in ALONG], 1
    )
    way = line[:, 4] - line[:, 0]
    places[:, NAMES.index("left_eye")] = line[:, 4] + way[:, ::-1] * (1, -1)
    return poses_from_arrays(("anna",), NAMES, np.arange(len(line)), places[:, None])


def of_poses(poses, made, rate_hz=25.0, **changes):
    p = how(**changes)
    return retarget_track(track_from_poses(poses, rate_hz, STEPS, p), made, p, OTHERS)


def distances(points, others):
    return np.hypot(*np.moveaxis(points - others, -1, 0))


def body_lengths(lines):
    return distances(lines[:, 1:], lines[:, :-1]).sum(1)


def asked_points(animation):
    return lists_to_points(animation.asked, "drawn").astype(float)


# --- laws


def test_a_film_s_own_track_is_the_film_again(material):
    features = material.reel.features
    number = features["track_id"].value_counts().index[0]
    own = load_track(material, how(tracks=f"track:{number}"))
    animation = retarget_track(own, material, how(scale=1.0), OTHERS)
    rows = np.flatnonzero(features["track_id"] == number)
    edit = animation.edit
    assert edit["source"].tolist() == rows.tolist()
    assert not edit["mirrored"].any() and not edit["weight"].any()
    assert np.abs(np.stack(edit["pose"]) - material.poses.codes[rows]).max() < 1e-5
    assert np.allclose(edit["rotation_deg"], 0, atol=1e-3)
    for axis in ("x_px", "y_px"):
        assert np.allclose(edit[axis], features[axis].to_numpy()[rows], atol=0.02)
    told = animation.numbers
    assert told["switches"] == 0 and told["clamped_pct"] == 0 and told["apart_p95_pct"] < 0.1
    assert told["ticks"] == len(rows) and told["file_frames_used_pct"] == 100


def test_without_its_own_frames_it_is_drawn_in_others_at_the_same_places(material):
    n = len(material.reel)
    half = np.arange(n // 2)
    own = load_track(material, how(tracks="track:0"))
    part = own._replace(
        frame=own.frame[half], points=own.points[half], codes=own.codes[half], rows=half
    )
    animation = retarget_track(part, material, how(allow_own_frames=False, scale=1.0), OTHERS)
    assert (animation.edit["source"] >= len(half)).all()
    assert animation.numbers["apart_p95_pct"] < 0.1
    with pytest.raises(FinloopError, match="no frames except those"):
        retarget_track(own, material, how(allow_own_frames=False), OTHERS)


def test_a_mirrored_track_gives_the_mirrored_animation(material, carp):
    plain = of_poses(tracker_poses(carp), material)
    width = material.arena.shape[1]
    middle = [(width - 1) / plain.numbers["scale"], 0]
    other = of_poses(tracker_poses(middle + carp * [-1, 1]), material)
    assert np.allclose(other.edit["x_px"], width - 1 - plain.edit["x_px"], atol=1e-6)
    assert np.allclose(other.edit["y_px"], plain.edit["y_px"], atol=1e-6)
    assert (other.edit["source"] == plain.edit["source"]).all()
    assert (other.edit["mirrored"] != plain.edit["mirrored"]).all()
    codes, flipped = (np.stack(one.edit["pose"]) for one in (plain, other))
    assert np.allclose(codes @ material.poses.shapes.mirror_matrix, flipped, atol=1e-4)


def test_twice_the_rate_and_twice_the_size_are_the_same_motion(material, carp):
    plain = of_poses(tracker_poses(carp), material, scale=1.4)
    ticks = np.arange(len(carp))
    fine = CubicSpline(ticks, carp)(np.arange(0, len(carp) - 0.5, 0.5))
    quick = of_poses(tracker_poses(fine), material, 50.0, scale=1.4)
    assert len(quick.edit) == len(plain.edit)
    assert np.abs(asked_points(quick) - asked_points(plain)).max() < 1e-2
    assert (quick.edit["source"] == plain.edit["source"]).all()
    own, large = (
        of_poses(tracker_poses(size * carp), material, placement="shrink") for size in (1, 2)
    )
    assert large.numbers["scale"] == pytest.approx(own.numbers["scale"] / 2)
    assert np.abs(asked_points(large) - asked_points(own)).max() < 1e-3
    assert (large.edit["source"] == own.edit["source"]).all()


def test_another_carp_is_where_it_was_and_bent_as_it_was(material, carp):
    animation = of_poses(tracker_poses(carp), material)
    arc = body_lengths(carp)
    assert animation.numbers["scale"] == pytest.approx(
        material.reel.length_px / np.median(arc), rel=0.03
    )
    true = animation.numbers["scale"] * carp[:, ::2]
    off = distances(asked_points(animation), true).mean(1) / material.reel.length_px
    assert np.median(off) < 0.01 and np.quantile(off, 0.95) < 0.02
    asked = lists_to_points(animation.asked, "asked")
    # The spline through points.
    assert np.abs(asked - true).max() < 0.02 * material.reel.length_px
    assert 100 * np.median(off) == pytest.approx(animation.numbers["apart_median_pct"], abs=0.3)


@pytest.mark.skipif(find_spec("movement") is None, reason="the extra `tracks` is not installed")
def test_a_csv_of_deeplabcut_gives_what_its_poses_give(material, carp, tmp_path):
    poses = tracker_poses(carp)
    path = tmp_path / "tracks.csv"
    save_csv_in_blocks(path, deeplabcut_tables(poses), decimals=3)
    p = how(tracks=str(path))
    animation = retarget_track(load_track(material, p), material, p, OTHERS)
    wanted = asked_points(of_poses(poses, material))
    assert np.abs(asked_points(animation) - wanted).max() < 0.05


# --- few points


@pytest.mark.parametrize("points", [("Nose", "tail_tip"), ("centre",), ("Nose",)])
def test_few_points_say_where_and_the_film_says_how_it_is_bent(material, carp, points):
    changes = {} if len(points) > 1 else {"scale": 1.4}
    poses = tracker_poses(carp)
    animation = of_poses(poses, material, body_keypoints=points, **changes)
    scale = animation.numbers["scale"]
    assert scale == pytest.approx(1.4, rel=0.1)
    asked = scale * poses.places[:, [NAMES.index(one) for one in points]]
    line, edit = asked_points(animation), animation.edit
    if points == ("centre",):
        assert np.abs(edit[["x_px", "y_px"]].to_numpy() - asked[:, 0]).max() < 1e-6
    elif points == ("Nose",):
        assert np.abs(line[:, 0] - asked[:, 0]).max() < 1e-3
    else:
        middle, sought = line[:, [0, -1]].mean(1), asked.mean(1)
        assert np.abs(middle - sought).max() < 1e-3
        assert animation.numbers["apart_median_pct"] < 10
    codes = np.stack(edit["pose"]).astype(float)
    near = material.poses.shapes.nearest_codes(codes).codes
    assert np.abs(near - codes).max() < 1e-3  # every posture is one that the film shows
    assert animation.numbers["with_postures"] == 0
    notes = stages.retarget.describe_flaws(animation.numbers)
    assert any("no pose" in one for one in notes)
    with pytest.raises(FinloopError, match=r"no body length[\s\S]*retarget.scale"):
        of_poses(poses, material, body_keypoints=("centre",))


def test_postures_of_the_film_go_on_over_a_switch(material, carp):
    jumps = {OTHERS.join: [], "cut": []}
    for first in ("Nose", "b1"):  # two tracks, as one has a single switch
        p = how(body_keypoints=(first, "tail_tip"))
        track = track_from_poses(tracker_poses(carp), 25.0, STEPS, p)
        for join, sizes in jumps.items():
            animation = retarget_track(track, material, p, OTHERS._replace(join=join))
            at = np.flatnonzero(animation.asked["switch"])
            codes = np.stack(animation.edit["pose"]).astype(float)
            sizes.extend(np.linalg.norm(codes[at] - codes[at - 1], axis=1))
    assert len(jumps["cut"]) > 1
    assert np.mean(jumps[OTHERS.join]) < 0.8 * np.mean(jumps["cut"])


def test_points_of_the_body_are_told_from_eyes_and_ordered_from_head_to_tail(carp):
    poses = tracker_poses(carp)
    order = body_keypoint_numbers(NAMES, poses.places, how())
    assert [NAMES[one] for one in order] == ["Nose", "b1", "b2", "b3", "tail_tip"]
    named = body_keypoint_numbers(NAMES, poses.places, how(body_keypoints=("b1", "b2", "b3")))
    assert [NAMES[one] for one in named] == ["b1", "b2", "b3"]
    without = ["nowhere" if one == "tail_tip" else one for one in NAMES]
    assert [without[one] for one in body_keypoint_numbers(without, poses.places, how())] == ["Nose"]


def test_points_that_reach_part_of_the_body_leave_the_rest_to_the_film(material, carp):
    whole = of_poses(tracker_poses(carp), material)
    share = {"body_keypoints": ("Nose", "b1", "b2", "b3"), "keypoint_range": (0.0, 0.75)}
    part = of_poses(tracker_poses(carp), material, **share)
    assert part.numbers["scale"] == pytest.approx(whole.numbers["scale"], rel=0.02)
    off = distances(asked_points(part), asked_points(whole)) / material.reel.length_px
    assert np.median(off[:, :24]) < 0.01 and np.median(off[:, -1]) < 0.12


# --- time


def straight(frames, gaps=()):
    """A track of an animal that swims to the right, straight, 2 px a frame."""
    kept = np.setdiff1d(np.arange(frames), gaps)
    at = np.linspace(0, 1, 9)
    x = 2.0 * kept[:, None] - 20 * at
    points = np.stack([x, np.full_like(x, 50.0)], -1)
    return Track("a", 25.0, kept, points, at, 20.0)


def test_short_gaps_are_filled_and_long_ones_end_a_stretch():
    motion = resample_track(straight(40, (5, 6, 20)), 25.0, how())
    assert np.allclose(motion.points, straight(40).points)
    assert motion.numbers["gaps_filled_frames"] == 3 and motion.numbers["left_out_s"] == 0
    track = straight(40)
    track.points[[5, 6, 20], 3] = np.nan  # a point is missing: filled, too
    track.points[-4:] = np.nan
    motion = resample_track(track, 25.0, how())
    assert np.allclose(motion.points, straight(36).points)
    assert motion.numbers["gaps_filled_frames"] == 3 and motion.numbers["file_frames"] == 40
    assert motion.numbers["left_out_s"] == pytest.approx(4 / 25)
    assert motion.numbers["file_frames_used_pct"] == pytest.approx(90)
    motion = resample_track(straight(60, range(20, 30)), 25.0, how())
    assert motion.time_s[[0, -1]] == pytest.approx([30 / 25, 59 / 25])
    assert motion.numbers["left_out_s"] == pytest.approx(20 / 25)
    assert motion.numbers["stretches_left_out"] == 1
    assert any("0.8 s are left out" in one for one in stages.retarget.describe_flaws(
        motion.numbers | {"with_postures": 1, "duration_s": 1.2, "outside_ticks": 0}
    ))  # fmt: skip
    motion = resample_track(straight(60), 25.0, how(start_s=0.4, end_s=1.2))
    assert motion.time_s[[0, -1]] == pytest.approx([0.4, 1.2])


def test_smoothing_takes_tremble_and_leaves_a_straight_way():
    track = straight(80)
    plain = resample_track(track, 25.0, how(smooth_s=0.1)).points
    assert np.allclose(plain[15:-15], track.points[15:-15])
    tremble = np.where(np.arange(80) % 2, 0.5, -0.5)[:, None, None]
    shaken = resample_track(track._replace(points=track.points + tremble), 25.0, how(smooth_s=0.1))
    assert np.abs(shaken.points - plain)[15:-15].max() < 0.01


# --- postures


def test_codes_come_back_from_bends_alone_and_poses_from_points(material):
    shapes = material.poses.shapes
    exact = replace(shapes, total_variance=float(shapes.variance.sum()))
    rng = np.random.default_rng(1)
    codes = material.poses.codes[rng.choice(len(material.poses.codes), 30)]
    pose = Pose(*rng.uniform(50, 200, (2, 30)), rng.uniform(-3, 3, 30), np.full(30, 40.0),
                exact.decode(codes))  # fmt: skip
    at = np.linspace(0, 1, pose.posture.shape[1] // 2)
    line = pose.backbone_px()
    again = align_postures(pose.posture, line, at, 40.0)
    assert np.allclose(again.backbone_px(), line)
    assert np.allclose(np.exp(1j * again.heading_rad), np.exp(1j * pose.heading_rad))
    asked = fit_postures(line, at, exact, 40.0)
    off = distances(asked.pose.backbone_px(), line)
    assert off.max() < 0.6 and np.median(off) < 0.1 and not asked.clamped.any()
    bare = backbone_directions(pose.posture)
    size = np.abs(codes).max()
    assert np.abs(most_likely_codes(bare, at, exact) - codes).max() < 0.05 * size
    flipped = most_likely_codes(bare, at, exact) @ shapes.mirror_matrix
    assert np.allclose(most_likely_codes(-bare, at, exact), flipped, atol=1e-6)


def test_a_posture_that_the_film_never_shows_is_drawn_to_the_nearest(material):
    shapes, at = material.poses.shapes, np.linspace(0, 1, STEPS + 1)
    angle = np.linspace(0, 2 * np.pi, STEPS)  # a ring
    way = np.stack([-np.cos(angle), np.sin(angle)], -1) * material.reel.length_px / STEPS
    ring = np.concatenate([np.zeros((1, 2)), np.cumsum(way, 0)])[None]
    asked = fit_postures(ring, at, shapes, material.reel.length_px)
    assert asked.clamped.all()
    assert not shapes.nearest_codes(asked.codes).clamped.any()


def test_points_lie_on_the_line_that_they_were_taken_from(carp):
    at = np.linspace(0, 1, STEPS + 1)
    made = resample_body_lines(carp[:, ::8], at, "a")
    arc = body_lengths(carp)
    assert np.abs(made - carp[:, ::2]).max() < 0.01 * np.median(arc)
    fewer = carp[:, ::8].copy()
    fewer[3, 2] = np.nan  # an inner point is not given
    fewer[4, 0] = np.nan  # the head is not
    again = resample_body_lines(fewer, at, "a")
    assert np.abs(again[3] - carp[3, ::2]).max() < 0.02 * np.median(arc)
    assert np.isnan(again[4]).all()


def test_the_middle_and_both_ends_of_a_body_are_found_on_it():
    posture = np.array([[0.4, 0.0, 0.0, 0.0, 0.5, 0.5]])
    pose = Pose(*(np.array([one]) for one in (10.0, 20.0, np.pi / 2, 8.0)), posture)
    found = places_on_body(pose, np.array([0.0, np.nan, 1.0]))[0]
    assert np.allclose(found, [[10, 20 - 3.2], [10, 20], [10, 20 + 4.8]])


# --- rows


def test_the_cheapest_rows_are_those_of_all_sequences():
    rng = np.random.default_rng(2)
    n, ticks, switch, delta = 12, 7, 0.7, 2
    values, seen = rng.normal(size=(n, 3)), 0.2 * rng.normal(size=(n, 2))
    follows = np.where(np.arange(n) % 6 == 5, -1, np.arange(n) + 1)
    asked = rng.normal(size=(ticks, 3))
    found = find_cheapest_rows(FilmRows(n, values, seen, follows, [], 1), asked, n, switch, delta)

    def step(a, b):
        if follows[a] == b:
            return 0.0
        shown = follows[a] if follows[a] >= 0 else a
        return switch + np.linalg.norm(seen[shown] - seen[b])

    def price(way):
        far = sum(np.linalg.norm(values[r] - w) for r, w in zip(way, asked, strict=True)) / delta
        return far + sum(step(a, b) for a, b in zip(way[:-1], way[1:], strict=True))

    least = np.linalg.norm(values - asked[0], axis=1) / delta  # Bellman, over all rows
    moves = np.array([[step(a, b) for b in range(n)] for a in range(n)])
    for wanted in asked[1:]:
        least = (least[:, None] + moves).min(0) + np.linalg.norm(values - wanted, axis=1) / delta
    assert price(found) == pytest.approx(least.min())
    dear = find_cheapest_rows(FilmRows(n, values, seen, follows, [], 1), asked[:5], n, 99.0, delta)
    assert (np.diff(dear) == 1).all()  # never switches


# --- place


def test_a_way_is_moved_into_the_tank_or_made_smaller():
    arena = np.zeros((100, 160), bool)
    arena[10:90, 20:150] = True
    at = np.linspace(0, 2 * np.pi, 50)
    centre = np.stack([30 * np.cos(at), 25 * np.sin(at)], -1)
    bodies = centre[:, None] + np.array([[-8, 0], [0, 0], [8, 0]])
    shift, size = find_placement(bodies - 500, arena, 16, how(placement="fit"))
    assert size == 1 and not find_points_outside(bodies - 500 + shift, arena).any()
    assert np.allclose((bodies - 500 + shift).mean((0, 1)), [79.5, 49.5], atol=1.5)  # the middle
    assert find_placement(bodies, arena, 16, how())[1] == 1  # as given
    large = 2 * centre[:, None] + np.array([[-8, 0], [0, 0], [8, 0]])
    assert find_shift_into(large, arena, 16) is None
    said = r"8.5 × 6.2 body lengths[\s\S]*retarget.placement=shrink"
    with pytest.raises(FinloopError, match=said):
        find_placement(large, arena, 16, how(placement="fit"))
    _, size = find_placement(large, arena, 16, how(placement="shrink"))
    assert 0.7 < size <= 0.8
    wide = bodies + np.array([[-300, 0], [0, 0], [300, 0]])
    with pytest.raises(FinloopError, match="shrinks to a point"):
        find_placement(wide, arena, 16, how(placement="shrink"))


@pytest.mark.parametrize(("height", "cell"), [(80, 1), (500, 3)])
def test_a_fish_that_rests_and_crosses_once_is_moved_to_where_it_fits(height, cell):
    """Most points lie at one spot, which is near a wall at all four shifts that fit."""
    width, length = height + 20, 0.3 * height
    arena = np.pad(np.ones((height, width), bool), 13)
    trip = np.linspace(0, (width - 2, height - 2), 8)
    centre = np.concatenate([np.zeros((3000, 2)), trip]) - 0.3
    bodies = np.repeat(centre[:, None], 33, 1)
    pixels = np.unique(np.floor(bodies + 0.5).reshape(-1, 2), axis=0)
    places = {
        (x, y)
        for y in range(30)
        for x in range(30)
        if not find_points_outside(pixels[[0, -1]] + (x, y), arena).any()
        and not find_points_outside(pixels + (x, y), arena).any()
    }
    assert len(places) == 4 and -(-max(arena.shape) // 240) == cell
    shift = find_shift_into(bodies, arena, length)
    assert shift is not None and tuple(shift) in places
    assert find_placement(bodies, arena, length, how(placement="shrink"))[1] == 1
    assert find_shift_into(bodies * 1.05, arena, length) is None


@pytest.mark.parametrize(
    ("points", "placement"), [(("Nose", "tail_tip"), "fit"), (("centre",), "shrink")]
)
def test_a_fish_in_postures_of_the_film_is_kept_in_the_tank(material, carp, points, placement):
    changes = {"body_keypoints": points, "scale": 1.4}
    free = asked_points(of_poses(tracker_poses(carp), material, **changes))
    arena = np.zeros_like(material.arena)
    pixels = np.round(free - free.reshape(-1, 2).min(0) + 2).astype(int)
    arena[pixels[..., 1], pixels[..., 0]] = True
    tight = material._replace(arena=scipy.ndimage.binary_dilation(arena, np.ones((3, 3))))
    animation = of_poses(tracker_poses(carp), tight, placement=placement, **changes)
    assert animation.numbers["outside_ticks"] == 0 and animation.numbers["way_size"] == 1
    moved = asked_points(animation) - free  # all ticks alike
    assert np.ptp(moved, axis=(0, 1)).max() < 1e-3


def test_a_way_is_made_smaller_until_its_postures_of_the_film_fit(material, carp):
    changes = {"body_keypoints": ("centre",), "scale": 1.4}
    tight = material._replace(arena=np.pad(np.ones((90, 90), bool), ((20, 60), (30, 90))))
    animation = of_poses(tracker_poses(carp), tight, placement="shrink", **changes)
    assert animation.numbers["outside_ticks"] == 0 and 0 < animation.numbers["way_size"] < 1


# --- bad input


TAIL_FIRST = ("tail_tip", "b3", "b2", "b1", "Nose")


@pytest.mark.parametrize(
    ("lost", "changes", "said"),
    [
        ((), {"animal": "bert"}, r"no animal 'bert'[\s\S]*anna"),
        ((), {"body_keypoints": ("Nose", "fin")}, r"no keypoint fin[\s\S]*retarget.body_keypoints"),
        (NAMES, {}, "no point of the tracks"),
        (["tail_tip"], {"body_keypoints": ("Nose", "b1", "tail_tip")}, "no frame with Nose"),
        ((), {"body_keypoints": TAIL_FIRST}, r"tail first for \d+% of its path[\s\S]*backwards=true"),
        ((), {"body_keypoints": ("Nose", "b3", "b1", "tail_tip")}, r"back and forth[\s\S]*retarget.body_keypoints"),
        ((), {"scale": 9.0, "placement": "fit"}, r"the tank[\s\S]*nowhere"),
    ],
)  # fmt: skip
def test_bad_tracks_are_refused_with_what_to_do(material, carp, lost, changes, said):
    poses = tracker_poses(carp)
    poses.places[:, [NAMES.index(one) for one in lost]] = np.nan
    with pytest.raises(FinloopError, match=said):
        of_poses(poses, material, **changes)


def test_tracks_that_are_not_there_or_too_short_are_refused(material, carp, tmp_path):
    with pytest.raises(FinloopError, match=r"nothing at[\s\S]*correct retarget.tracks"):
        load_track(material, how(tracks=str(tmp_path / "none.csv")))
    with pytest.raises(FinloopError, match=r"no track of the film[\s\S]*correct retarget.tracks"):
        load_track(material, how(tracks="track:99"))
    with pytest.raises(FinloopError, match=r"without a gap has 1 frames[\s\S]*shorter gaps"):
        of_poses(tracker_poses(carp[:1]), material)


def test_a_fish_may_swim_backwards_where_that_is_allowed(material, carp):
    of_poses(tracker_poses(carp), material, body_keypoints=TAIL_FIRST, allow_backwards=True)
    assert forward_share(carp[:, ::-1]) == pytest.approx(1 - forward_share(carp))


# --- stages


def run(folder, *changes):
    prepare(folder, *TINY_CARP, "render.mode=retarget", "render.webp_seconds=0",
            "render.comparison_seconds=0", *changes)  # fmt: skip
    stages.retarget.main()
    stages.plots.retarget.main()
    return load_numbers(folder / "reports/retarget")


def test_without_a_track_the_stage_writes_empty_results_and_says_nothing(
    folder, tmp_path, monkeypatch, capfd
):
    shutil.copytree(folder / "data", tmp_path / "data")
    monkeypatch.chdir(tmp_path)
    assert run(tmp_path) == {"ticks": 0}
    assert load_table(tmp_path / "data/animate/retarget.parquet", EDIT).empty
    assert not list((tmp_path / "reports/modes/retarget").iterdir())
    assert capfd.readouterr().err == ""
    with pytest.raises(FinloopError, match=r"no track is retargeted[\s\S]*retarget.tracks"):
        stages.render.main()


def test_a_track_of_another_film_is_swum_and_drawn(folder, tmp_path, monkeypatch):
    shutil.copytree(folder / "data", tmp_path / "data")
    monkeypatch.chdir(tmp_path)
    told = run(tmp_path, f"retarget.tracks={folder / 'data'}", "retarget.placement=given")
    edit = load_table(tmp_path / "data/animate/retarget.parquet", EDIT)
    assert told["ticks"] == len(edit) > 50 and told["apart_median_pct"] < 1
    assert {"step_ratio_median", "jumps"} <= set(told)
    stages.render.main()
    assert (tmp_path / "data/render/retarget_marked.mp4").stat().st_size > 0
    assert (tmp_path / "reports/modes/retarget/backbones.png").stat().st_size > 0
    # the film itself by way of its files: only what the bends alone say is lost
    features = pd.read_parquet(folder / "data/features/features.parquet")
    track = features[features["track_id"] == features["track_id"].mode()[0]]
    places = ["x_px", "y_px"]
    off = distances(edit[places].to_numpy(), told["scale"] * track[places].to_numpy())
    assert np.median(off) < 0.02 * track["body_length_px"].median()


def test_the_moments_of_the_picture_are_spread_and_the_worst_is_last():
    far = pd.DataFrame({"apart": np.r_[np.zeros(70), 0.3, np.zeros(29)]})
    some = choose_ticks_to_draw(far)
    assert len(some) == MOMENTS + 1 and some[-1] == 70 and some[0] == 0 and some[-2] == 99
    assert len(choose_ticks_to_draw(far.assign(apart=np.nan))) == MOMENTS


def retarget_stamp(group):
    return file_stamp("retarget_stamp", {"retarget": group})


def test_a_track_that_has_changed_has_another_stamp(tmp_path):
    film = tmp_path / "film/data"
    path = film / "extract/tracks.parquet"
    files = film_track_files(film)
    for one in files:
        one.parent.mkdir(parents=True, exist_ok=True)
        one.write_text("")
    stamps = [retarget_stamp({"tracks": str(film)}), retarget_stamp({"tracks": str(path)})]
    for name in ("clip/facts.json", "features/features.parquet", "extract/tracks.parquet"):
        (film / name).write_text("a")
        stamps.append(retarget_stamp({"tracks": str(film)}))
    stamps.append(retarget_stamp({"tracks": str(path)}))
    assert len(set(stamps)) == 6 and None not in stamps
    assert retarget_stamp({"tracks": str(film / "extract")}) == stamps[-2]
    files[0].unlink()
    assert retarget_stamp({"tracks": str(film)}) is None
    for none in (None, "track:8", str(tmp_path / "none.h5")):
        assert retarget_stamp({"tracks": none}) is None
