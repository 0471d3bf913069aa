"""Animals that stay in their places: how fast they swim against a current, and where they would be."""

import numpy as np
import pytest
from toy_film import RATE, film_of, film_world_of, lessons, loops

from finloop.animate.measures import motion_of_film
from finloop.animate.motion import learn_motion
from finloop.base.settings import settings
from finloop.features.current import measure_current
from finloop.modes.phases import learn_phases
from finloop.plan.graph import mean_step_px


def beating(frames=200, hz=2.0, wide=0.18, drift=0.0):
    """Places (n, 2), headings, tail and bend of an animal that beats its tail and drifts away."""
    rng = np.random.default_rng(0)
    at = np.arange(frames)
    tail = wide / 2 * np.sin(2 * np.pi * hz * at / RATE)
    place = rng.normal(0, 0.01, (frames, 2)) + np.outer(drift * at / RATE, (1, 0))
    return place, rng.normal(3, 2, frames), tail, 0.5 * tail


@pytest.mark.parametrize(("hz", "wide", "speed"), [(2, 0.18, 1.2), (3, 0.09, 0.9), (2, 0.6, 1.4)])
def test_a_tail_beat_on_the_spot_says_how_fast_the_water_is(hz, wide, speed):
    # At a Strouhal number of 0.3: hz * wide / 0.3, and at most 0.7 body lengths a beat.
    parts = beating(hz=hz, wide=wide)
    found = measure_current(*parts, [slice(0, 200)], RATE)
    assert found == pytest.approx(speed, rel=0.1)
    twice = [np.concatenate([part, part]) for part in parts]
    assert measure_current(*twice, [slice(0, 200), slice(200, 400)], RATE) == pytest.approx(found)
    quicker = measure_current(*parts, [slice(0, 200)], 10 * RATE)
    assert quicker == pytest.approx(10 * found)


def test_who_swims_about_or_turns_or_rests_is_in_no_current():
    track = [slice(0, 200)]
    for drift in (0.09, 0.3):  # 0.7 and 2.4 body lengths
        assert measure_current(*beating(drift=drift), track, RATE) == 0
    assert measure_current(*beating(wide=0.03), track, RATE) == 0
    place, heading, tail, bend = beating()
    assert measure_current(place, 100 * heading, tail, bend, track, RATE) == 0


def test_all_that_swims_by_the_film_gets_on_as_in_still_water():
    still = lessons()
    speeds = [1.0, 2.0]
    drifted = [still.assign(current=speed, time_s=still["frame"] / RATE) for speed in speeds]
    low, high = (film_of(table, loops()) for table in drifted)
    plain = film_of(still, loops())
    extra = [one.speed - plain.speed for one in (low, high)]
    assert np.median(extra[0]) == pytest.approx(1, abs=0.05)
    assert np.median(extra[1]) == pytest.approx(2, abs=0.1)
    assert mean_step_px(high.rows) > mean_step_px(low.rows) > mean_step_px(plain.rows)
    every = (still, *drifted)
    lessons_of = [learn_motion(table, RATE, 5) for table in every]
    quick = [film_world_of(taught=motion).fastest_bl_s for motion in lessons_of]
    phases = [learn_phases(motion, settings("network")).high for motion in lessons_of]
    assert quick[0] < quick[1] < quick[2] and phases[0] < phases[1] < phases[2]
    moved = [motion_of_film(table, learn_motion(still, RATE, 5))[0] for table in every]
    assert np.median(moved[2] - moved[0]) == pytest.approx(2, abs=0.1)
