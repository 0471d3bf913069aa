"""Compare experiments on one self-contained page: what differs, and which are best."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from finloop.report.effects import (
    NO_EFFECT,
    SAME,
    SIGNIFICANCE,
    Effect,
    is_category,
    measure_effects,
    rank_importance,
    rank_values,
)
from finloop.report.page import data_uri, render_template
from finloop.report.tables import Table, format_number


class ReportMetric(NamedTuple):
    """A metric by which experiments are compared: its key, its name on the page, its direction.

    key: `<stage>.<number>`, a number of reports/<stage>/. rises: whether a greater value is better.
    """

    key: str
    words: str
    rises: bool


OBJECTIVES = (
    ReportMetric("animate.hybrid_seam_ratio_median", "seam ratio", rises=False),
    ReportMetric("animate.hybrid_trials_goals_reached_pct", "goals reached (%)", rises=True),
    ReportMetric("animate.hybrid_longest_exact_repeat_s", "longest exact repeat (s)", rises=False),
)
"""Smooth, steerable, varied: a long exact repeat means little variety."""
_PANELS, _TITLE_LETTERS = 3, 46  # panels per row, letters in a line above one
_AXIS_LETTERS = 26  # in a line below an axis of the parallel coordinates
_INK, _BEST, _OTHER = "#16232b", "#0b7285", "#9aa8af"
_BARS = [_BEST, "#e69f00", "#56b4e9", "#cc79a7", "#009e73", "#d55e00"]
_LAYOUT: dict[str, Any] = {
    "paper_bgcolor": "white",
    "plot_bgcolor": "white",
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": _INK},
    "margin": {"l": 80, "r": 60, "t": 60, "b": 60},
}
_AXIS: dict[str, Any] = {"gridcolor": "#e3e9ec", "zeroline": False, "linecolor": "#9aa8af"}


@dataclass(frozen=True)
class Comparison:
    """Compared experiments: their parameters, measures and spreads, and which are best.

    Runs that differ in their seeds alone are one experiment. parameters: those that differ between
    experiments. measures: numbers of the experiments, means over seeds. spreads: their standard
    deviations over seeds, NaN for a single run. objectives: those OBJECTIVES that some experiment
    has. best (rows,): True on the Pareto front. effects: of every parameter on every measure.
    first_runs (rows,): name of the first run of each experiment. run_parameters, run_measures: the
    same tables with a row per run. run_seeds: of each run a text, equal for equal seeds.
    """

    parameters: pd.DataFrame
    measures: pd.DataFrame
    spreads: pd.DataFrame
    objectives: Sequence[ReportMetric]
    best: NDArray[np.bool_]
    effects: Sequence[Effect]
    first_runs: Sequence[str]
    run_parameters: pd.DataFrame
    run_measures: pd.DataFrame
    run_seeds: "pd.Series[str]"


class Preview(NamedTuple):
    """What the animation of an experiment looks like: WebP of its route, MP4 of some seconds."""

    picture: bytes
    film: bytes


def pareto_front(costs: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return a mask (n,) of the rows of costs (n, k) on the Pareto front; lower is better.

    A row is dominated if another row is nowhere greater and somewhere less. Equal rows do not
    dominate each other. A row with NaN is never on the front.
    """
    complete = np.logical_not(np.isnan(costs).any(axis=1))
    row, other = costs[:, None], costs[None, :]  # (n, 1, k), (1, n, k)
    is_dominated = (other <= row).all(axis=2) & (other < row).any(axis=2) & complete
    return np.asarray(complete & ~is_dominated.any(axis=1))


