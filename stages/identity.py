"""Stage `identity`: tracks are joined to animals, by motion and appearance."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

from pathlib import Path

import numpy as np
import pandas as pd

from finloop.extract.table import GIVEN, GIVEN_NAME, SceneFacts, tracks_schema
from finloop.features.table import FEATURES
from finloop.identity.film import (
    IDENTITIES,
    USED,
    Evidence,
    evidence,
    from_names,
    identities,
    trial_gaps,
)
from finloop.identity.settings import Settings
from finloop.io.cutouts import open_cutouts
from finloop.io.record import load_record
from finloop.io.table import load_table, save_table
from finloop.io.video import FACTS_NAME, load_facts
from finloop.reel import Reel
from stages.settings import load

DATA, OUT, REPORT = Path("data"), Path("data/identity"), Path("reports/identity")


def main() -> None:
    """Make data/identity/, reports/identity/."""
    p: Settings = load("identity")
    facts = load_facts(DATA / "clip" / FACTS_NAME)
    points = load_record(DATA / "extract/scene.json", SceneFacts, "extract").points
    tracks = load_table(DATA / "extract/tracks.parquet", tracks_schema(points), USED)
    features = load_table(DATA / "features/features.parquet", FEATURES)
    cuts = [start for start, _ in facts.segments[1:]]
    if (path := DATA / "extract" / GIVEN_NAME).exists():
        table = from_names(features, load_table(path, GIVEN, ["animal"])["animal"])
        trial = {}
    else:
        with open_cutouts(DATA / "extract/cutouts.arrow") as store:
            film = evidence(Reel(features, store), tracks, cuts, p)
            table = identities(film)
            trial = join_trial(film, table)
    save_table(OUT / "identities.parquet", table, IDENTITIES)
    save_metrics(REPORT / "metrics.json", numbers(features, table) | trial)


def numbers(features: pd.DataFrame, table: pd.DataFrame) -> dict[str, float]:
    """Numbers of animals and joins, and the lengths of gaps."""
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


def join_trial(film: Evidence, table: pd.DataFrame) -> dict[str, float]:
    """How sure joins are, and how often they are right in trial gaps."""
    joins = table[table["after_track"] >= 0]
    rng = np.random.default_rng(film.settings.seed)
    right, wrong = trial_gaps(film, joins["gap_frames"].to_numpy(), rng)
    return {
        "joins_probability_median": joins["probability"].median(),
        "joins_probability_min": joins["probability"].min(),
        "made_gaps_joined_right_pct": 100 * right,
        "made_gaps_joined_wrong_pct": 100 * wrong,
    }


if __name__ == "__main__":
    run(main)
