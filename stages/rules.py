"""The rule by which fish of one tank act on each other, of the stage `calibrate`."""

from dataclasses import asdict
from pathlib import Path

import pandas as pd

from finloop.io.record import load_json, made_by, save_json
from finloop.io.table import load_table, save_table
from finloop.social.rule import Shoaling
from finloop.social.steps import STEPS, rows_of, steps_of
from finloop.social.zones import Zones

FOLDER = Path("data/calibrate")


def save_rule(folder: Path, rule: Shoaling) -> None:
    """Write the zones and the own steps of a film."""
    own = rule.steps
    save_json(folder / "zones.json", {
        "zones": asdict(rule.zones), "horizon_frames": rule.horizon, "alike": rule.alike,
        "forward": own.forward, "onward": own.onward,
    })  # fmt: skip
    save_table(folder / "steps.parquet", pd.DataFrame(rows_of(own)), STEPS)


def load_rule() -> Shoaling:
    """What `save_rule` wrote."""
    table = load_table(FOLDER / "steps.parquet", STEPS)
    return load_json(
        FOLDER / "zones.json",
        lambda entry: Shoaling(
            Zones(**entry["zones"]), steps_of(table, entry["forward"], entry["onward"]),
            entry["horizon_frames"], entry["alike"],
        ),
        *made_by("calibrate"),
    )  # fmt: skip
