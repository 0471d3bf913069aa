"""Metrics of the loops of a film, for metrics.json."""

import numpy as np
import pandas as pd

from finloop.distance.map import Ints, MapFacts
from finloop.loops.graph import LoopGraph, can_play_for_ever, in_component
from finloop.loops.search import PairCounts


def numbers(
    loops: pd.DataFrame, counts: PairCounts, graph: LoopGraph, features: pd.DataFrame,
    facts: MapFacts, mapped: Ints,
) -> dict[str, float]:  # fmt: skip
    """Return the metrics of a film's loops, by their names in metrics.json.

    A seam is D(a, b) of a jump in median natural steps: 1 = as smooth as the film. Shares of the
    film are of its `mapped` rows. A component counts if the film can play in it for ever. From a
    dead end every route leads to the end of a track.
    """
    track = features["track_id"].to_numpy()
    seam = loops["distance"].to_numpy(float) / facts.step_median
    within = loops["length_s"].notna()
    largest = in_component(graph, len(features))
    sizes = loops["group"].value_counts()
    return {
        "pairs": float(counts.pairs),  # rounded: see `distance.pairs_kept`
        "pairs_below_threshold": counts.below_threshold,
        "minima": counts.minima,
        "improper_dropped": counts.improper,
        "loops": len(loops),
        "loops_within_tracks": int(within.sum()),
        "length_median_s": float(loops["length_s"].median()),
        "ends": len(graph.ends),
        "loops_per_end_max": int(np.diff(graph.start).max()),
        "groups": len(sizes),
        "largest_group_pct": float(100 * sizes.max() / len(loops)),
        "components": int(np.unique(graph.component[graph.cyclic]).size),
        "largest_component_film_pct": float(100 * largest[mapped].mean()),
        "largest_component_tracks": int(np.unique(track[largest]).size),
        "dead_ends": int((~graph.endless).sum()),
        "endless_film_pct": float(100 * can_play_for_ever(graph, track)[mapped].mean()),
        "seam_median_steps": float(np.median(seam)),
        "seam_p95_steps": float(np.quantile(seam, 0.95)),
        "seams_above_p95_of_natural_pct": float(100 * (loops["distance"] > facts.step_p95).mean()),
    }
