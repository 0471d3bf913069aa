"""Compare experiments on one self-contained page: what differs, and which are best."""

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots

from finloop.report.page import render_template
from finloop.report.tables import Table, format_number


class ReportMetric(NamedTuple):
    """A metric by which experiments are compared: its key, its name on the page, its direction.

    key: `<stage>.<number>`, a number of reports/<stage>/. more: whether a greater value is better.
    """

    key: str
    words: str
    more: bool


OBJECTIVES = (
    ReportMetric("animate.hybrid_seam_ratio_median", "seam ratio", more=False),
    ReportMetric("animate.hybrid_trials_goals_reached_pct", "goals reached (%)", more=True),
    ReportMetric("animate.hybrid_longest_exact_repeat_s", "longest exact repeat (s)", more=False),
)
"""Smooth, steerable, varied: a long exact repeat means little variety."""
_PANELS = 3  # per row
_INK, _BEST, _OTHER = "#16232b", "#0b7285", "#9aa8af"
_LAYOUT: dict[str, Any] = {
    "paper_bgcolor": "white",
    "plot_bgcolor": "white",
    "font": {"family": "system-ui, sans-serif", "size": 13, "color": _INK},
    "margin": {"l": 80, "r": 60, "t": 60, "b": 60},
}
_AXIS: dict[str, Any] = {"gridcolor": "#e3e9ec", "zeroline": False, "linecolor": "#9aa8af"}


@dataclass(frozen=True)
class Comparison:
    """Experiments that are compared: two tables with one row each, and which of them are best.

    parameters: only those that differ. measures: their numbers. objectives: those OBJECTIVES that
    some experiment has. best (rows,): True on the Pareto front.
    """

    parameters: pd.DataFrame
    measures: pd.DataFrame
    objectives: Sequence[ReportMetric]
    best: NDArray[np.bool_]


