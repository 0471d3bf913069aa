"""The drawn dog: laws of its walk, its exact contours and γ, and that its film shows them."""

from dataclasses import replace
from fractions import Fraction

import av
import numpy as np
import pytest
from toy_dog import feet_px, true_masks

from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, signed_area
from finloop.drawn.dog.draw import dog_frames, limb_masks
from finloop.drawn.dog.shape import BODY, FORE, HEAD, HIND, LIMBS, limb_outlines
from finloop.drawn.dog.walk import (
    NAMES,
    DogFilm,
    foot_displacements,
    foot_gammas,
    frame_phases,
    half_cycle_progress,
    is_swinging,
    limb_contours_at,
    part_contour,
    standing_points_px,
)
from finloop.gait.truth import true_gamma
from finloop.io.movie import Mp4Writer
from finloop.morph.folds import is_simple

SMALL = DogFilm(
    frames=32, frame_rate_hz=16.0, cycles=2.0, width_px=240, height_px=160, trunk_px=85.0
)
PHASE = np.linspace(0, 1, 97)[:-1]


@pytest.mark.parametrize("shape", [FORE, HIND], ids=["fore", "hind"])
def test_a_foot_that_stays_leaves_the_limb_as_it_was_drawn(shape):
    still = limb_outlines(shape, np.zeros(2), np.zeros(2), 128)
    assert signed_area(Curve(still, True)) > 0  # clockwise as seen
    lengths = np.linalg.norm(np.diff(still, axis=0, append=still[:1]), axis=1)
    assert lengths.max() < 1.01 * lengths.mean()  # at the toes a chord is shorter than its arc
    # Moving foot and hip together moves all of it, but for the lean of the pastern, which goes by
    # the foot; so only without one.
    stiff = replace(shape, lean=(0.0, 0.0))
    both = limb_outlines(stiff, np.array([0.2, -0.1]), np.array([0.2, -0.1]), 128)
    assert both == pytest.approx(limb_outlines(stiff, np.zeros(2), np.zeros(2), 128) + [0.2, -0.1])


@pytest.mark.parametrize("name", NAMES)
def test_planted_feet_stay_where_they_are_on_the_ground(name):
    # The body gets on by two strides a cycle: what the ground does under it, the foot does.
    phase = PHASE[~is_swinging(name, PHASE)]
    on_ground = foot_displacements(SMALL, name, phase)[:, 0] + 2 * SMALL.stride * phase
    # All feet land once a cycle, so one place, or for two runs of phases two places.
    assert np.ptp(on_ground) < 1e-12
    assert foot_displacements(SMALL, name, phase)[:, 1] == pytest.approx(0)
    assert (foot_displacements(SMALL, name, PHASE)[:, 1] <= 0).all()


def test_a_foot_swings_slowly_at_both_ends_and_never_back():
    for name in NAMES:
        whole = np.r_[PHASE, 1.0]
        part = np.r_[half_cycle_progress(SMALL, name, PHASE), 0.0]
        for half in (whole[:49], whole[48:]):
            inside = part[np.isin(whole, half[:-1])]
            speed = np.diff(np.r_[inside, 1.0])
            assert (speed > 0).all()
            if is_swinging(name, half[:1] + 1e-6)[0]:
                assert speed[0] < speed[len(speed) // 2] / 2 > speed[-1]
            else:
                assert speed == pytest.approx(speed.mean())


def test_the_limbs_of_one_end_are_each_other_half_a_cycle_later():
    for end in ("fore", "hind"):
        near = limb_contours_at(SMALL, f"{end}_right", PHASE, 64)
        far = limb_contours_at(SMALL, f"{end}_left", PHASE + 0.5, 64)
        offset = far - near
        assert offset == pytest.approx(np.broadcast_to(offset[0, 0], offset.shape), abs=1e-9)


def test_no_limb_folds_and_none_jumps():
    fine = np.linspace(0, 1, 481)
    for name in NAMES:
        points = limb_contours_at(SMALL, name, fine, 128)
        steps = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
        assert steps.max() < 0.012 * SMALL.trunk_px
        assert all(is_simple(frame) for frame in points[::40])
        sizes = [signed_area(Curve(frame, True)) for frame in points[::40]]
        assert np.ptp(sizes) < 0.12 * np.mean(sizes)


def test_true_gamma_comes_to_that_of_the_clock_as_the_swing_becomes_small():
    apart = []
    for scale in (1.0, 0.25, 0.025):
        dog = DogFilm(stride=0.4 * scale, lift=0.08 * scale**3, bob=0.0)
        found = true_gamma(dog, 64)
        pairs = ((n, label) for n in NAMES for label in "AB")
        off = [abs(found[n][at] - foot_gammas(dog, n)["AB".index(at)]) for n, at in pairs]
        apart.append(max(off))
    assert apart[0] > 0.1  # at full swing points go on arcs
    assert apart[0] > apart[1] > apart[2]
    assert apart[2] < 0.01


def test_the_film_is_the_same_again_and_shows_the_near_limbs_where_they_are(tmp_path):
    pictures = list(dog_frames(SMALL))
    assert all((a == b).all() for a, b in zip(pictures, dog_frames(SMALL), strict=True))
    with Mp4Writer(tmp_path / "dog.mp4", pictures[0].shape, Fraction(16), 18) as movie:
        for picture in pictures:
            movie.write(picture)
    with av.open(str(tmp_path / "dog.mp4")) as container:
        coded = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(coded) == SMALL.frames
    for k in range(0, SMALL.frames, 5):
        exact = true_masks(SMALL, k)
        for name, mask in limb_masks(coded[k]).items():
            both = (mask & exact[name]).sum() / (mask | exact[name]).sum()
            assert both > 0.9
    with pytest.raises(FinloopError, match="0 regions"):
        limb_masks(np.zeros((20, 20, 3), np.uint8))


def test_the_dog_stands_on_the_ground_and_heads_to_the_right():
    for phase in frame_phases(SMALL)[:8]:
        lowest = max(limb_contours_at(SMALL, n, np.array(phase), 128)[:, 1].max() for n in NAMES)
        assert lowest == pytest.approx(0, abs=0.02 * SMALL.trunk_px)
        body, head = part_contour(SMALL, phase, BODY, 64), part_contour(SMALL, phase, HEAD, 64)
        assert head[:, 0].max() > body[:, 0].max()
    assert (np.diff(standing_points_px(SMALL)[:, 0]) >= 0).all()
    soles = feet_px(SMALL, "fore_right", PHASE[PHASE < 0.5])
    assert soles[:, 1] == pytest.approx(0)
    assert set(LIMBS) == {"fore", "hind"}
