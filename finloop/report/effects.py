"""Say what a parameter does to a measure, and whether more than the choice of a seed does.

Runs that differ in their seeds alone are a cell. All cells have the same seeds, so what a seed
changes alike in every cell is taken out first: another seed may hold out another part of the film.
The spread is the standard deviation within cells of what is left.
The effect is the greatest difference between the means of a parameter's values, in spreads. Tukey's
test says which values differ by more than the seeds do. The importance of several parameters is
that of a random forest: how much worse it predicts a measure if a parameter's values are permuted.
"""

from collections.abc import Sequence
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import scipy

from finloop.base.arrays import Floats, Mask
from finloop.report.headlines import HEADLINES, HIGHER, LOWER
from finloop.report.tables import MEASURES, format_number

SIGNIFICANCE = 0.05  # how often chance alone may seem to be an effect of a parameter on a measure
SAME = "the same in every run"
NO_EFFECT = "no effect beyond the seeds"
_TREES, _PERMUTATIONS = 100, 10
_EQUAL = 1e-9  # relative: a smaller difference is one of rounding
_DIRECTION_BY_TARGET_START = {"100": HIGHER, "≥": HIGHER, "0": LOWER, "≤": LOWER}
_OTHER_DIRECTIONS = {
    "arrival_heading_error_deg": LOWER,
    "film_pct": HIGHER,
    "longest_exact_repeat_s": LOWER,
    "stuck_pct": LOWER,
    "ghosts_pct": LOWER,
    "turn_area_missed_median": LOWER,
}
"""Endings of measures of `animate` that neither HEADLINES nor MEASURES give a direction."""


class Effect(NamedTuple):
    """The effect of a parameter on a measure, compared with the spread between seeds.

    values: those of the parameter, numbers first, in order, as texts. means: of the measure, one
    per value. spread: standard deviation between seeds, without what a seed changes alike for all
    values; NaN if no two runs differ in seeds alone. size: greatest difference of means, in
    spreads; infinite if the seeds change nothing, NaN without a spread. best: which values are no
    worse than the best one by more than the seeds explain; without a good direction the best one
    has the greatest mean. verdict: one sentence without its full stop.
    """

    parameter: str
    measure: str
    values: Sequence[str]
    means: Floats
    spread: float
    size: float
    best: Mask
    verdict: str


def good_direction(measure: str) -> str:
    """Return HIGHER or LOWER, whichever is better for a measure `<stage>.<number>`, else "".

    It is the direction of the stage's headline of that name. Numbers of `animate` without a
    headline have that of their target in the report, or of `_OTHER_DIRECTIONS`.
    """
    stage, _, name = measure.partition(".")
    for headline in HEADLINES.get(stage, []):
        if headline.name == name:
            return headline.good
    return _good_direction_of_mode(name) if stage == "animate" else ""


def _good_direction_of_mode(name: str) -> str:
    """Return HIGHER or LOWER, whichever is better for a number `<mode>_<measure>`, else "".

    The beginning of the measure's target in the report says it, such as "≥". A measure without a
    target may stand in `_OTHER_DIRECTIONS`, there without the `trials_` of random goals.
    """
    key = name.partition("_")[2]  # after the mode
    targets = {measure.key: measure.target for measure in MEASURES}
    if target := targets.get(key):
        directions = _DIRECTION_BY_TARGET_START.items()
        return next((good for start, good in directions if target.startswith(start)), "")
    return _OTHER_DIRECTIONS.get(key.removeprefix("trials_"), "")


def is_category(value: object) -> bool:
    """Return whether a parameter's value is no number: a text, a truth value or NaN."""
    return not isinstance(value, Real) or isinstance(value, bool) or value != value


