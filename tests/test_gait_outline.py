"""Outlines in the frame of the body and their beat, on a fish drawn from its known motion."""

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest

from finloop.base.errors import FinloopError
from finloop.base.settings import settings
from finloop.curve.contour import Curve, signed_area
from finloop.drawn.carp.film import carp_motion
from finloop.drawn.carp.midline import midline_of_pose
from finloop.drawn.carp.skin import half_width
from finloop.gait.outline import (
    TrackContours,
    body_centres_and_directions,
    contour_asymmetry,
    contours_from_snout,
    join_steady_frames,
    move_to_body_frame,
    swim_contours,
    tail_sideways_positions,
    track_outlines,
)

RATE = 50.0
LENGTH = 90.0  # px
FRAMES = 70
BEAT = 2.2 * np.arange(FRAMES) / RATE  # cycles


def carp_outline(line: np.ndarray) -> np.ndarray:
    """Outline (128, 2) about a midline (65, 2), both in body lengths; begins at the tail."""
    along = np.gradient(line, axis=0)
    normal = along[:, ::-1] * [1, -1] / np.hypot(*along.T)[:, None]
    side = normal * half_width(np.linspace(0, 1, len(line)))[:, None]
    return np.concatenate([(line + side)[::-1], (line - side)[1:-1]])


