"""Zones fitted to a film: a regression of directions.

In the frame of the body, a fish's own direction is 1. The expected unit vector of its heading after
the horizon H is

    E[d] = a + Σ b_z D_z + c W,

where D_z are the pulls of the zones (`zone_pulls`) and W points away from the nearest
wall. Coefficients are real, so that the film's mirror image gives the same ones. The weights of the
zones are b_z / a, as the fish's own direction has weight 1. W keeps fish that avoid a wall, beyond
which there are no fish, from counting as attracted by the others; it is no part of the rule.

Radii and blind angle come from a list and are those that best predict held-out data: one part in
time of the half is predicted with the coefficients of its other part. So zones that fit by chance
are seldom taken. A zone whose weight would be negative is left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy

from finloop.base.arrays import Complex, Floats, Ints, Mask, Reals
from finloop.calibrate.film import FilmGroup
from finloop.calibrate.settings import CalibrateSettings
from finloop.social.neighbours import Neighbours
from finloop.social.zones import COUZIN, Zones, weigh_zone_pulls, zone_pulls

_EQUAL = 1e-12  # share of the residual: of equally good zones the smaller ones are taken
_ZONES = (1, 2, 3)  # columns of a regression
_LEAST_DIRECTION = 0.05  # least weight of a fish's own direction: the zones' are divided by it


@dataclass(frozen=True)
class ZoneFit:
    """The zones fitted to a film, and how well they predict the directions of its fish.

    direction_weight: of a fish's present direction in the regression. explained,
    explained_held_out: share (at most 1) of the squared error without zones that the zones remove,
    in the first and in the second half of the film.
    """

    zones: Zones
    direction_weight: float
    explained: float
    explained_held_out: float


class _ZoneChoice(NamedTuple):
    """Tried radii and blind angle, their error on held-out data, and the pulls (n, 3) they give."""

    error: float
    radii: tuple[float, float, float]
    blind_deg: float
    pulls: Complex


def fit_zones(film: FilmGroup, settings: CalibrateSettings) -> ZoneFit:
    """Return the zones of repulsion, alignment and attraction that fit the first half of a film.

    The best zones predict the later headings of the fish. Parameters that are not "auto" stay
    fixed; listed radii and blind angles are tried for the others. The second half tests them.
    Vectors are complex numbers relative to a fish's own direction, which is 1.
    """
    rows, held_out = (film.rows_for_fit(first, settings.rows) for first in (True, False))
    wall = _wall_pull(film, rows)
    after = film.relative_headings(rows)  # later directions
    weights = (settings.repulsion_weight, settings.alignment_weight, settings.attraction_weight)
    fixed = [None if weight == "auto" else float(weight) for weight in weights]
    best = _choose_zones(film, rows, settings, fixed)
    with_zones, _ = fit_directions(best.pulls, wall, after, fixed)
    direction_weight = max(float(with_zones[0]), _LEAST_DIRECTION)
    zones = _weighted_zones(best.radii, best.blind_deg, with_zones[1:4] / direction_weight, fixed)
    no_pulls = np.zeros((len(rows), 3), complex)  # for comparison: fish that ignore each other
    without, _ = fit_directions(no_pulls, wall, after, [None] * 3)
    explained, explained_held_out = (
        _explained_share(film, half, zones, with_zones, without) for half in (rows, held_out)
    )
    return ZoneFit(zones, direction_weight, explained, explained_held_out)


def _choose_zones(
    film: FilmGroup, rows: Ints, settings: CalibrateSettings, fixed: Sequence[float | None]
) -> _ZoneChoice:
    """Return the radii and blind angle that best predict later headings on held-out rows.

    rows: of the film; each half of them in time is predicted from the other half; fixed: weights of
    the zones, None for one that is fitted.
    """
    seen, wall = film.visible_neighbours(rows), _wall_pull(film, rows)
    after = film.relative_headings(rows)
    is_first_part = film.frame[rows] < np.median(film.frame[rows])
    choices = _possible_radii(settings)
    all_radii = sorted({radius for radii in choices for radius in radii})
    blind_angles = [settings.blind_angle_deg]
    if settings.blind_angle_deg == "auto":
        blind_angles = sorted(settings.blind_angles_deg)
    best: _ZoneChoice | None = None
    for angle in map(float, blind_angles):
        sums = NeighbourSums(seen, all_radii, angle)
        for radii in choices:
            pulls = sums.mean_zone_directions(radii)
            error = cross_validate(pulls, wall, after, fixed, is_first_part)
            # Of zones that are equally good but for rounding, the first, smaller ones are taken.
            if best is None or error < best.error * (1 - _EQUAL):
                best = _ZoneChoice(error, radii, angle, pulls)
    assert best is not None
    return best


def _explained_share(
    film: FilmGroup, rows: Ints, zones: Zones, with_zones: Floats, without: Floats
) -> float:
    """Return the share by which zones reduce the squared error of predicted directions.

    rows: of the film, on which errors are measured. with_zones, without (5,): coefficients of own
    direction, three zones and wall; in `without` those of the zones are 0.
    """
    pulls = zone_pulls(film.visible_neighbours(rows), zones.radii, zones.blind_deg)
    wall, after = _wall_pull(film, rows), film.relative_headings(rows)

    def squared_error(coefficients: Floats) -> float:
        """Return the squared error that a model with coefficients (5,) leaves."""
        own, *weights, wall_weight = coefficients
        errors = after - own - weigh_zone_pulls(pulls, weights) - wall_weight * wall
        return float((np.abs(errors) ** 2).sum())

    return 1 - squared_error(with_zones) / squared_error(without)


def _wall_pull(film: FilmGroup, rows: Ints) -> Complex:
    """Return vectors (k,) that lead the fish in k rows away from the wall, longer if nearer.

    They are relative to the fish's own body.
    """
    return film.walls.vectors_from_wall(film.place[rows], film.heading[rows])


class _SumsWithin(NamedTuple):
    """Sums over the neighbours of n fish that are nearer than each of k radii.

    vectors (n, k): sum of these neighbours' vectors, complex; counts (n, k): their number.
    """

    vectors: Complex
    counts: Ints

    def ring_mean(self, outer: int, inner: int | None = None) -> Complex:
        """Return the mean vector (n,) of the neighbours between two radii; 0 without a neighbour.

        outer, inner: numbers of the radii; without an inner one the ring is a disc.
        """
        total, count = self.vectors[:, outer], self.counts[:, outer]
        if inner is not None:
            total, count = total - self.vectors[:, inner], count - self.counts[:, inner]
        return np.where(count > 0, total / np.maximum(count, 1), 0)


def _sum_within(vectors: Complex, within: Mask) -> _SumsWithin:
    """Sum and count the vectors of each fish's neighbours within k radii.

    vectors (n, m): one of each fish's m neighbours, such as a heading; within (n, m, k): whether
    each neighbour counts for each radius.
    """
    return _SumsWithin((vectors[..., None] * within).sum(axis=1), within.sum(axis=1))


class NeighbourSums:
    """Sums over the neighbours of n fish, from which the pulls of many zones are computed quickly.

    A zone is the difference of the sums within two radii.
    """

    def __init__(self, seen: Neighbours, radii: Sequence[float], blind_deg: float) -> None:
        """Sum over the neighbours (n, m) nearer than each radius.

        radii: ascending, body lengths; blind_deg: blind angle behind the fish, in degrees.
        """
        self._number_of = {radius: number for number, radius in enumerate(radii)}
        sees = seen.bearing.real >= -np.cos(np.radians(blind_deg) / 2)
        within = np.stack([seen.distance < radius for radius in radii], axis=-1)
        visible = within & sees[..., None]
        self._all_bearings = _sum_within(seen.bearing, within)
        self._headings = _sum_within(seen.heading, visible)
        self._bearings = _sum_within(seen.bearing, visible)

    def mean_zone_directions(self, radii: tuple[float, float, float]) -> Complex:
        """Return the mean direction (n, 3), complex: away from, along with and towards neighbours.

        The three are for repulsion, alignment and attraction; the last two are 0 while a fish is in
        the first zone. They equal those of `finloop.social.zones.zone_pulls`, but come from stored
        sums. radii: of the zones, each one of those given to the constructor.
        """
        inner, middle, outer = (self._number_of[radius] for radius in radii)
        is_unrepelled = self._all_bearings.counts[:, inner] == 0
        pulls = [
            -self._all_bearings.ring_mean(inner),
            is_unrepelled * self._headings.ring_mean(middle, inner),
            is_unrepelled * self._bearings.ring_mean(outer, middle),
        ]
        return np.stack(pulls, axis=-1)


class _RegressionSums(NamedTuple):
    """Sums over n rows from which a least-squares regression is solved.

    gram (5, 5): products of the five columns with each other; right (5,): with the directions;
    square: sum of the squared directions.
    """

    gram: Floats
    right: Floats
    square: float

    def residual(self, solution: Floats) -> float:
        """Return the sum of squared errors that a regression with coefficients (5,) leaves."""
        return self.square + float(solution @ (self.gram @ solution - 2 * self.right))


def _sum_rows(columns: Complex, after: Complex) -> _RegressionSums:
    """Return the sums over n rows from which a regression of directions on columns is solved.

    columns (n, 5): own direction, zones, wall. after (n,): the later directions.
    """
    # Not `@`: its threads cost more time than these few numbers.
    gram = np.einsum("ni,nj->ij", columns.conj(), columns).real
    right = np.einsum("ni,n->i", columns.conj(), after).real
    return _RegressionSums(gram, right, float((np.abs(after) ** 2).sum()))


def _solve_regression(sums: _RegressionSums, weights: Sequence[float | None]) -> Floats:
    """Return the coefficients (5,) of a regression on own direction, three zones and wall.

    Those of the zones are 0 or more: while one is negative, the most negative one is left out (0),
    and the rest solved again. weights (3,): None for a zone that is fitted. A zone with a fixed
    weight has coefficient 0, because its pull is already part of the first column.
    """
    fitted = [k for k in _ZONES if weights[k - 1] is None and sums.gram[k, k] > 0]
    solution = np.zeros(5)
    while True:  # each zone is left out at most once
        terms = [0, *fitted, 4]  # 0: own direction, 4: wall
        solved = scipy.linalg.lstsq(sums.gram[np.ix_(terms, terms)], sums.right[terms])[0]
        zone_values = solved[1:-1]
        if not fitted or zone_values.min() >= 0:
            break
        del fitted[int(zone_values.argmin())]
    solution[terms] = solved
    return solution


def _regression_columns(pulls: Complex, wall: Complex, weights: Sequence[float | None]) -> Complex:
    """Return the regressors (n, 5) of later directions: own direction, three zones, wall.

    Directions are complex; 1 is straight on. To the column of the own direction the pulls of zones
    with a fixed weight are added, so their own columns are not to be fitted (`_solve_regression`
    leaves them out). The arguments are those of `fit_directions`.
    """
    own = 1.0 + weigh_zone_pulls(pulls, _replace_none_by_zero(weights))
    return np.column_stack([own, pulls, wall])


def _replace_none_by_zero(weights: Sequence[float | None]) -> Floats:
    """Return weights as an array, with 0 for those that are None because they are fitted."""
    return np.array([weight or 0.0 for weight in weights])


def fit_directions(
    pulls: Complex, wall: Complex, after: Complex, weights: Sequence[float | None]
) -> tuple[Floats, float]:
    """Fit the later directions of fish to own direction, zones and wall, by least squares.

    Return the coefficients (5,), and the sum of squared errors that they leave. pulls (n, 3): of
    the zones; wall (n,): vectors away from the wall; after (n,): the later directions; weights
    (3,): of each zone, None if it is fitted. A fixed weight is relative to the own direction's.
    """
    sums = _sum_rows(_regression_columns(pulls, wall, weights), after)
    solution = _solve_regression(sums, weights)
    coefficients = solution.copy()
    # The first column is the own direction together with the pulls of fixed weight.
    coefficients[1:4] += _replace_none_by_zero(weights) * solution[0]
    return coefficients, sums.residual(solution)


def cross_validate(
    pulls: Complex, wall: Complex, after: Complex, weights: Sequence[float | None], parts: Mask
) -> float:
    """Return the squared error of directions if each part of the rows predicts the other one.

    It is the sum over all n rows of squared differences of unit vectors. parts (n,): True for one
    part, False for the other. The other arguments are those of `fit_directions`.
    """
    columns = _regression_columns(pulls, wall, weights)
    first, second = (_sum_rows(columns[part], after[part]) for part in (parts, ~parts))
    from_second, from_first = (_solve_regression(sums, weights) for sums in (second, first))
    return first.residual(from_second) + second.residual(from_first)


def _possible_radii(settings: CalibrateSettings) -> list[tuple[float, float, float]]:
    """Return all triples of ascending zone radii to try, the smallest first.

    Given radii are fixed. They are also tried for the other zones, so there is at least one triple.
    """
    numbers = [float(value) for value in settings.zone_radii if value != "auto"]
    all_radii = sorted({*settings.radii, *numbers})
    choices = [all_radii if value == "auto" else [float(value)] for value in settings.zone_radii]
    return [
        (inner, middle, outer)
        for inner, middle, outer in product(*choices)
        if inner <= middle <= outer
    ]


def _weighted_zones(
    radii: tuple[float, float, float], blind_deg: float, weights: Reals,
    fixed: Sequence[float | None],
) -> Zones:  # fmt: skip
    """Return zones with their weights; a last fitted zone of weight 0 gets the width 0.

    weights (3,): fitted ones, used where `fixed` (3,), the given ones, is None.
    """
    inner, middle, outer = radii
    chosen = [
        float(weight) if given is None else given
        for weight, given in zip(weights, fixed, strict=True)
    ]
    if fixed[2] is None and chosen[2] == 0:
        outer = middle
        if fixed[1] is None and chosen[1] == 0:
            middle = outer = inner
    return Zones(inner, middle, outer, blind_deg, *chosen)


def default_zones(settings: CalibrateSettings) -> Zones:
    """Return the zones for a film that has too few fish for a fit: given ones, else Couzin's."""
    weights = settings.repulsion_weight, settings.alignment_weight, settings.attraction_weight
    names = [field.name for field in fields(Zones)]
    given = zip(names, (*settings.zone_radii, settings.blind_angle_deg, *weights), strict=True)
    numbers = {name: float(value) for name, value in given if value != "auto"}
    return replace(COUZIN, **numbers)
