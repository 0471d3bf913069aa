"""Stage `extract`: the normalised clip becomes background, tracks, backbones, cut-outs."""

from stages.run import THREADS, progress, run, save_metrics  # isort: skip  (before numpy)

from dataclasses import asdict
from pathlib import Path
from typing import get_args

import cv2

from finloop.base.parallel import warm_up
from finloop.extract.samples import Verdict
from finloop.extract.settings import Settings
from finloop.extraction import Extraction, extract
from finloop.io.atomic import whole_folder
from finloop.io.video import FACTS_NAME, load_facts
from stages.settings import load

CLIP, EXTRACT, REPORT = Path("data/clip"), Path("data/extract"), Path("reports/extract")
LONG = 60  # frames of a long track
WORKERS_NEED = ["finloop.extract.film", "finloop.io.video"]  # imported once, for all workers


def main() -> None:
    """Make data/extract/ and reports/extract/metrics.json."""
    settings: Settings = load("extract")
    if THREADS > 1:
        warm_up(WORKERS_NEED)
    frames = load_facts(CLIP / FACTS_NAME).frames
    with whole_folder(EXTRACT) as folder, progress("extract", frames) as advance:
        made = extract(CLIP, settings, folder, THREADS, advance)
    save_metrics(REPORT / "metrics.json", {"frames": frames, **metrics(made)})


def metrics(made: Extraction) -> dict[str, float]:
    """Numbers on noise, the typical fish, verdicts and the lengths of tracks."""
    scene, verdicts, lengths = made
    long = [count for count in lengths.values() if count >= LONG]
    return {
        **{name: value for name, value in asdict(scene).items() if name.endswith(("_grey", "_px"))},
        "silhouettes": verdicts.total(),
        **{f"silhouettes_{v.replace(' ', '_')}": verdicts[v] for v in get_args(Verdict)},
        "fish_frames": lengths.total(),
        "tracks": len(lengths),
        f"tracks_of_{LONG}_frames": len(long),
        f"fish_frames_in_tracks_of_{LONG}_frames": sum(long),
        "longest_track_frames": max(lengths.values()),
    }


if __name__ == "__main__":
    cv2.setNumThreads(1)  # the processes already use every core
    run(main)