def compare_experiments(
    parameters: pd.DataFrame, numbers: pd.DataFrame, measures: Sequence[str]
) -> Comparison:
    """Compare experiments: parameters that differ, measures, and the Pareto front.

    parameters, numbers: one row per run, named by the index, and columns `<stage>.<name>`.
    measures: columns of `numbers` to show beside OBJECTIVES. Runs that differ in their seeds alone
    become one experiment. Rows are sorted by the differing parameters.
    """
    runs = _differing_parameters(parameters)
    repeats = parameters.loc[runs.index].astype(str).duplicated()  # equal in all, also in seeds
    # A seed among the compared parameters is no seed of a repetition.
    seeds = _join_seeds(parameters.loc[runs.index].drop(columns=runs.columns))
    # The measures of all runs: the objectives first.
    available = numbers.columns[numbers.notna().any()]
    objectives = [objective for objective in OBJECTIVES if objective.key in available]
    keys = [objective.key for objective in objectives]
    columns = dict.fromkeys([*keys, *(name for name in measures if name in numbers)])
    values = numbers.reindex(index=runs.index, columns=list(columns)).astype(float)
    # Experiments: means and spreads over the runs that differ in their seeds alone.
    names = _experiment_names(runs, repeats)
    means = values.groupby(names, sort=False).mean()
    spreads = values.groupby(names, sort=False).std()
    rows, effects = runs, []
    if len(runs.columns):
        rows = runs.groupby(names, sort=False).first()
        effects = measure_effects(runs[~repeats], values[~repeats], seeds[~repeats])
    cost_sign = np.array([-1.0 if objective.rises else 1.0 for objective in objectives])
    best = pareto_front(means[keys].to_numpy() * cost_sign) & bool(objectives)  # else none is best
    first_runs = names.index[~names.duplicated()].astype(str).tolist()
    return Comparison(
        parameters=rows, measures=means, spreads=spreads, objectives=objectives, best=best,
        effects=effects, first_runs=first_runs, run_parameters=runs, run_measures=values,
        run_seeds=seeds,
    )  # fmt: skip


def _differing_parameters(parameters: pd.DataFrame) -> pd.DataFrame:
    """Return a table of the parameters that differ between runs, a row per run, sorted by them.

    Seeds are left out, as runs are averaged over them, unless nothing else differs.
    """
    differing = [name for name in parameters if parameters[name].astype(str).nunique() > 1]
    differing = [name for name in differing if not _is_seed(name)] or differing
    runs = parameters[differing]
    if not differing:
        return runs
    return runs.sort_values(differing, kind="stable", key=lambda column: rank_values(column)[0])


def _join_seeds(parameters: pd.DataFrame) -> "pd.Series[str]":
    """Return the seeds of each run joined in a text, equal for runs with the same seeds."""
    seed_rows = parameters[[name for name in parameters if _is_seed(name)]].astype(str).to_numpy()
    return pd.Series([" ".join(row) for row in seed_rows], parameters.index)


def _is_seed(name: object) -> bool:
    """Return whether a parameter, by its dotted name, is a seed of random numbers."""
    return str(name).endswith(".seed")


def _experiment_names(runs: pd.DataFrame, repeats: "pd.Series[bool]") -> "pd.Series[str]":
    """Return the name of each run's experiment; runs that differ in their seeds alone are one.

    The name is that of the experiment's first run, without the ending "-seed…" if the experiment
    has several runs. runs: parameters without seeds, a row per run. repeats: which runs equal an
    earlier run in all parameters, also in seeds; each of these is an experiment of its own.
    """
    run_names = pd.Series(runs.index.astype(str), runs.index)
    if runs.columns.empty:
        return run_names
    # Runs with the same text are one experiment.
    experiment = runs.astype(str).agg("\t".join, axis=1).mask(repeats, run_names)
    first_run = run_names.groupby(experiment).transform("first")
    run_count = experiment.groupby(experiment).transform("size")
    return first_run.where(run_count == 1, first_run.str.replace(r"-seed\d+$", "", regex=True))


def _metric_label(key: str) -> str:
    """Return the label on the page of a metric or parameter with the key `<stage>.<name>`."""
    names = {objective.key: objective.words for objective in OBJECTIVES}
    return names.get(key, key.partition(".")[2].replace("_", " "))


def _measure_name(key: str) -> str:
    """Return a readable name of a measure `<stage>.<name>`; the stage `animate` is left out."""
    return key.removeprefix("animate.").replace(".", ": ").replace("_", " ")


