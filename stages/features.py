"""Stage `features`: make the feature table, the numbers of Fig. 7, and Table 1 from the tracks."""

from stages.run import report_findings, run, save_metrics  # isort: skip  (before numpy)

import sys
from pathlib import Path

from finloop.drawn.truth import TRUTH
from finloop.features.head import HeadCues
from finloop.features.metrics import (
    compare_heads_with_external,
    compare_with_truth,
    metrics_in_mm,
    orientation_table,
    rows_of_longest_track,
    summarize_features,
)
from finloop.features.settings import FeaturesSettings
from finloop.features.table import (
    FEATURES,
    USED,
    choose_turn_thresholds,
    infer_delta_frames,
    learn_head_cues,
    measure_features,
    track_slices,
)
from finloop.features.verdict import list_findings
from finloop.io.table import load_table, save_csv, save_table
from finloop.io.video import TRUTH_NAME
from finloop.project import Project
from stages.settings import load_settings

TABLE, REPORT = Path("data/features/features.parquet"), Path("reports/features")


def main() -> None:
    """Measure how each fish swims in each frame; write data/features/ and reports/features/.

    The reports are table1.csv (orientations), fig7.csv (bend and swimming type over time) and the
    metrics, which are also compared with a drawn film's truth and with given tracks, if any. What
    is doubtful in the film is printed and written to findings.csv.
    """
    settings: FeaturesSettings = load_settings("features")
    project = Project()
    facts, tracks, external_tracks = project.facts, project.tracks(USED), project.external_tracks
    rate_hz = facts.frame_rate_hz
    table, backbones = measure_features(tracks, rate_hz, settings, external_tracks)
    save_table(TABLE, table, FEATURES)

    delta = infer_delta_frames(table)
    heading, bend = (table[name].to_numpy(float) for name in ("heading_deg", "bend"))
    thresholds = choose_turn_thresholds(heading, bend, track_slices(table), delta, settings)
    cues = learn_head_cues(tracks, rate_hz, settings.head)
    current_bl_s = float(table["current"].iloc[0])
    _report_assumptions(settings, cues, current_bl_s)
    metrics = summarize_features(table) | {
        "head_is_blunt_end": int(cues.width > 0),
        "delta_s": delta / rate_hz,
        "turn_threshold_deg": thresholds.turn_deg,
        "bend_threshold_body_lengths_2": thresholds.bend,
        "current_body_lengths_s": current_bl_s,
    }
    if facts.mm_per_px is not None:
        tank = facts.width_px, facts.height_px
        metrics |= metrics_in_mm(table, tank, rate_hz, facts.mm_per_px)
    if (truth := project.data / "clip" / TRUTH_NAME).exists():
        metrics |= compare_with_truth(table, backbones, load_table(truth, TRUTH))
    if external_tracks is not None:
        metrics |= compare_heads_with_external(tracks, external_tracks, rate_hz)
    save_metrics(REPORT / "metrics.json", metrics)

    save_csv(REPORT / "table1.csv", orientation_table(table), decimals=3)
    fig7 = rows_of_longest_track(table)[["frame", "motion_area_rel", "swimming_type"]]
    save_csv(REPORT / "fig7.csv", fig7, decimals=4)
    report_findings(TABLE.parent, {"": list_findings(metrics)})


def _report_assumptions(settings: FeaturesSettings, cues: HeadCues, current_bl_s: float) -> None:
    """Print a note if the head is taken to be the thin end, or a current is assumed.

    Nothing is said of what the user has set. cues: by what the head is found.
    """
    if cues.width < 0 and settings.head == "auto":  # −1: the head is the thin end
        print(
            "features: in this film animals move with the thin end first: it is taken for the head "
            "(features.head=blunt: not)",
            file=sys.stderr,
        )
    if current_bl_s and settings.water_current_bl_s == "auto":
        print(
            "features: the animal beats its tail but stays in its place; it is assumed to swim "
            f"{current_bl_s:.2g} body lengths/s against a current "
            "(features.water_current_bl_s; 0 = none)",
            file=sys.stderr,
        )


if __name__ == "__main__":
    run(main)
