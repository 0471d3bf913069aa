"""All stages after extraction, on films of ten thousand to a million pictures.

`python -m benchmarks.scale [PICTURES …]` varies the film in data/ (`benchmarks.varied`), runs every
stage after `extract`, starts the live tank, plans, and writes scale.csv and scale.png: wall time,
processor time, the peak memory of all processes of a stage together, and its size on disk. With
`--keep` it can be interrupted: stages with figures in that folder do not run again.
"""

import argparse
import json
import resource
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
from matplotlib.figure import Figure

from benchmarks.pipeline import ROOT, load_stages, prepare_folder, process_environment
from benchmarks.varied import write_film
from finloop.io.numbers import load_numbers

PICTURES = (10_000, 100_000, 1_000_000)
FORGOTTEN = {"gait", "report"}  # gait: the same for several thousand pictures as for a hundred
PROGRAMS = {"start": ["benchmarks.planning", "start"], "planning": ["benchmarks.planning", "plan"]}
"""Measured in addition to stages: the start of `make play`, and the ticks planned per second."""

FILM, TOGETHER = "film", "together"
"""The film itself, as extraction writes it, and the sum of all stages."""

MEMORY_GIB = 8.0  # most memory for a million pictures

_EVERY_S = 1.0  # period of the memory check, which takes long for large processes
_COLOURS = 10  # colours of lines; further lines are dotted
_TABLE = ROOT / "benchmarks/scale.csv"


def later_stages() -> list[str]:
    """Return the stages, except plots, that depend on `extract`, in their order."""
    written, names = {"data/extract"}, []
    for name, stage in load_stages().items():
        reads = {dep for dep in stage["deps"] if isinstance(dep, str)}
        if not name.startswith("plots-") and written & reads:
            names.append(name)
            written |= {out if isinstance(out, str) else next(iter(out)) for out in stage["outs"]}
    return names


def measure_stage(folder: Path, stage_name: str) -> dict[str, float]:
    """Run a stage or program; return its time, memory and disk. SystemExit if it fails."""
    log = folder / f"{stage_name}.log"
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    with log.open("wb") as output:
        process = psutil.Popen(
            [sys.executable, "-m", *PROGRAMS.get(stage_name, [f"stages.{stage_name}"])],
            cwd=folder, env=process_environment(), stdout=output, stderr=output,
        )  # fmt: skip
        peak_bytes, processor_s = 0, dict[int, float]()
        while process.poll() is None:
            present_bytes, present_s = _memory_and_times(process)
            peak_bytes, processor_s = max(peak_bytes, present_bytes), processor_s | present_s
            time.sleep(_EVERY_S)
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    waited_for = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    if process.returncode:
        raise SystemExit(f"{stage_name} failed:\n{log.read_text(errors='replace')[-2000:]}")
    return {
        "seconds": seconds,
        "processor_s": max(waited_for, sum(processor_s.values())),
        "memory_gib": peak_bytes / 2**30,
        "disk_gib": _bytes_on_disk(folder / "data" / stage_name) / 2**30,
    }


def _memory_and_times(process: psutil.Process) -> tuple[int, dict[int, float]]:
    """Return the bytes of a process and its children, and the processor time of each by id.

    Shared memory counts once. The system does not sum the time of workers that no stage waits for.
    """
    total, times = 0, {}
    with suppress(psutil.Error):
        for member in (process, *process.children(recursive=True)):
            with suppress(psutil.Error):
                total += member.memory_full_info().pss
                times[member.pid] = sum(member.cpu_times()[:2])
    return total, times