@cache
def swimming(speed: float = 0.0, turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Outlines and midlines in px of a carp that beats its tail and goes its way, head right."""
    moments = zip(np.arange(FRAMES) / RATE, BEAT, strict=True)
    lines = np.stack([midline_of_pose(speed * t, 0.0, turn * t, b, 1.0, 0.0) for t, b in moments])
    return np.stack([carp_outline(line) for line in lines]) * LENGTH, lines * LENGTH


@cache
def measure_swimming(speed: float = 0.0, turn: float = 0.0) -> TrackContours:
    """What is measured of `swimming`."""
    return swim_contours(*swimming(speed, turn), RATE)


def off(found: np.ndarray, true: np.ndarray | float) -> np.ndarray:
    return (found - true + 0.5) % 1 - 0.5


def test_contours_begin_at_the_snout_and_run_clockwise() -> None:
    outline, line = swimming()
    found = contours_from_snout(outline, line[:, 0], 64)
    assert np.abs(found[:, 0] - line[:, 0]).max() < 0.02 * LENGTH
    assert all(signed_area(Curve(one, True)) > 0 for one in found)
    for one in found:
        step = np.hypot(*np.diff(np.vstack([one, one[:1]]), axis=0).T)
        assert np.ptp(step[2:30]) < 0.05 * step.mean()  # not the tips, where corners are cut
    # Neither the direction nor the first point of what comes matters.
    for other in (outline[:, ::-1], np.roll(outline, 9, 1)):
        same = contours_from_snout(other, line[:, 0], 64)
        np.testing.assert_allclose(same, found, atol=1e-9)


def test_the_beat_of_a_drawn_fish_is_found() -> None:
    found = measure_swimming()
    assert found.period.frequency_hz == pytest.approx(2.2, rel=0.01)
    assert found.period.confidence > 0.98
    assert found.period.steady.all()
    assert found.length_px == pytest.approx(LENGTH, rel=0.01)
    assert np.ptp(off(found.period.phase, BEAT)) < 0.03
    # Phase 0 is where the tail is farthest to the left, which is up on the screen.
    tail = tail_sideways_positions(found.points)
    turned = tail @ np.exp(-2j * np.pi * found.period.phase)
    assert np.angle(-turned) == pytest.approx(0, abs=0.05)
    assert np.abs(off(found.period.phase[tail.argmin()], 0.0)) < 0.06
    assert tail.max() > 0.05
    # The head yaws in the body frame as it does on the film of a fish that stays in place.
    yaw = swimming()[1][:, 0, 1] / LENGTH
    np.testing.assert_allclose(found.points[:, 0, 1], yaw - yaw.mean(), atol=0.004)
    assert np.ptp(yaw) > 0.02


def test_the_way_is_dropped_and_the_beat_kept() -> None:
    """Swimming ahead and in a wide turn gives the contours of swimming in place."""
    here = measure_swimming()
    for way in ({"speed": 1.5}, {"speed": 1.0, "turn": 0.4}):
        there = measure_swimming(**way)
        assert np.sqrt(((there.points - here.points) ** 2).sum(-1).mean()) < 0.005
        np.testing.assert_allclose(off(there.period.phase, here.period.phase), 0, atol=0.02)


def test_place_direction_and_size_on_the_screen_do_not_matter() -> None:
    outline, line = swimming(speed=1.0, turn=0.4)
    cos, sin = np.cos(2.1), np.sin(2.1)
    turn = 3 * np.array([[cos, sin], [-sin, cos]])
    one = measure_swimming(speed=1.0, turn=0.4)
    other = swim_contours(outline @ turn + [700, -20], line @ turn + [700, -20], RATE)
    np.testing.assert_allclose(one.points, other.points, atol=1e-9)
    np.testing.assert_allclose(one.period.phase, other.period.phase, atol=1e-9)


def test_in_a_mirror_it_is_half_a_beat_later() -> None:
    outline, line = swimming(speed=1.0, turn=0.4)
    one = measure_swimming(speed=1.0, turn=0.4)
    other = swim_contours(outline * [1, -1], line * [1, -1], RATE)
    image = one.points[:, -np.arange(one.points.shape[1])] * [1, -1]
    np.testing.assert_allclose(image, other.points, atol=1e-9)
    np.testing.assert_allclose(off(one.period.phase + 0.5, other.period.phase), 0, atol=1e-9)


def test_a_straight_fish_is_its_own_mirror_image() -> None:
    still, curled = midline_of_pose(0, 0, 0, 0, 0, 0), midline_of_pose(0, 0, 0, 0, 0, 1.0)
    lines = np.stack([still, curled])
    found = contours_from_snout(np.stack([carp_outline(line) for line in lines]), lines[:, 0], 128)
    centre, angle = body_centres_and_directions(found, lines)
    far = contour_asymmetry(move_to_body_frame(found, centre, angle))
    assert far[0] < 1e-3
    assert far[1] > 0.03


@pytest.mark.parametrize("seed", [3, 11])
def test_the_beat_of_the_carp_is_found_where_it_swims_straight(seed: int) -> None:
    """Cruises, glides, bursts and turns, as its script has them; outlines from its true midline."""
    carp = carp_motion(settings("clip", source="carp", frames=200, seed=seed))
    motion = (carp.x, carp.y, carp.axis, carp.beat, carp.amplitude, carp.bend, carp.ripple)
    poses = zip(*(part[:, 0] for part in motion), strict=True)
    lines = np.stack([midline_of_pose(*pose) for pose in poses])
    found = swim_contours(np.stack([carp_outline(line) for line in lines]), lines, 25.0).period
    beat, both = carp.beat[:, 0], found.steady[1:] & found.steady[:-1]
    assert found.why == ""
    assert found.cycles > 4
    assert found.frequency_hz == pytest.approx(25 * np.diff(beat)[both].mean(), rel=0.03)
    apart = np.exp(2j * np.pi * (found.phase - beat)[found.steady])
    assert np.abs(apart.mean()) > np.cos(2 * np.pi * 0.07)  # 0.07 of a beat, typically
    assert found.steady[np.abs(carp.bend[:, 0]) > 0.9].mean() < 0.2


def test_a_glide_has_no_beat() -> None:
    outline, line = swimming()
    still = np.repeat(outline[:1], FRAMES, axis=0), np.repeat(line[:1], FRAMES, axis=0)
    found = swim_contours(*still, RATE)
    assert found.period.why == "nothing moves"
    with pytest.raises(FinloopError, match="1 of 1: nothing moves"):
        join_steady_frames([found])


def test_steady_frames_of_several_tracks_follow_each_other() -> None:
    one = measure_swimming()
    gap = one.period.steady.copy()
    gap[30:40] = False
    holed = replace(one, period=replace(one.period, steady=gap))
    lost = replace(one, period=replace(one.period, why="no cycle is much like another"))
    points, phase = join_steady_frames([holed, lost, one])
    assert len(points) == len(phase) == 2 * FRAMES - 10
    assert (np.diff(phase) > 0).all()
    assert (np.diff(phase) <= 2).all()
    np.testing.assert_allclose(off(phase, np.r_[one.period.phase[gap], one.period.phase]), 0)


def test_backbones_of_the_tables_come_head_first() -> None:
    """In the track they are back to front in odd frames."""
    outline, line = swimming()
    odd = (np.arange(FRAMES) % 2 == 1)[:, None, None]
    mixed = np.where(odd, line[:, ::-1], line)
    track = pd.DataFrame({"frame": np.arange(FRAMES)})
    features = track.copy()
    for k, name in enumerate("xy"):
        track[f"outline_{name}_px"] = list(outline[..., k])
        track[f"backbone_{name}_px"] = list(mixed[..., k])
        features[f"head_{name}_px"] = line[:, 0, k]
    found = track_outlines(track, features)
    np.testing.assert_array_equal(found[0], outline)
    np.testing.assert_array_equal(found[1], line)
    for other in (features[:-1], features.assign(frame=features["frame"] + 1)):
        with pytest.raises(FinloopError, match="do not match"):
            track_outlines(track, other)