def rank_values(column: "pd.Series[Any]") -> "tuple[pd.Series[int], list[str]]":
    """Return the rank of each value, and the values by rank as texts; equal values share a rank.

    Ranks begin at 0: numbers in rising order, then other values in that of their texts.
    """
    sort_keys = [
        (1, 0.0, str(value)) if is_category(value) else (0, float(value), f"{value:g}")
        for value in column
    ]
    order = sorted(set(sort_keys))
    ranks = pd.Series([order.index(key) for key in sort_keys], column.index)
    return ranks, [text for _, _, text in order]


def measure_effects(
    parameters: pd.DataFrame, measures: pd.DataFrame, seeds: "pd.Series[str]"
) -> list[Effect]:
    """Return the effect of every parameter on every measure that some run has.

    All have a row per run, with the same index. parameters: without seeds. seeds: as texts.
    """
    effects = []
    for name in measures.columns[measures.notna().any()]:
        measure = measures[name].dropna()
        table = parameters.loc[measure.index]
        # Runs with the same text differ in their seeds alone.
        cell = table.astype(str).agg("\t".join, axis=1)
        for parameter in table:
            setting = table[parameter]
            effects.append(_measure_effect(str(parameter), measure, setting, cell, seeds))
    return effects


def _remove_seed_effects(
    measure: "pd.Series[float]", cell: "pd.Series[str]", seeds: "pd.Series[str]"
) -> "tuple[pd.Series[float], int]":
    """Return a measure without the mean effect of each seed, and the degrees of freedom.

    The model is measure = cell + seed, by least squares; the degrees of freedom are those of its
    residuals. Where the runs cannot distinguish cells from seeds, the measure stays unchanged. All
    have a row per run: cell and seeds are texts, equal for runs that differ in their seeds alone,
    and for runs with the same seeds.
    """
    cell_columns = pd.get_dummies(cell, dtype=float)
    seed_columns = pd.get_dummies(seeds.loc[measure.index], dtype=float).iloc[:, 1:]
    seed_columns -= seed_columns.mean()  # the mean over all runs stays
    design, cells = np.hstack([cell_columns, seed_columns]), cell_columns.shape[1]
    solution, _, rank, _ = np.linalg.lstsq(design, measure)
    is_determined = rank == design.shape[1] < len(measure)
    if not is_determined:
        return measure, len(measure) - cells
    return measure - seed_columns @ solution[cells:], len(measure) - int(rank)


def _measure_effect(
    parameter: str, raw: "pd.Series[float]", setting: "pd.Series[Any]", cell: "pd.Series[str]",
    seeds: "pd.Series[str]",
) -> Effect:  # fmt: skip
    """Return the effect of a parameter on a measure, tested against that of the seeds.

    raw, setting: measure and parameter in each run. cell, seeds: texts, equal for runs that differ
    in their seeds alone, and for runs with the same seeds.
    """
    # The means of the parameter's values, and the spread between seeds.
    measure, freedom = _remove_seed_effects(raw, cell, seeds)
    ranks, values = rank_values(setting)
    groups = measure.groupby(ranks)
    means, counts = groups.mean().to_numpy(float), groups.size().to_numpy(int)
    near_zero = _EQUAL * float(raw.abs().max())
    deviations = measure - measure.groupby(cell).transform("mean")
    spread = float(np.sqrt((deviations**2).sum() / freedom)) if freedom else np.nan
    good = good_direction(str(raw.name))
    top = int(np.argmin(means) if good == LOWER else np.argmax(means))  # the best value
    # The size, and which values are no worse than the best by more than the seeds explain.
    differences = np.abs(means - means[top])
    if np.ptp(means) <= near_zero:
        size, best = 0.0, np.ones(len(means), bool)
    elif not freedom or spread <= near_zero:  # no seeds to compare with, or they change nothing
        size, best = np.inf if freedom else np.nan, differences <= near_zero
    else:  # the test of Tukey and Kramer
        size = float(np.ptp(means)) / spread
        scale = spread * np.sqrt((1 / counts + 1 / counts[top]) / 2)
        best = (
            scipy.stats.studentized_range.sf(differences / scale, len(means), freedom)
            >= SIGNIFICANCE
        )
    effect = Effect(
        parameter=parameter, measure=str(raw.name), values=values, means=means, spread=spread,
        size=size, best=best, verdict="",
    )  # fmt: skip
    if float(np.ptp(raw)) <= near_zero:
        return effect._replace(verdict=SAME)
    number_count = len({value for value in setting if not is_category(value)})
    return effect._replace(verdict=_describe_effect(effect, good, number_count))


