"""Stage `bpn`: the feature table becomes the motion model, and its errors (Fig. 15)."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

from contextlib import suppress
from pathlib import Path

import numpy as np

from finloop.bpn.held_out import HELD_OUT, assessment, held_out_table
from finloop.bpn.model import Mask, Rows, motion_rows, split_by_blocks, split_by_tracks
from finloop.bpn.onnx import onnx_bytes
from finloop.bpn.settings import Settings
from finloop.bpn.train import train
from finloop.errors import FinloopError
from finloop.features.table import FEATURES, delta_of
from finloop.io.atomic import save_bytes
from finloop.io.record import save_json
from finloop.io.table import load_table, save_csv, save_table
from finloop.io.video import FACTS_NAME, load_facts
from stages.settings import load

FACTS, TABLE = Path("data/clip") / FACTS_NAME, Path("data/features/features.parquet")
OUT, REPORT = Path("data/bpn"), Path("reports/bpn")


def split(rows: Rows, by: str, p: Settings, rate_hz: float) -> tuple[Mask, Mask]:
    """Rows to learn from and rows held out."""
    rng = np.random.default_rng((p.seed, 0))
    if by == "tracks":
        return split_by_tracks(rows, p.held_out, rng)
    return split_by_blocks(rows, max(1, round(p.block_s * rate_hz)), p.held_out, rng)


def main() -> None:
    """Make data/bpn/, reports/bpn/."""
    p: Settings = load("bpn")
    rate_hz = load_facts(FACTS).frame_rate_hz
    table = load_table(TABLE, FEATURES)
    delta = delta_of(table)
    rows = motion_rows(table, delta)
    sides = [split(rows, p.split, p, rate_hz)]
    # The other way to split says how far the skill reaches: to other times, to other fish.
    with suppress(FinloopError):  # one track, or too short
        sides.append(split(rows, "tracks" if p.split == "blocks" else "blocks", p, rate_hz))

    learnt = []
    with progress("bpn", p.epochs * len(sides), "epochs") as advance:
        for known, held in sides:
            seen, unseen = ((rows.inputs[side], rows.outputs[side]) for side in (known, held))
            rng = np.random.default_rng((p.seed, 1))
            learnt.append(train(*seen, unseen, p, delta / rate_hz, rng, advance))

    metrics, *other = (
        assessment(model, rows, *side) for (model, _), side in zip(learnt, sides, strict=True)
    )
    for found in other:
        kept = {name: found[name] for name in found if "held_out" in name or "skill" in name}
        metrics |= {f"other_split_{name}": value for name, value in kept.items()}
    (model, curve), (_, held) = learnt[0], sides[0]
    save_json(OUT / "model.json", model.record(), indent=1)
    save_bytes(OUT / "model.onnx", onnx_bytes(model))
    save_csv(REPORT / "curve.csv", curve, decimals=5)
    unseen = held_out_table(model, rows, held)
    save_table(OUT / "held_out.parquet", unseen, HELD_OUT)
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