def draw_parallel_axes(comparison: Comparison) -> go.Figure:
    """Return a chart with a line per experiment across axes of parameters and measures.

    The best experiments are in colour. An experiment that lacks a measure is left out: its line
    would leave the chart at that axis.
    """
    measures = comparison.measures.dropna(axis=1, how="all")
    complete = measures.notna().all(axis=1)
    axes = []
    for name, column in [*comparison.parameters[complete].items(), *measures[complete].items()]:
        label = "<br>".join(wrap(_metric_label(str(name)), _AXIS_LETTERS))
        axis: dict[str, Any] = {"label": label, "tickformat": ".4~g"}
        if any(map(is_category, column)):  # a tick for each value
            column, texts = rank_values(column)
            axis |= {"tickvals": list(range(len(texts))), "ticktext": texts}
        low, high = float(column.min()), float(column.max())
        if low == high:  # an axis of no length is not drawn
            axis["range"] = [low - 0.5, high + 0.5]
        axes.append(axis | {"values": column.astype(float).tolist()})
    best = comparison.best[complete.to_numpy()].astype(int).tolist()
    line = {"color": best, "colorscale": [[0, _OTHER], [1, _BEST]], "cmin": 0, "cmax": 1}
    figure = go.Figure(go.Parcoords(dimensions=axes, line=line, labelside="bottom", labelangle=45))
    names = list(map(str, measures.index[complete]))
    figure.update_layout(meta=names)  # for the page's filter
    margin = {"l": 80, "r": 150, "t": 40, "b": 170}
    return figure.update_layout(**_LAYOUT | {"height": 440, "margin": margin})