def _describe_effect(effect: Effect, good: str, number_count: int) -> str:
    """Return how a measure depends on a parameter: "best from 0.5 on", "rises from 1 to 3".

    good: HIGHER, LOWER, or "" if neither is better. number_count: the first so many values of the
    parameter are numbers, rising; the others are words.
    """
    if effect.best.all():
        return NO_EFFECT
    doubt = "" if np.isfinite(effect.spread) else "; one seed: it may be chance"
    if good:
        return f"best {_describe_values(effect.values, effect.best, number_count)}{doubt}"
    steps = np.sign(np.diff(effect.means))
    first, *_, last = (format_number(mean) for mean in effect.means)
    if number_count == len(steps) + 1 and (steps == steps[0]).all():
        return f"{'rises' if steps[0] > 0 else 'falls'} from {first} to {last}{doubt}"
    least, most = int(np.argmin(effect.means)), int(np.argmax(effect.means))
    low, high = format_number(effect.means[least]), format_number(effect.means[most])
    return f"least at {effect.values[least]} ({low}), most at {effect.values[most]} ({high}){doubt}"


def _describe_values(values: Sequence[str], chosen: Mask, number_count: int) -> str:
    """Describe the chosen values: "at 0.2", "between 0.2 and 0.5", "at 0.2, 1 and auto".

    chosen: a mask of the values, not all False. number_count: as in `_describe_effect`.
    """
    indices = np.flatnonzero(chosen)
    numbers = indices[indices < number_count]
    # Several numbers without a gap are a range.
    if len(numbers) > 1 and np.ptp(numbers) == len(numbers) - 1:
        words = [values[int(index)] for index in indices[len(numbers) :]]
        if len(numbers) == number_count:
            text = "at every number"
        elif numbers[0] == 0:
            text = f"up to {values[numbers[-1]]}"
        elif numbers[-1] == number_count - 1:
            text = f"from {values[numbers[0]]} on"
        else:
            text = f"between {values[numbers[0]]} and {values[numbers[-1]]}"
        return f"{text}, and at {' and '.join(words)}" if words else text
    *others, last = (values[int(index)] for index in indices)
    return f"at {', '.join(others)} and {last}" if others else f"at {last}"


def rank_importance(parameters: pd.DataFrame, measures: pd.DataFrame) -> pd.DataFrame:
    """Return how much each parameter matters for each measure, as shares 0 … 1 that add up to 1.

    A random forest predicts the measure; the share is how much worse it predicts if the parameter's
    values are permuted. parameters, measures: a row per run, with the same index. The result has a
    row per measure, a column per parameter, and no measure that nothing predicts.
    """
    from sklearn.ensemble import RandomForestRegressor  # not at the top: the import takes a second
    from sklearn.inspection import permutation_importance

    ranks = parameters.apply(lambda column: rank_values(column)[0])
    shares = dict[str, Floats]()
    for measure in measures.columns[measures.nunique() > 1]:
        column = measures[measure].dropna()
        inputs = ranks.loc[column.index].to_numpy(float)
        forest = RandomForestRegressor(_TREES, random_state=0).fit(inputs, column)
        loss = permutation_importance(
            forest, inputs, column, n_repeats=_PERMUTATIONS, random_state=0
        )
        importance = np.maximum(loss.importances_mean, 0)
        if importance.sum() > 0:
            shares[str(measure)] = importance / importance.sum()
    return pd.DataFrame.from_dict(shares, "index", columns=list(parameters))
