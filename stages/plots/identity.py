"""Picture of `identity`: whose tracks are whose, over time."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.features.table import FEATURES
from finloop.identity.film import IDENTITIES
from finloop.io.picture import save_figure
from finloop.io.table import load_table
from finloop.io.video import FACTS_NAME, load_facts
from finloop.plots.identity import timeline

DATA = Path("data")


def main() -> None:
    """Draw timeline.png."""
    features = load_table(DATA / "features/features.parquet", FEATURES, ["track_id", "frame"])
    table = load_table(DATA / "identity/identities.parquet", IDENTITIES)
    rate_hz = load_facts(DATA / "clip" / FACTS_NAME).frame_rate_hz
    save_figure(Path("reports/identity/timeline.png"), timeline(table, features, rate_hz))


if __name__ == "__main__":
    run(main)
