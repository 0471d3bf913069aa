"""Stage `identity`: join tracks to animals, by motion and appearance."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

from pathlib import Path

import numpy as np
import pandas as pd

from finloop.identity.film import (
    IDENTITIES,
    USED,
    IdentityEvidence,
    collect_evidence,
    identify_animals,
    identities_from_names,
    measure_trial_gaps,
)
from finloop.identity.settings import IdentitySettings
from finloop.io.table import save_table
from finloop.project import Project
from stages.settings import load_settings

OUT, REPORT = Path("data/identity"), Path("reports/identity")


def main() -> None:
    """Find which tracks show the same animal; write data/identity/ and reports/identity/.

    Tracks of another program have names already; else tracks are joined by motion and appearance.
    """
    p: IdentitySettings = load_settings("identity")
    with Project() as project:
        features, given = project.features, project.external_tracks
        # The frames after a cut of the film.
        cuts = [start for start, _ in project.facts.segments[1:]]
        if given is not None:
            table, trial = identities_from_names(features, given["animal"]), dict[str, float]()
        else:
            film = collect_evidence(project.film_reel, project.tracks(USED), cuts, p)
            table = identify_animals(film)
            trial = _test_joins(film, table)
    save_table(OUT / "identities.parquet", table, IDENTITIES)
    save_metrics(REPORT / "metrics.json", _identity_metrics(features, table) | trial)


def _identity_metrics(features: pd.DataFrame, table: pd.DataFrame) -> dict[str, float]:
    """Return metrics by name: numbers of animals and of joined tracks, and gaps in frames.

    table: a row per track: its animal, the track before it (−1: none), and the gap between them.
    """
    joins = table[table["after_track"] >= 0]
    sizes = features.merge(table, on="track_id").groupby("identity").size()
    at_once = features.groupby("frame").size()
    return {
        "tracks": len(table),
        "identities": int(table["identity"].nunique()),
        "animals_at_once_median": float(at_once.median()),
        "animals_at_once_max": int(at_once.max()),
        "joins": len(joins),
        "joins_gap_median_frames": joins["gap_frames"].median(),
        "joins_gap_max_frames": joins["gap_frames"].max(),
        "longest_identity_pct": float(100 * sizes.max() / features["frame"].nunique()),
    }


def _test_joins(film: IdentityEvidence, table: pd.DataFrame) -> dict[str, float]:
    """Cut tracks artificially; return the percentages that are joined right and wrong, by name.

    The joins' own probabilities are returned, too. film: what joins are judged by. table: a row per
    track, columns of `IDENTITIES`.
    """
    joins = table[table["after_track"] >= 0]
    rng = np.random.default_rng(film.settings.seed)
    right, wrong = measure_trial_gaps(film, joins["gap_frames"].to_numpy(), rng)
    return {
        "joins_probability_median": joins["probability"].median(),
        "joins_probability_min": joins["probability"].min(),
        "made_gaps_joined_right_pct": 100 * right,
        "made_gaps_joined_wrong_pct": 100 * wrong,
    }


if __name__ == "__main__":
    run(main)
