"""Picture of `distance`: both maps of the longest tracks (Fig. 9)."""

from pathlib import Path

from finloop.distance.map import (
    find_comparable_pairs,
    find_frame_kinds,
    full_distance_map,
    subtract_mean_picture,
)
from finloop.distance.settings import DistanceSettings
from finloop.io.picture import save_figure
from finloop.plots.distance import figure9, rows_of_longest_tracks
from finloop.project import Project
from stages.settings import load_settings


def main() -> None:
    """Draw how unlike all frames of the longest tracks are, and which are compared (Fig. 9)."""
    p: DistanceSettings = load_settings("distance")
    with Project() as project:
        facts, features = project.map_facts, project.features
        rows = rows_of_longest_tracks(features, p.picture_frames)
        pictures = project.film_reel.draw_rows(rows, facts.size, facts.frame_of_reference)
        distance = full_distance_map(subtract_mean_picture(pictures))
    features = features.iloc[rows]
    kinds = find_frame_kinds(features, facts.frame_of_reference)
    area = features["motion_area_rel"].to_numpy()
    compared = find_comparable_pairs(kinds, area, p.motion_area_threshold)
    figure = figure9(distance, compared, features["track_id"].to_numpy(), facts.step_median)
    save_figure(Path("reports/motion/distance/fig9.png"), figure)
