"""The tempo of a fish: laws of its lag behind the film, and of the price of a rest."""

import numpy as np
import pytest

from finloop.plan.cost import Tempo
from finloop.plan.graph import ROW, MotionGraph, mean_step_px, row_lags

N = 200


def film_of(steps):
    """One track that moves so many px (n,) from row to row, to the right."""
    rows = np.zeros(len(steps), ROW)
    rows["dx"], rows["has_next"] = steps, True
    rows["has_next"][-1] = False
    rows["dx"][-1] = 0.0
    empty = np.zeros(0, np.int32)
    return MotionGraph(rows, np.zeros(1, np.int32), empty, np.zeros(0), True, len(steps))


def straight_path(steps):
    """The way (n, 3) of a fish that begins at 0, 0."""
    x = np.cumsum(steps)
    return np.column_stack([x, np.zeros_like(x), np.zeros_like(x)])


def test_who_swims_as_the_film_does_lags_by_nothing():
    film = film_of(np.where(np.arange(N) % 2 == 0, 1.0, 3.0))
    assert row_lags(film.rows).sum() == pytest.approx(0.0, abs=1e-9)
    tempo = Tempo.from_film(film, 50.0, 1.0)
    even = straight_path(np.full(40, mean_step_px(film.rows)))
    assert tempo.lag_after(0.0, even, (0.0, 0.0)) == pytest.approx(0.0, abs=1e-9)


def test_a_tick_on_the_spot_is_a_tick_behind_and_is_forgotten():
    tempo = Tempo(2.0, 0.9, 5.0)
    assert tempo.lag_after(0.0, straight_path([0.0]), (0.0, 0.0)) == pytest.approx(1.0)
    assert tempo.lag_after(0.0, straight_path([4.0]), (0.0, 0.0)) == pytest.approx(-1.0)
    assert tempo.lag_after(10.0, straight_path([2.0]), (0.0, 0.0)) == pytest.approx(9.0)
    # A way in two parts lags as far as the whole.
    steps = np.random.default_rng(0).uniform(0, 4, 30)
    whole, first = straight_path(steps), straight_path(steps)[:11]
    half = tempo.lag_after(3.0, first, (0.0, 0.0))
    lag = tempo.lag_after(3.0, whole, (0.0, 0.0))
    assert tempo.lag_after(half, whole[11:], (first[-1, 0], 0.0)) == pytest.approx(lag)


def test_a_rest_is_dear_for_who_lags_and_worth_something_for_who_is_ahead():
    tempo = Tempo(2.0, 0.99, 5.0)
    assert tempo.cost_of_rest(0.0, 0.2) == 0.0
    assert tempo.cost_of_rest(5.0, 0.2) == pytest.approx(0.2)
    assert tempo.cost_of_rest(-5.0, 0.2) == pytest.approx(-0.2)
    assert tempo.cost_of_rest(1e9, 0.2) == tempo.cost_of_rest(1e6, 0.2)


def test_the_usual_lag_grows_with_the_rests_of_the_film():
    long, short = ((np.arange(N) // n) % 2 * 2.0 for n in (20, 2))
    rests, flicks = (Tempo.from_film(film_of(steps), 50.0, 0.1).usual for steps in (long, short))
    assert rests > 3 * flicks
    assert Tempo.from_film(film_of(np.full(N, 2.0)), 50.0, 4.0).usual == 4.0  # even: the least


def test_along_a_path_to_be_slow_costs_more_the_farther_a_fish_lags_and_never_pays():
    tempo = Tempo(2.0, 0.9, 8.0)
    prices = [tempo.cost_of_rest_on_path(lag, 2.0) for lag in (-100, -2, 0, 8, 24, 1000)]
    assert prices == pytest.approx([0.0, 0.0, 0.5, 2.5, 6.5, 6.5])
