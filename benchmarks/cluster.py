"""`extract` by workers of Dask: its time against processes, and its bytes when workers are killed.

`python -m benchmarks.cluster` extracts the zebrafish by two processes and by two workers of Dask,
and compares the bytes. The scheduler and workers run already, or the stage starts and ends them
(`cluster=local`). Then, on drawn carp, signal 9 kills 20 times a random worker, at frames drawn
from a seed. Needs the extra `cluster`; writes benchmarks/cluster.csv.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import hashlib
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager
from pathlib import Path
from statistics import median

import numpy as np
import pandas as pd
import psutil

from benchmarks.pipeline import ROOT, prepare_folder, process_environment, run_stage, write_table
from finloop.base.parallel import Workers
from finloop.extract import film
from finloop.extract.write import extract_tracks
from finloop.io.video import FACTS_NAME, load_facts
from stages.cluster import open_workers
from stages.extract import WORKERS_NEED
from stages.settings import load_settings

FILM = ["clip=zebrafish"]
CARP = ["clip=carp", "clip.frames=1920", "clip.width_px=320", "clip.height_px=240",
        "clip.body_length_px=70", "clip.colour=false"]  # fmt: skip
PAIRS, KILLS, SEED = 3, 20, 1
SHORT = 24  # frames of a piece while workers are killed: more pieces than kills
PORT = 18786


def file_digests(folder: Path) -> dict[str, str]:
    """Return the digests of the files of a folder, by name."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def processor_times(processes: list[psutil.Process]) -> dict[int, float]:
    """Return the processor time [s] of processes and all their children, by process id."""
    times = {}
    for process in processes:
        try:
            for member in (process, *process.children(recursive=True)):
                times[member.pid] = sum(member.cpu_times()[:2])
        except psutil.NoSuchProcess:
            continue
    return times


def time_extract(folder: Path, other_processes: list[psutil.Process]) -> tuple[float, float]:
    """Return the seconds of `extract`, and the processor seconds of all its processes.

    other_processes: those of the scheduler and its workers, counted, too.
    """
    before, latest = processor_times(other_processes), dict[int, float]()
    start = time.perf_counter()
    command = [sys.executable, "-m", "stages.extract"]
    run = subprocess.Popen(
        command, cwd=folder, env=process_environment(), stderr=subprocess.DEVNULL
    )
    while run.poll() is None:
        latest |= processor_times([psutil.Process(run.pid), *other_processes])
        time.sleep(0.1)
    if run.returncode:
        raise SystemExit("extract failed")
    return time.perf_counter() - start, sum(latest.values()) - sum(before.values())


@contextmanager
def run_scheduler() -> Iterator[list[psutil.Process]]:
    """Run Dask's scheduler and two workers as docs/cluster.md does; yield the processes."""
    address = f"tcp://127.0.0.1:{PORT}"
    dask = [sys.executable, "-m", "dask", "scheduler", "--host", "127.0.0.1", "--port", str(PORT)]
    worker = [sys.executable, "-m", "stages.cluster", address, "--count", "1"]
    silent, environment = subprocess.DEVNULL, process_environment()
    processes = [
        subprocess.Popen(command, cwd=home, env=environment, stdout=silent, stderr=silent)
        for command, home in ((dask, Path("/")), (worker, ROOT), (worker, ROOT))
    ]
    try:
        yield [psutil.Process(process.pid) for process in processes]
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def time_by_workers(folder: Path) -> pd.DataFrame:
    """Return seconds and processor seconds of `extract`, by kind of workers; compare the bytes."""
    overrides_by_name = {
        "2 processes": [],
        "2 workers of Dask": [f"cluster.scheduler_address=tcp://127.0.0.1:{PORT}"],
        "cluster=local": ["cluster=local"],
    }
    rows, digests = [], []
    prepare_folder(folder, FILM)
    run_stage(folder, "clip")
    with run_scheduler() as dask_processes:
        for _ in range(PAIRS + 1):  # the first run does not count: it compiles, and workers import
            for name, overrides in overrides_by_name.items():
                prepare_folder(folder, [*FILM, *overrides])
                rows.append((name, *time_extract(folder, dask_processes)))
                digests.append(file_digests(folder / "data/extract"))
    if any(digest != digests[0] for digest in digests):
        raise SystemExit("the bytes differ")
    table = pd.DataFrame(rows[len(overrides_by_name) :], columns=["by", "wall_s", "processor_s"])
    table["pair"] = np.repeat(np.arange(PAIRS), len(overrides_by_name))
    first = table[table["by"] == "2 processes"].set_index("pair")
    for column in ("wall_s", "processor_s"):
        table[f"{column[:-2]}_ratio"] = table[column] / table["pair"].map(first[column])
    return table.groupby("by", sort=False).agg(median).drop(columns="pair").reset_index()


def extract_with_kills(
    folder: Path, out: Path, pool: Workers, worker_ids: Callable[[], set[int]], most_kills: int
) -> int:
    """Run `extract` while workers are killed at random frames; return how many were killed.

    worker_ids: returns the ids of the workers' processes. A new worker is spared: Dask gives up a
    place if its worker ends while it starts.
    """
    clip = folder / "data/clip"
    rng = np.random.default_rng(SEED)
    frames = load_facts(clip / FACTS_NAME).frames
    moments = sorted(
        rng.choice(frames - 4 * SHORT, most_kills, replace=False).tolist(), reverse=True
    )
    kills = done_frames = 0
    known_workers: set[int] = set()  # workers at the end of the last piece

    def advance() -> None:
        nonlocal kills, done_frames, known_workers
        done_frames += 1
        if moments and done_frames > moments[-1] and (ids := worker_ids() & known_workers):
            os.kill(int(rng.choice(sorted(ids))), signal.SIGKILL)
            moments.pop()
            kills += 1
        if done_frames % SHORT == 0:
            known_workers = worker_ids()

    out.mkdir()
    extract_tracks(clip, load_settings("extract"), out, pool, advance)
    return kills


def compare_killed_runs(folder: Path) -> list[tuple[str, int, bool]]:
    """Return, for each kind of workers, its name, the kills, and whether the bytes stay equal."""
    film._STRETCH = SHORT
    prepare_folder(folder, CARP)
    run_stage(folder, "clip")
    run_stage(folder, "extract")
    results: list[tuple[str, int, bool]] = []
    for name, overrides in {"2 processes": [], "cluster=local": ["cluster=local"]}.items():
        prepare_folder(folder, [*CARP, *overrides])
        with chdir(folder), open_workers(WORKERS_NEED) as pool:

            def worker_ids(pool: Workers = pool) -> set[int]:
                if client := getattr(pool, "client", None):
                    return {*client.run(os.getpid, on_error="ignore").values()}
                return {process.pid for process in multiprocessing.active_children() if process.pid}

            out = folder / f"out-{len(results)}"
            count = extract_with_kills(folder, out, pool, worker_ids, KILLS)
        results.append((name, count, file_digests(out) == file_digests(folder / "data/extract")))
        print(f"{name}: {count} workers killed; the same bytes: {results[-1][2]}", flush=True)
    return results


def main() -> None:
    """Measure times and runs with killed workers; print and write the tables."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        table = time_by_workers(folder).round(3)
        write_table(__file__, table)
        if not all(same for _, _, same in compare_killed_runs(folder)):
            raise SystemExit("the bytes differ")


if __name__ == "__main__":
    main()
