"""The period of a motion: known sines and chirps, what is no beat, and the phase of a wave."""

import numpy as np
import pytest

from finloop.base.errors import FinloopError
from finloop.gait.period import (
    CONFIDENT,
    find_period,
    period_from_phase,
    remove_beat,
    require_periodic,
    set_phase_zero,
)

RATE = 50.0
AT = np.arange(150)
TIME = AT / RATE


def wave(phase: np.ndarray, channels: int = 5) -> np.ndarray:
    """A wave that runs along the channels and grows, (frames, channels); cosine on the last."""
    along = np.linspace(0.5, 0, channels)
    return np.cos(2 * np.pi * (phase[:, None] + along)) * (1 - along)


def off(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Difference of phases, wrapped to half a cycle."""
    return (found - true + 0.5) % 1 - 0.5


@pytest.mark.parametrize("frequency", [0.7, 1.0, 3.3, 11.0, 19.0])
def test_a_sine_has_its_frequency_and_phase(frequency: float) -> None:
    """From two cycles in the film to near the limit of the frame rate."""
    true = frequency * TIME + 0.3
    found = find_period(wave(true), RATE, np.cos(2 * np.pi * true))
    assert found.frequency_hz == pytest.approx(frequency, rel=0.01)
    assert np.abs(off(found.phase, true)).max() < 0.02
    assert found.steady.all()
    assert found.confidence > 0.99
    assert found.why == ""
    assert found.cycles == pytest.approx(frequency * (TIME[-1] - TIME[0]), rel=0.01)


def test_size_place_and_turn_of_what_moves_do_not_matter() -> None:
    rng = np.random.default_rng(1)
    true = 2.0 * TIME
    y = wave(true) + 0.1 * rng.standard_normal((len(TIME), 5))
    turn = np.linalg.qr(rng.standard_normal((5, 5)))[0]
    extreme = np.cos(2 * np.pi * true)
    one, other = find_period(y, RATE, extreme), find_period(40 * y @ turn + 300, RATE, 40 * extreme)
    np.testing.assert_allclose(one.phase, other.phase, atol=1e-9)
    assert one.confidence == pytest.approx(other.confidence, abs=1e-9)


def test_turned_over_it_is_half_a_cycle_later() -> None:
    true = 2.3 * TIME + 0.1
    one = find_period(wave(true), RATE, np.cos(2 * np.pi * true))
    other = find_period(-wave(true), RATE, -np.cos(2 * np.pi * true))
    np.testing.assert_allclose(off(one.phase, other.phase + 0.5), 0, atol=1e-9)


def test_without_an_extreme_phase_0_is_that_of_the_strongest_motion() -> None:
    """Its largest coordinate, counted positive, is greatest there, whatever the smaller ones do."""
    true = 2.0 * TIME
    y = np.column_stack([0.2 * np.sin(2 * np.pi * true), -np.cos(2 * np.pi * true)])
    assert np.abs(off(find_period(y, RATE).phase, true + 0.5)).max() < 0.03


def test_the_phase_follows_a_beat_that_quickens() -> None:
    true = np.cumsum(np.linspace(1.5, 4.0, len(TIME))) / RATE
    found = find_period(wave(true), RATE, np.cos(2 * np.pi * true))
    assert np.abs(off(found.phase, true)).max() < 0.12
    assert np.sqrt((off(found.phase, true)[15:-15] ** 2).mean()) < 0.03
    assert found.frequency_hz == pytest.approx(np.ptp(true) / np.ptp(TIME), rel=0.02)
    assert (np.diff(found.phase) > 0).all()


def test_a_drift_beside_the_beat_is_not_a_beat() -> None:
    true = 2.0 * TIME
    found = find_period(wave(true) + 0.2 * TIME[:, None] ** 2, RATE, np.cos(2 * np.pi * true))
    assert found.frequency_hz == pytest.approx(2.0, rel=0.02)
    assert np.sqrt((off(found.phase, true) ** 2).mean()) < 0.03
    assert found.confidence > 0.9


def test_noise_takes_confidence_away() -> None:
    rng = np.random.default_rng(2)
    noise = rng.standard_normal((len(TIME), 5))
    sure = [find_period(wave(2 * TIME) + size * noise, RATE).confidence for size in (0, 0.2, 0.4)]
    assert sure[0] > sure[1] > sure[2]
    assert sure[1] > CONFIDENT


@pytest.mark.parametrize("seed", range(4))
def test_noise_and_wandering_are_not_periodic(seed: int) -> None:
    noise = np.random.default_rng(seed).standard_normal((len(TIME), 4))
    for signal in (noise, np.cumsum(noise, axis=0)):
        found = find_period(signal, RATE)
        assert found.confidence < CONFIDENT
        assert found.why
        with pytest.raises(FinloopError, match="the motion of the fish is not periodic"):
            require_periodic(found, "the fish")


def test_a_single_burst_is_no_beat() -> None:
    """One beat, then rest: nothing to compare it with."""
    found = find_period(wave(4.0 * TIME) * np.exp(-(((TIME - 1.5) / 0.12) ** 2))[:, None], RATE)
    assert "burst" in found.why
    assert not found.steady.any()


def test_what_has_no_period_says_why() -> None:
    assert find_period(np.ones((30, 3)), RATE).why == "nothing moves"
    phase = 2.0 * TIME  # halves of cycles do not add up to a beat
    assert (
        "0.0 cycles are steady" in period_from_phase(wave(phase), phase, phase % 1 < 0.6, RATE).why
    )
    found = find_period(wave(0.15 * TIME), RATE)
    assert "half a cycle" in found.why
    assert np.isnan(found.frequency_hz)
    assert "too few" in find_period(wave(3 * TIME[:7]), RATE).why


def test_only_the_frames_that_beat_are_steady() -> None:
    """Swimming, then gliding; the frequency is that of the swimming."""
    beats = TIME < 2.0
    found = find_period(wave(3.0 * TIME) * beats[:, None], RATE)
    assert found.steady[5:85].all()
    assert not found.steady[115:].any()
    assert found.frequency_hz == pytest.approx(3.0, rel=0.03)


def test_frames_not_seen_are_bridged_and_not_steady() -> None:
    true = 2.0 * TIME
    signal = wave(true)
    signal[70:73] = np.nan
    found = find_period(signal, RATE, np.cos(2 * np.pi * true))
    assert not found.steady[70:73].any()
    assert found.steady[[69, 73]].all()
    assert np.abs(off(found.phase, true)).max() < 0.03


def test_the_stronger_of_two_beats_is_the_period() -> None:
    both = np.concatenate([wave(2 * TIME), 0.5 * wave(7 * TIME)], axis=1)
    assert find_period(both, RATE).frequency_hz == pytest.approx(2, rel=0.03)


@pytest.mark.parametrize(
    ("signal", "rate", "message"),
    [
        (np.zeros(20), 30.0, r"shape \(20,\)"),
        (np.full((20, 2), np.nan), 30.0, "40 values are no numbers"),
        (np.zeros((20, 2)), 0.0, "frame rate of 0 Hz"),
    ],
)
def test_what_is_no_motion_is_refused(signal: np.ndarray, rate: float, message: str) -> None:
    with pytest.raises(FinloopError, match=message):
        find_period(signal, rate)


def test_the_course_keeps_a_line_and_drops_the_beat() -> None:
    phase = 1.7 * TIME + 0.2
    line = np.column_stack([3 * TIME - 1, 2 - TIME])
    beat = np.column_stack([np.cos(2 * np.pi * phase), np.sin(2 * np.pi * phase)])
    np.testing.assert_allclose(remove_beat(line + beat, phase), line, atol=1e-9)


def test_cycles_are_foretold_by_the_others() -> None:
    """A motion whose cycles all differ has a phase, and no confidence."""
    phase = 2.0 * TIME
    good = np.ones(len(TIME), bool)
    same = period_from_phase(wave(phase), phase, good, RATE)
    other = period_from_phase(
        wave(phase) * np.sign(np.sin(2.4 * phase))[:, None], phase, good, RATE
    )
    assert same.confidence == pytest.approx(1, abs=1e-6)
    assert other.confidence < 0.2
    assert other.why == "no cycle is much like another"
    again = set_phase_zero(same, wave(phase)[:, -1])
    np.testing.assert_allclose(off(again.phase, phase), 0, atol=1e-6)


def test_a_cycle_is_not_foretold_by_itself() -> None:
    """Two cycles of noise: a curve through both goes near them, one says nothing of the other."""
    noise = np.random.default_rng(3).standard_normal((16, 8))
    assert period_from_phase(noise, np.arange(16) / 8, np.ones(16, bool), RATE).confidence < 0.02