def pareto_front(costs: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which rows of costs (n, k) are on the Pareto front, (n,); less cost is better.

    A row is dominated if another row is nowhere greater and somewhere less. Equal rows do not
    dominate each other. A row with NaN is never on the front.
    """
    complete = np.logical_not(np.isnan(costs).any(axis=1))
    a, b = costs[:, None], costs[None, :]  # (n, 1, k), (1, n, k)
    beats = (b <= a).all(axis=2) & (b < a).any(axis=2) & complete
    return np.asarray(complete & ~beats.any(axis=1))


def compare_experiments(
    parameters: pd.DataFrame, numbers: pd.DataFrame, measures: Sequence[str]
) -> Comparison:
    """Compare experiments: their differing parameters, their measures, and the Pareto front.

    parameters, numbers: one row per experiment, named by the index, and columns `<stage>.<name>`.
    measures: further columns of `numbers` to show. Rows are sorted by the differing parameters.
    """
    differ = [name for name in parameters if parameters[name].astype(str).nunique() > 1]
    available = numbers.columns[numbers.notna().any()]
    objectives = [objective for objective in OBJECTIVES if objective.key in available]
    keys = [objective.key for objective in objectives]
    columns = dict.fromkeys([*keys, *(name for name in measures if name in numbers)])
    values = numbers.reindex(columns=list(columns)).astype(float)
    sign = np.array([-1.0 if objective.more else 1.0 for objective in objectives])
    best = pareto_front(values[keys].to_numpy() * sign) & bool(objectives)

    def column_ranks(column: "pd.Series[Any]") -> "pd.Series[int]":
        return _rank_values(column)[0]

    rows = parameters[differ].sort_values(differ, kind="stable", key=column_ranks)
    order = parameters.index.get_indexer(rows.index)
    return Comparison(rows, values.iloc[order], objectives, best[order])


def _rank_values(column: "pd.Series[Any]") -> "tuple[pd.Series[int], list[str]]":
    """Return the rank of each value from 0, numbers before words, and the text of each rank."""
    keys = [
        (1, 0.0, str(value)) if _is_word(value) else (0, float(value), f"{value:g}")
        for value in column
    ]
    order = sorted(set(keys))
    return pd.Series([order.index(key) for key in keys], column.index), [key[-1] for key in order]


def _is_word(value: object) -> bool:
    """Return whether a value has no place on an axis of numbers: text, a truth value or NaN."""
    return not isinstance(value, Real) or isinstance(value, bool) or value != value


def _metric_label(key: str) -> str:
    """Return the page's name of a metric or parameter from its key `<stage>.<name>`."""
    names = {objective.key: objective.words for objective in OBJECTIVES}
    return names.get(key, key.partition(".")[2].replace("_", " "))


def draw_parallel_axes(comparison: Comparison) -> go.Figure:
    """Draw one line per experiment across axes of parameters and measures; the best in colour.

    An experiment that lacks a measure is left out: its line would leave the chart at that axis.
    """
    measures = comparison.measures.dropna(axis=1, how="all")
    whole = measures.notna().all(axis=1)
    axes = []
    for name, column in [*comparison.parameters[whole].items(), *measures[whole].items()]:
        axis: dict[str, Any] = {"label": _metric_label(str(name))}
        if any(map(_is_word, column)):  # a tick for each value
            column, texts = _rank_values(column)
            axis |= {"tickvals": list(range(len(texts))), "ticktext": texts}
        low, high = float(column.min()), float(column.max())
        if low == high:  # an axis of no length is not drawn
            axis["range"] = [low - 0.5, high + 0.5]
        axes.append(axis | {"values": column.astype(float).tolist()})
    best = comparison.best[whole.to_numpy()].astype(int).tolist()
    line = {"color": best, "colorscale": [[0, _OTHER], [1, _BEST]], "cmin": 0, "cmax": 1}
    figure = go.Figure(go.Parcoords(dimensions=axes, line=line, labelside="top", labelangle=-12))
    margin = {"l": 80, "r": 80, "t": 110, "b": 40}
    return figure.update_layout(**_LAYOUT | {"height": 430, "margin": margin})


def draw_parameter_effects(comparison: Comparison) -> go.Figure | None:
    """Draw each measure against the one parameter that differs; None if not exactly one does."""
    if len(comparison.parameters.columns) != 1:
        return None
    (parameter,) = comparison.parameters.columns
    place, texts = _rank_values(comparison.parameters[parameter])
    measures = comparison.measures.dropna(axis=1, how="all")
    rows = -(-len(measures.columns) // _PANELS)
    titles = [str(name).replace(".", ": ").replace("_", " ") for name in measures]
    figure = make_subplots(rows, _PANELS, subplot_titles=titles, vertical_spacing=0.35 / rows)
    for panel, (_, values) in enumerate(measures.items()):
        figure.add_scatter(
            x=place.tolist(), y=values.tolist(), mode="lines+markers", line={"color": _BEST},
            row=panel // _PANELS + 1, col=panel % _PANELS + 1, showlegend=False,
            hovertemplate="%{y}<extra></extra>",
        )  # fmt: skip
    figure.update_xaxes(tickvals=list(range(len(texts))), ticktext=texts, **_AXIS)
    figure.update_xaxes(title=_metric_label(str(parameter)), row=rows)
    figure.update_yaxes(**_AXIS)
    figure.update_annotations(font_size=12)
    return figure.update_layout(**_LAYOUT, height=80 + 230 * rows)


def _draw_scatter(comparison: Comparison, x: ReportMetric, y: ReportMetric) -> go.Figure:
    """Draw objective `y` against objective `x`, a point per experiment; the best are marked."""
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
    side, height = "right" if x.more else "left", "high" if y.more else "low"
    figure.update_xaxes(title=f"{x.words} ({side} is better)", **_AXIS)
    figure.update_yaxes(title=f"{y.words} ({height} is better)", **_AXIS)
    legend = {"orientation": "h", "y": 1.02, "yanchor": "bottom"}
    return figure.update_layout(**_LAYOUT, height=430, legend=legend)


def _comparison_table(comparison: Comparison) -> Table:
    """Return the comparison as a table of texts: a row per experiment, the best marked."""
    columns = [
        "experiment",
        *comparison.parameters,
        *map(_metric_label, comparison.measures),
        "best",
    ]
    rows = [
        [
            str(name),
            *map(str, comparison.parameters.loc[name]),
            *(format_number(value, 4) for value in comparison.measures.loc[name]),
            "best" if best else "",
        ]
        for name, best in zip(comparison.parameters.index, comparison.best, strict=True)
    ]
    return Table("Experiments; the best are on the Pareto front", columns, rows)


def comparison_page(comparison: Comparison, title: str, why: str) -> str:
    """Return the comparison as an HTML page, with its charts and the program that draws them.

    title: heading of the page. why: the text below it.
    """
    charts = {
        "Effect of the parameter, one panel per measure": draw_parameter_effects(comparison),
        "Parameters and measures, one line per complete experiment": draw_parallel_axes(comparison),
    }
    for x in comparison.objectives[:1]:
        for y in comparison.objectives[1:]:
            charts[f"{y.words.capitalize()} against {x.words}"] = _draw_scatter(comparison, x, y)
    values = {
        "title": title, "why": why, "table": _comparison_table(comparison),
        "charts": [(name, figure.to_json()) for name, figure in charts.items() if figure],
        "plotly": get_plotlyjs(),
    }  # fmt: skip
    return render_template("compare.html.j2", values)