def _bytes_on_disk(folder: Path) -> int:
    """Return the bytes of all files in a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def make_film(folder: Path, home: Path, pictures: int) -> None:
    """Write a varied film into a folder, unless it is there, and keep its time and size."""
    if (folder / "conf").exists():
        return
    start = time.perf_counter()
    write_film(home.resolve(), folder / "data", pictures)
    took, disk = time.perf_counter() - start, _bytes_on_disk(folder / "data") / 2**30
    keep_figures(folder, FILM, {"seconds": took, "disk_gib": disk})
    prepare_folder(folder, ["clip=zebrafish"])


def keep_figures(folder: Path, stage_name: str, figures: dict[str, float]) -> None:
    """Write the figures of a stage into the kept folder."""
    path = folder / "figures" / f"{stage_name}.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(figures), encoding="utf-8")


def stage_figures(folder: Path, stage_name: str) -> dict[str, float]:
    """Return the figures of a stage, from the kept folder or by `measure_stage`."""
    path = folder / "figures" / f"{stage_name}.json"
    if not path.exists():
        keep_figures(folder, stage_name, measure_stage(folder, stage_name))
    return json.loads(path.read_text(encoding="utf-8"))


def measure_quality(folder: Path) -> dict[str, float]:
    """Return recall, goals reached, ticks planned and the size of a cut-out."""
    numbers = dict[str, float]()
    if (report := folder / "data/animate/beside/measures.csv").exists():
        measures = pd.read_csv(report, index_col="measure").drop(columns="film")
        goals = measures.loc["trials_goals_reached_pct"].astype(float)
        numbers |= goals.add_suffix("_goals_pct").to_dict()
    numbers |= {"recall_pct": load_numbers(folder / "reports/jumps").get("recall_pct", np.nan)}
    if (planned := folder / "planning.json").exists():
        numbers |= json.loads(planned.read_text(encoding="utf-8"))
    cutouts = folder / "data/extract/cutouts.arrow"
    return numbers | {"cutout_kb": cutouts.stat().st_size / int(folder.name) / 1000}


def growth_exponent(picture_counts: pd.Series, seconds: pd.Series) -> float:
    """Return the exponent k in seconds ∝ picturesᵏ, by least squares of the logarithms."""
    return float(np.polyfit(np.log(picture_counts), np.log(seconds), 1)[0])


def _complete_sum(figures: "pd.Series[float]") -> float:
    """Return the sum of figures, NaN if one of them is NaN."""
    return float(figures.sum(skipna=False))


def sum_stages(table: pd.DataFrame) -> pd.DataFrame:
    """Return the sums over all stages: a row for each number of pictures with complete figures.

    Memory is the maximum. The disk includes the film itself, the time does not. A sum is NaN if one
    of its figures is.
    """
    many = table.groupby("pictures")["stage"].transform("size")
    stages = table[~table["stage"].isin(PROGRAMS) & (many == many.max())].copy()
    stages.loc[stages["stage"] == FILM, ["seconds", "processor_s"]] = 0.0
    sums = stages.groupby("pictures", as_index=False).agg(
        seconds=("seconds", "sum"), processor_s=("processor_s", _complete_sum),
        memory_gib=("memory_gib", "max"), disk_gib=("disk_gib", "sum"),
    )  # fmt: skip
    return sums.assign(stage=TOGETHER)


def plot_growth(table: pd.DataFrame) -> Figure:
    """Plot processor time and memory of every stage over the number of pictures.

    Dashed lines show n log n and the memory limit.
    """
    figure, stages = Figure(figsize=(10, 5), layout="constrained"), list(table["stage"].unique())
    for axes, column in zip(figure.subplots(1, 2), ("processor_s", "memory_gib"), strict=True):
        for stage, rows in table[table["stage"] != FILM].groupby("stage", sort=False):
            style = {"color": "black", "linewidth": 2.5} if stage == TOGETHER else {}
            style |= {"linestyle": "-" if stages.index(stage) < _COLOURS else ":"}
            label = None if column == "memory_gib" else stage
            axes.loglog(rows["pictures"], rows[column], marker=".", label=label, **style)
        axes.set_xlabel("pictures")
    sums = table[table["stage"] == TOGETHER]
    n = sums["pictures"].to_numpy(float)
    growth = n * np.log(n)
    time_axes, memory_axes = figure.axes
    time_axes.loglog(n, sums["processor_s"].iloc[0] * growth / growth[0], "k--", linewidth=1)
    time_axes.set_ylabel("processor time, s")
    memory_axes.axhline(MEMORY_GIB, color="black", linestyle="--", linewidth=1)
    memory_axes.set_ylabel("memory, GiB")
    figure.legend(loc="outside right upper", fontsize="small")
    return figure


def write_report(table: pd.DataFrame) -> None:
    """Print the growth of time; write the table and the plot."""
    sums = sum_stages(table)
    print(sums.round(2).to_string(index=False))
    table = pd.concat([table, sums], ignore_index=True)
    for stage, rows in table.dropna(subset="processor_s").groupby("stage", sort=False):
        if len(rows) > 1:
            exponent = growth_exponent(rows["pictures"], rows["processor_s"])
            print(f"{stage}: processor time ~ pictures^{exponent:.2f}")
    table.round(3).to_csv(_TABLE, index=False)
    plot_growth(table).savefig(_TABLE.with_suffix(".png"), dpi=100)


def main() -> None:
    """Measure all stages on films of growing length; print and write the table and the plot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pictures", nargs="*", type=int, default=PICTURES)
    parser.add_argument(
        "--data", type=Path, default=ROOT / "data", help="folder of the film to vary"
    )
    parser.add_argument("--stages", nargs="*", default=None, help="only these stages")
    parser.add_argument("--keep", type=Path, help="a working folder, kept for later runs")
    parser.add_argument("--report", action="store_true", help="report --keep; run nothing")
    options = parser.parse_args()
    stages = [FILM, *(stage for stage in later_stages() if stage not in FORGOTTEN), *PROGRAMS]
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for pictures in options.pictures:
            folder = (options.keep or Path(scratch)) / str(pictures)
            if not options.report:
                make_film(folder, options.data, pictures)
            for stage in options.stages or stages:
                if options.report and not (folder / "figures" / f"{stage}.json").exists():
                    continue
                rows.append({"pictures": pictures, "stage": stage, **stage_figures(folder, stage)})
                print(pd.DataFrame(rows[-1:]).round(2).to_string(header=False), flush=True)
            print(pictures, pd.Series(measure_quality(folder)).round(2).to_dict())
    table = pd.DataFrame(rows)
    if options.stages:
        print(sum_stages(table).round(2).to_string(index=False))
    else:
        write_report(table)


if __name__ == "__main__":
    main()
