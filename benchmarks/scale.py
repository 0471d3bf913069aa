"""Everything after extraction, on films of ten thousand to a million pictures.

`python -m benchmarks.scale [PICTURES …]` varies the film in data/ (`benchmarks.varied`), runs every
stage that comes after `extract`, and writes scale.csv and scale.png: time, time of the processors,
the most memory of all processes of a stage together, and what it leaves on disk.
"""

import argparse
import os
import resource
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import yaml
from matplotlib.figure import Figure

from benchmarks.pipeline import ROOT, prepare
from benchmarks.varied import varied

PICTURES = (10_000, 100_000, 1_000_000)
FORGOTTEN = {"gait"}  # reads the film, but of several thousand pictures no more than of a hundred
_EVERY_S = 0.2  # memory is looked at so often
_TABLE = ROOT / "benchmarks/scale.csv"


def later_stages() -> list[str]:
    """The stages, those of plots left out, that read what `extract` made, in their order."""
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text(encoding="utf-8"))["stages"]
    made, words = {"data/extract"}, []
    for word, stage in stages.items():
        reads = {dep for dep in stage["deps"] if isinstance(dep, str)}
        if not word.startswith("plots-") and made & reads:
            words.append(word)
            made |= {out if isinstance(out, str) else next(iter(out)) for out in stage["outs"]}
    return words


def measured(folder: Path, word: str) -> dict[str, float]:
    """Run a stage in a folder: time, memory, disk. SystemExit with what it said if it fails."""
    log = folder / f"{word}.log"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    with log.open("wb") as said:
        process = psutil.Popen(
            [sys.executable, "-m", f"stages.{word}"], cwd=folder, env=environment,
            stdout=said, stderr=said,
        )  # fmt: skip
        most = 0
        while process.poll() is None:
            most = max(most, _memory(process))
            time.sleep(_EVERY_S)
    took, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if process.returncode:
        raise SystemExit(f"{word} failed:\n{log.read_text(errors='replace')[-2000:]}")
    return {
        "seconds": took,
        "processor_s": after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime,
        "memory_gib": most / 2**30,
        "disk_gib": _on_disk(folder / "data" / word) / 2**30,
    }


def _memory(process: psutil.Process) -> int:
    """Bytes of a process and all that it has started; what they share is counted once."""
    total = 0
    for one in (process, *process.children(recursive=True)):
        with suppress(psutil.Error):
            total += one.memory_full_info().pss
    return total


def _on_disk(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def exponent(pictures: pd.Series, seconds: pd.Series) -> float:
    """k of seconds ∝ picturesᵏ, by least squares of the logarithms."""
    return float(np.polyfit(np.log(pictures), np.log(seconds), 1)[0])


def drawn(table: pd.DataFrame) -> Figure:
    """Time of every stage over the number of pictures; dashed: in proportion to them."""
    figure = Figure(figsize=(7, 5), layout="constrained")
    axes = figure.add_subplot()
    for word, rows in table.groupby("stage", sort=False):
        style = {"color": "black", "linewidth": 2.5} if word == "together" else {}
        axes.loglog(rows["pictures"], rows["seconds"], marker="o", label=word, **style)
    whole = table[table["stage"] == "together"]
    axes.loglog(
        whole["pictures"], whole["seconds"].iloc[0] * whole["pictures"] / whole["pictures"].iloc[0],
        "k--", linewidth=1,
    )  # fmt: skip
    axes.set_xlabel("pictures")
    axes.set_ylabel("s")
    figure.legend(loc="outside right upper", fontsize="small")
    return figure


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pictures", nargs="*", type=int, default=PICTURES)
    parser.add_argument("--data", type=Path, default=ROOT / "data", help="of the film to vary")
    parser.add_argument("--stages", nargs="*", default=None, help="only these")
    parser.add_argument("--keep", type=Path, help="a folder to work in, and to go on in")
    wanted = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for pictures in wanted.pictures:
            folder = (wanted.keep or Path(scratch)) / str(pictures)
            if not (folder / "conf").exists():
                varied(wanted.data.resolve(), folder / "data", pictures)
                prepare(folder, ["clip=zebrafish"])
            for word in wanted.stages or [w for w in later_stages() if w not in FORGOTTEN]:
                rows.append({"pictures": pictures, "stage": word, **measured(folder, word)})
                print(pd.DataFrame(rows[-1:]).round(2).to_string(header=False), flush=True)
    table = pd.DataFrame(rows)
    whole = table.groupby("pictures", as_index=False).agg(
        seconds=("seconds", "sum"), processor_s=("processor_s", "sum"),
        memory_gib=("memory_gib", "max"), disk_gib=("disk_gib", "sum"),
    )  # fmt: skip
    table = pd.concat([table, whole.assign(stage="together")], ignore_index=True)
    print(whole.round(2).to_string(index=False))
    if len(whole) > 1:
        print(f"time ~ pictures^{exponent(whole['pictures'], whole['seconds']):.2f}")
    if not wanted.stages:
        table.round(3).to_csv(_TABLE, index=False)
        drawn(table).savefig(_TABLE.with_suffix(".png"), dpi=100)


if __name__ == "__main__":
    main()