def draw_parameter_effects(comparison: Comparison, parameter: str) -> go.Figure:
    """Return charts of each measure against a parameter: runs as points, means as a line.

    A thin line joins the runs with the same seeds. The bars show the spread over the seeds, one
    standard deviation to each side. Measures that are the same in every run are left out.
    """
    effects = [
        effect
        for effect in comparison.effects
        if effect.parameter == parameter and effect.verdict != SAME
    ]
    rows = -(-len(effects) // _PANELS)  # rounded up
    titles = [_effect_title(effect) for effect in effects]
    figure = make_subplots(rows, _PANELS, subplot_titles=titles, vertical_spacing=0.4 / rows)
    places, texts = rank_values(comparison.run_parameters[parameter])
    for panel, effect in enumerate(effects):
        cell = {"row": panel // _PANELS + 1, "col": panel % _PANELS + 1}
        values = comparison.run_measures[effect.measure]
        if len(values) > len(effect.means):
            _add_seed_lines(figure, cell, places, values, comparison.run_seeds)
        bars = None if np.isnan(effect.spread) else [effect.spread] * len(effect.means)
        places_with_mean = sorted({places[run] for run in values.dropna().index})
        figure.add_scatter(
            x=places_with_mean, y=effect.means.tolist(), mode="lines+markers",
            line={"color": _BEST},
            error_y={"type": "data", "array": bars, "visible": bars is not None, "width": 3},
            showlegend=False, hovertemplate="%{y}<extra></extra>", **cell,
        )  # fmt: skip
    figure.update_xaxes(tickvals=list(range(len(texts))), ticktext=texts, **_AXIS)
    figure.update_xaxes(title=_metric_label(parameter), row=rows)
    figure.update_yaxes(**_AXIS)
    figure.update_annotations(font_size=12)
    layout = _LAYOUT | {"margin": _LAYOUT["margin"] | {"t": 80}}
    return figure.update_layout(**layout, height=100 + 250 * rows)


def _effect_title(effect: Effect) -> str:
    """Return the title of an effect's panel as HTML: the measure in bold, then the verdict."""
    name_lines = wrap(_measure_name(effect.measure), _TITLE_LETTERS)
    verdict_lines = wrap(effect.verdict, _TITLE_LETTERS)
    return "<br>".join([*(f"<b>{line}</b>" for line in name_lines), *verdict_lines])


def _add_seed_lines(
    figure: go.Figure, cell: dict[str, int], places: "pd.Series[int]",
    values: "pd.Series[float]", seeds: "pd.Series[str]",
) -> None:  # fmt: skip
    """Add a point for each run to a panel, and a thin line through the runs with the same seeds.

    cell: row and col of the panel. places, values: of the runs, x and y. seeds: equal for runs with
    the same seeds.
    """
    points: list[tuple[float, float, str]] = []
    for _, seed_values in values.groupby(seeds):
        runs = seed_values.index.astype(str)
        points += zip(places[seed_values.index], seed_values, runs, strict=True)
        points.append((np.nan, np.nan, ""))  # a gap before the next seed
    xs, ys, names = zip(*points, strict=True)
    figure.add_scatter(
        x=xs, y=ys, text=names, mode="lines+markers", line={"color": _OTHER, "width": 0.5},
        marker={"color": _OTHER, "size": 5}, showlegend=False,
        hovertemplate="%{text}<br>%{y}<extra></extra>", **cell,
    )  # fmt: skip


def _draw_scatter(comparison: Comparison, x: ReportMetric, y: ReportMetric) -> go.Figure:
    """Return a chart of objective `y` against objective `x`, a point per experiment."""
    figure = go.Figure()
    for mask, name, colour, symbol in (
        (~comparison.best, "others", _OTHER, "circle"),
        (comparison.best, "best: on the Pareto front", _BEST, "diamond"),
    ):
        if not mask.any():
            continue
        rows, names = comparison.measures[mask], comparison.measures.index[mask]
        figure.add_scatter(
            x=rows[x.key].tolist(), y=rows[y.key].tolist(), text=list(map(str, names)),
            mode="markers", name=name,
            hovertemplate=f"%{{text}}<br>{x.words} %{{x:.3f}}<br>{y.words} %{{y:.3f}}"
            "<extra></extra>",
            marker={"size": 12, "color": colour, "symbol": symbol, "opacity": 0.85},
        )  # fmt: skip
    side, height = "right" if x.rises else "left", "high" if y.rises else "low"
    figure.update_xaxes(title=f"{x.words} ({side} is better)", **_AXIS)
    figure.update_yaxes(title=f"{y.words} ({height} is better)", **_AXIS)
    legend = {"orientation": "h", "y": 1.02, "yanchor": "bottom"}
    return figure.update_layout(**_LAYOUT, height=430, legend=legend)


def _draw_importance(comparison: Comparison) -> go.Figure | None:
    """Return a chart of how much each parameter matters for each measure: stacked bars, per cent.

    A measure that no parameter changes beyond the seeds is left out: its bar would show chance
    alone. None if fewer than two parameters differ, or no measure is left.
    """
    if len(comparison.parameters.columns) < 2:
        return None
    changed = {
        effect.measure for effect in comparison.effects if effect.verdict not in (SAME, NO_EFFECT)
    }
    measures = comparison.run_measures.filter(sorted(changed))
    shares = rank_importance(comparison.run_parameters, measures)[::-1]
    if shares.empty:
        return None
    figure = go.Figure()
    for parameter, column in (100 * shares).items():
        figure.add_bar(
            x=column.tolist(), y=list(map(_measure_name, shares.index)), orientation="h",
            name=_metric_label(str(parameter)), hovertemplate="%{x:.0f} %",
        )  # fmt: skip
    figure.update_xaxes(title="share of what the parameters predict (%)", range=[0, 100], **_AXIS)
    figure.update_yaxes(automargin=True)
    legend = {"orientation": "h", "y": 1.02, "yanchor": "bottom", "traceorder": "normal"}
    height = 130 + 28 * len(shares)
    layout = _LAYOUT | {"colorway": _BARS}
    return figure.update_layout(**layout, barmode="stack", height=height, legend=legend)


class _ExperimentRow(NamedTuple):
    """An experiment in the page's table: its name, the texts of its cells, whether it is best.

    commit: short name of its commit. values: of the cells, by which the page sorts, "" for none.
    """

    name: str
    commit: str
    texts: Sequence[str]
    values: Sequence[Any]
    best: bool


def _experiment_rows(comparison: Comparison, commits: Mapping[str, str]) -> list[_ExperimentRow]:
    """Return a table row for each experiment: its parameters, then its measures with spreads.

    commits: run → its commit. A row shows 8 digits of its first run's commit, "" if unknown.
    """
    rows = []
    for number, name in enumerate(comparison.parameters.index):
        parameters = comparison.parameters.iloc[number].tolist()
        means = comparison.measures.iloc[number].tolist()
        spreads = comparison.spreads.iloc[number]
        texts = [
            format_number(mean, 4) + ("" if np.isnan(spread) else f" ± {spread:.2g}")
            for mean, spread in zip(means, spreads, strict=True)
        ]
        # NaN, which is not itself, becomes an empty cell.
        values = ["" if value != value else value for value in (*parameters, *means)]
        commit = commits.get(comparison.first_runs[number], "")[:8]
        best = bool(comparison.best[number])
        rows.append(
            _ExperimentRow(str(name), commit, [*map(str, parameters), *texts], values, best)
        )
    return rows


def _effects_table(effects: Sequence[Effect]) -> Table:
    """Return a table of effects in words: a row per measure and parameter, with the verdict.

    Measures that are the same in every run are left out.
    """
    rows = [
        [
            _measure_name(effect.measure),
            _metric_label(effect.parameter),
            effect.verdict,
            *(format_number(mean, 4) for mean in (effect.means.min(), effect.means.max())),
            "" if np.isnan(effect.spread) else f"{effect.spread:.2g}",
            "∞" if np.isinf(effect.size) else format_number(effect.size, 2),
        ]
        for effect in effects
        if effect.verdict != SAME
    ]
    columns = ["measure", "parameter", "verdict", "least mean", "greatest mean",
               "spread over seeds", "effect, in spreads"]  # fmt: skip
    return Table("Effects", columns, rows)


def comparison_page(
    comparison: Comparison, title: str, texts: Sequence[str],
    commits: Mapping[str, str] | None = None, previews: Mapping[str, Preview] | None = None,
) -> str:  # fmt: skip
    """Return the comparison as an HTML page, with its charts and the program that draws them.

    title: heading of the page. texts: the paragraphs below it. commits: run → its commit. previews:
    run → what its animation looks like, for the first run of each experiment.
    """
    varying = [effect for effect in comparison.effects if effect.verdict != SAME]
    charts: dict[str, go.Figure | None] = {
        f"Effect of {_metric_label(name)}": draw_parameter_effects(comparison, name)
        for name in dict.fromkeys(effect.parameter for effect in varying)
    }
    charts["Which parameter matters"] = _draw_importance(comparison)
    # The first objective against each of the others.
    fronts = {
        f"{y.words.capitalize()} against {x.words}": _draw_scatter(comparison, x, y)
        for x in comparison.objectives[:1]
        for y in comparison.objectives[1:]
    }
    same = dict.fromkeys(effect.measure for effect in comparison.effects if effect.verdict == SAME)
    same_everywhere = [name for name in same if name not in {effect.measure for effect in varying}]
    values = {
        "title": title, "texts": list(filter(None, texts)), "chance": f"{SIGNIFICANCE:.0%}",
        "seeds": bool(comparison.spreads.notna().any(axis=None)), "no_effect": NO_EFFECT,
        "effects": _effects_table(comparison.effects),
        "same": list(map(_measure_name, same_everywhere)),
        "parameters": list(map(str, comparison.parameters)),
        "measures": list(map(_metric_label, comparison.measures)),
        "rows": _experiment_rows(comparison, commits or {}),
        "previews": _preview_uris(comparison, previews or {}),
        "charts": [(name, figure.to_json()) for name, figure in charts.items() if figure],
        "fronts": [(name, figure.to_json()) for name, figure in fronts.items()],
        "axes": draw_parallel_axes(comparison).to_json(), "plotly": get_plotlyjs(),
    }  # fmt: skip
    return render_template("compare.html.j2", values)


def _preview_uris(
    comparison: Comparison, previews: Mapping[str, Preview]
) -> dict[str, tuple[str, str]]:
    """Return data URIs of each experiment's picture and film, those of its first run.

    Experiments without a preview are left out.
    """
    uris = {}
    for name, run in zip(comparison.parameters.index, comparison.first_runs, strict=True):
        if run in previews:
            picture = data_uri("image/webp", previews[run].picture)
            uris[str(name)] = picture, data_uri("video/mp4", previews[run].film)
    return uris
