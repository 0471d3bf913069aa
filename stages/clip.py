"""Stage `clip`: a film becomes the normalised clip, with its facts, its arena and its truth."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from pathlib import Path

from finloop.clip.quality import psnr_db
from finloop.clip.settings import Settings
from finloop.io.atomic import whole_folder
from finloop.io.video import CLIP_NAME, read_spread
from finloop.normalise import normalise, open_source
from stages.settings import load

CLIP = Path("data/clip")
METRICS = Path("reports/clip/metrics.json")
FACTS = (  # among the metrics
    "frames", "width_px", "height_px", "frame_rate_hz", "frames_repeated", "frames_dropped",
    "frames_missing",
)  # fmt: skip


def main() -> None:
    """Make data/clip/ and reports/clip/metrics.json."""
    p: Settings = load("clip")
    source = open_source(p)
    for note in source.facts.notes:
        print(f"finloop: note: {note}", file=sys.stderr)
    with whole_folder(CLIP) as folder:
        with progress("clip", source.facts.frames) as advance:
            facts, tally, arena = normalise(source, p, folder, advance)
        for note in source.loss.notes:
            print(f"finloop: WARNING: {note}", file=sys.stderr)
        coded = read_spread(folder / CLIP_NAME, list(tally.samples), colour=facts.colour)
        numbers = {name: getattr(facts, name) for name in FACTS} | {
            "duration_s": facts.frames / facts.frame_rate_hz,
            "segments": len(facts.segments),
            "brightness_mean_level": tally.brightness_mean,
            "brightness_min_level": tally.darkest,
            "brightness_max_level": tally.brightest,
            "coding_psnr_db": psnr_db(zip(tally.samples.values(), coded, strict=True)),
            "arena_fraction": float(arena.mean()),
        }
    save_metrics(METRICS, numbers)


if __name__ == "__main__":
    run(main)
