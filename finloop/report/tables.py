"""Tables of the page: measures with their names and units, and shortened numbers."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import pandas as pd

from finloop.edit.modes import MODES as ALL_MODES
from finloop.report.headlines import HEADLINES

MODES = {**{name: facts.title for name, facts in ALL_MODES.items()}, "film": "Film"}


class Measure(NamedTuple):
    """A measure that the report shows: its row in data/animate/beside/measures.csv, and its texts.

    words: the name on the page. unit: "" for a plain number. target: the good values, "" for none.
    """

    key: str
    words: str
    unit: str
    target: str = ""


MEASURES = (
    Measure("goals_reached_pct", "goals reached", "%", "100"),
    Measure("time_to_goal_median_s", "time from goal to goal, median", "s"),
    Measure("path_error_rms_body_lengths", "off the straight way, RMS", "body lengths"),
    Measure("path_across_rms_body_lengths", "beside the path, RMS", "body lengths", "≤ 0.1"),
    Measure(
        "path_late_rms_body_lengths", "from the requested place, RMS", "body lengths", "≤ 0.25"
    ),
    Measure("path_left_pct", "time for which the path was left", "%", "0"),
    Measure("path_turn_corrected_pct", "corrections, of the film's turns", "%"),
    Measure("path_way_corrected_pct", "corrections, of the way", "%"),
    Measure("straightness", "straightness of the way", "", "1 = straight"),
    Measure("frames_outside", "frames with any part outside the tank", "", "0"),
    Measure("shown_film_pct", "shown: film as filmed", "%"),
    Measure("shown_other_pose_pct", "shown: film bent into another pose", "%"),
    Measure("shown_mirror_image_pct", "shown: mirror image of film, bent or not", "%"),
    Measure("shown_sprite_pct", "shown: sprites", "%"),
    Measure("shown_prediction_pct", "shown: film in a predicted pose", "%"),
    Measure("stuck_pct", "time on the spot", "%"),
    Measure("switches", "switches between sprites and film", ""),
    Measure("switches_without_gateway", "of these, without a gateway", "", "0"),
    Measure("step_ratio_median", "step between drawn pictures, median", "× film", "≤ 1.5"),
    Measure("seam_ratio_median", "seam ratio, median: 1 = as smooth as the film", "", "≤ 1.5"),
    Measure("seam_ratio_p95", "seam ratio, 95th percentile", ""),
    Measure("jumps_above_film_p95_pct", "jumps above the film's 95th percentile", "%", "≤ 10"),
    Measure("speed_kinematic_distance_sd", "speed: distance to the film", "SD", "≤ 0.5"),
    Measure("turn_rate_kinematic_distance_sd", "turn rate: distance to the film", "SD", "≤ 0.5"),
    Measure("longest_exact_repeat_s", "longest exact repeat", "s"),
    Measure("longest_still_s", "longest time with one picture", "s"),
    Measure("trials_goals_reached_pct", "random goals: reached", "%", "≥ 95"),
    Measure("trials_time_to_goal_median_s", "random goals: time from goal to goal", "s"),
    Measure("trials_film_pct", "random goals: share of time that film is played", "%"),
    Measure("trials_arrival_heading_error_deg", "random goals: heading off the straight way", "°"),
    Measure(
        "trials_turn_area_missed_median", "random goals: turns miss the network's ideal area", ""
    ),
    Measure("trials_frames_outside", "random goals: frames outside the tank", "", "0"),
)


class Table(NamedTuple):
    """A table of texts: caption, column names, and rows with one cell per column.

    The first cell of a row is its heading.
    """

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def format_number(value: Any, digits: int = 3) -> str:
    """Return a number as a short text of about `digits` digits, with commas between thousands.

    A whole number keeps all digits, and one below 0.001 gets an exponent. NaN and None give ""; a
    text is returned unchanged.
    """
    if isinstance(value, str):
        return value
    if pd.isna(value):
        return ""
    if float(value).is_integer() and abs(value) < 1e15:
        return f"{int(value):,}"
    if 0 < abs(value) < 1e-3:
        return f"{value:.{digits - 1}e}"
    decimals = max(0, digits - len(str(int(abs(value)))))
    return f"{value:,.{decimals}f}"


def measures_table(measures: pd.DataFrame) -> Table:
    """Return the table "Animation beside film": a row per measure, a column per mode and film.

    measures: content of `data/animate/beside/measures.csv`.
    """
    measures = measures.set_index("measure")
    for key in ("speed", "turn_rate"):  # in the film's column stands the distance of its halves
        halves, distance = f"{key}_halves_kinematic_distance_sd", f"{key}_kinematic_distance_sd"
        if halves in measures.index and distance in measures.index:
            measures.loc[distance, "film"] = measures.loc[halves, "film"]
    modes = [name for name in MODES if name in measures]
    rows = []
    for key, words, unit, target in MEASURES:
        if key in measures.index:
            values = [format_number(measures.at[key, mode]) for mode in modes]
            rows.append([f"{words} ({unit})" if unit else words, *values, target])
    columns = ["measure", *(MODES[mode] for mode in modes), "target"]
    return Table("Animation beside film", columns, rows)


def table_of_data_frame(frame: pd.DataFrame, caption: str, digits: int = 4) -> Table:
    """Convert a data frame to a table of texts; numbers get about `digits` digits."""
    rows = [[format_number(cell, digits) for cell in row] for row in frame.itertuples(index=False)]
    return Table(caption, [str(name).replace("_", " ") for name in frame.columns], rows)


def headline_table(numbers: Mapping[str, float], stage: str) -> Table:
    """Return a stage's headline numbers as a table: name, value, meaning, good direction.

    Headlines without a value are left out.
    """
    rows = []
    for name, meaning, good in HEADLINES[stage]:
        if name in numbers:
            rows.append([name.replace("_", " "), format_number(numbers[name], 4), meaning, good])
    return Table(stage, ["number", "value", "meaning", "good"], rows)


def mode_headline_numbers(numbers: Mapping[str, float], mode: str) -> list[tuple[str, str]]:
    """Return the first few numbers that the report shows for a mode, as pairs (value, text).

    numbers: those of the stages `animate` and `realism`, by `<mode>_<name>`.
    """
    shown_first = (
        ("goals_reached_pct", " %", "of its goals reached"),
        ("seam_ratio_median", "", "natural steps: discontinuity of a transition, median"),
        ("film_pct", " %", "of its time it plays film"),
        ("frames_outside", "", "frames outside the tank"),
        ("auc", "", "AUC: told by its motion"),
        ("picture_auc", "", "AUC: told by its picture"),
    )
    yardsticks = {  # an AUC says something only beside that of the film's halves
        key: f" (0.5: not at all; the film's halves {format_number(numbers[f'halves_{key}'])})"
        for key in ("auc", "picture_auc")
        if f"halves_{key}" in numbers
    }
    return [
        (format_number(numbers[f"{mode}_{key}"]) + unit, words + yardsticks.get(key, ""))
        for key, unit, words in shown_first
        if f"{mode}_{key}" in numbers
    ]
