"""Stage `retarget`: a track recorded anywhere is swum by this film's fish."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from finloop.animate import measures
from finloop.distance.map import STEPS, MapFacts
from finloop.edit.pictures import drawn_steps, seams
from finloop.edit.schema import EDIT
from finloop.features.table import FEATURES
from finloop.given_motion import given_motion
from finloop.io.atomic import whole_folder
from finloop.io.cutouts import open_cutouts
from finloop.io.record import load_record
from finloop.io.table import load_table, save_table
from finloop.io.video import ARENA_NAME, FACTS_NAME, load_facts, load_mask
from finloop.reel import Reel
from finloop.retarget import ASKED, Material, Parts, Retargeted, retargeted
from finloop.retarget.settings import Settings
from stages.forecasts import load_look
from stages.poses import load_poses
from stages.settings import load

DATA, OUT, REPORT = Path("data"), Path("data/retarget"), Path("reports/retarget")


@contextmanager
def material() -> Iterator[Material]:
    """Results of the stages before, of the film that is drawn."""
    facts = load_facts(DATA / "clip" / FACTS_NAME)
    features = load_table(DATA / "features/features.parquet", FEATURES)
    with open_cutouts(DATA / "extract/cutouts.arrow") as cutouts:
        yield Material(
            facts.frame_rate_hz,
            load_mask(DATA / "clip" / ARENA_NAME, facts.width_px, facts.height_px),
            Reel(features, cutouts),
            load_poses(features),
            load_look(),
            load_record(DATA / "distance/facts.json", MapFacts, "distance").size,
        )


def of_film(p: Settings) -> Retargeted:
    """The track of the parameters, swum by the fish of the film."""
    steps = load_table(DATA / "distance/steps.parquet", STEPS)[["step", "as_filmed"]].dropna()
    with material() as film:
        others = Parts(load("jumps"), load("animate"))
        swum = retargeted(given_motion(film, p), film, p, others)
        mine = drawn_steps(swum.edit, film.pictures)
        joins, _ = seams(swum.edit, film.pictures)
    numbers = {
        **swum.numbers,
        **measures.of_steps(mine, steps["as_filmed"].to_numpy(float)),
        **measures.of_seams(joins, steps["step"].to_numpy(float)),
    }
    return swum._replace(numbers=numbers)


def notes(numbers: Mapping[str, float]) -> list[str]:
    """What is to be known of a retargeted track, in sentences; numbers: of `Retargeted`."""
    sentences = []
    if not numbers["with_postures"]:
        sentences.append(
            "the track says no posture (that takes three points along the body): the fish is bent "
            "as the film's at such a speed and turn rate"
        )
    if numbers["left_out_s"] > 0:
        sentences.append(
            f"the longest stretch without a gap is swum, {numbers['duration_s']:.1f} s; "
            f"{numbers['left_out_s']:.1f} s are left out"
        )
    if numbers["outside_ticks"]:
        sentences.append(f"the fish leaves the tank in {numbers['outside_ticks']} ticks")
    return sentences


def main() -> None:
    """Make data/retarget/, reports/retarget/."""
    p: Settings = load("retarget")
    if p.tracks is None:
        swum = Retargeted(EDIT.empty(), ASKED.empty(), {"ticks": 0})
    else:
        swum = of_film(p)
        for note in notes(swum.numbers):
            print(f"retarget: {note}", file=sys.stderr)
    with whole_folder(OUT) as folder:
        save_table(folder / "retargeted.parquet", swum.edit, EDIT)
        save_table(folder / "asked.parquet", swum.asked, ASKED)
    save_metrics(REPORT / "metrics.json", swum.numbers)


if __name__ == "__main__":
    run(main)
