"""Kill a tiny pipeline at random moments, and flip random bits of what it has made.

A kill: a stage runs again, and DVC, the stage, one of its workers or all of them get KILL, TERM or
INT. It is right if all processes end, and the next `dvc repro` makes the same bytes and leaves no
other file. A flip: one bit of one result changes, and its time does not. It is right if the next
reader notices; after some, `dvc repro` must make the same bytes again.

    python -m benchmarks.faults --kills 200 --flips 500 --seed 0

The workspace is a copy in `--folder`, which a later call goes on with. Each call adds its counts to
benchmarks/faults.csv; with another seed it makes other faults. Remove the file to begin anew.
"""

from stages.run import STAGE_SOCKET, run  # isort: skip  (before numpy)

import argparse
import hashlib
import os
import random
import shutil
import signal
import subprocess
import time
from collections.abc import Collection, Iterator
from contextlib import chdir, contextmanager, redirect_stderr, suppress
from io import StringIO
from pathlib import Path
from tempfile import gettempdir

import pandas as pd
import psutil
import yaml

from benchmarks.pipeline import ROOT, data_stages
from finloop.io.checksums import (
    RECORD_NAME,
    DamagedFileError,
    check_file,
    load_digests,
    unseal,
)
from stages.code import stage_module
from stages.compose import write_params
from stages.fixture import FILM, copy_workspace, read_tiny_film
from stages.forks import open_stage_server
from stages.repository import DVC
from stages.verify import PLACES

TABLE = Path(__file__).with_suffix(".csv")
COLUMNS = ["fault", "of", "by", "tried", "right"]
TARGETS = ("dvc", "stage", "worker", "group")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
LAST_STAGES = ("export", "jumps")
"""These and all before them run: twelve stages with and without workers, every kind of file."""
END_S, LONGEST_S = 30.0, 600.0  # in which processes end after a kill; and a run by itself
FIRST_GUESS_S = 10.0  # of how long a stage takes with DVC around it
MENDED_EVERY = 25  # flips from one after which DVC runs to the next


# --- the tiny pipeline


def prepare_run(folder: Path) -> None:
    """Make a copy of the repository in `folder`, and run its pipeline on the tiny drawn film."""
    copy_workspace(folder, folder / ".dvc/cache")
    with chdir(folder):
        write_params(["~local", *read_tiny_film(FILM)])
    if failure := repro(folder):
        raise SystemExit(f"the pipeline fails on the tiny film:\n{failure}")


def repro(folder: Path, *arguments: str) -> str:
    """Run `dvc repro` in a folder; return what it prints if it fails, else ""."""
    done = subprocess.run(
        [*DVC, "repro", "--no-run-cache", *arguments, *LAST_STAGES],
        cwd=folder, text=True, check=False,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    return done.stdout if done.returncode else ""


def digest_results(folder: Path) -> dict[str, str]:
    """Return the digest of each file of a run, hidden ones and dvc.lock too, by its path."""
    places = [folder / "dvc.lock", *(folder / place for place in PLACES)]
    files = [part for place in places for part in (place, *place.rglob("*")) if part.is_file()]
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }


# --- kills


@contextmanager
def without_server(folder: Path) -> Iterator[None]:
    """Let commands start as in a terminal, by no server that has imported them."""
    socket, aside = folder / STAGE_SOCKET, folder / ".dvc/tmp/aside"
    socket.rename(aside)
    try:
        yield
    finally:
        aside.rename(socket)


def kill_run(folder: Path, stage: str, target: str, number: signal.Signals, delay_s: float) -> bool:
    """Run a stage again and send a signal to a target after a delay; return whether it was there.

    SystemExit if DVC goes on for ever.
    """
    with subprocess.Popen(
        [*DVC, "repro", "--force", "--single-item", stage], cwd=folder, start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as dvc:  # fmt: skip
        with suppress(subprocess.TimeoutExpired):
            dvc.wait(delay_s)
        was_there = _send_signal(dvc, target, number)
        try:
            dvc.wait(LONGEST_S)
        except subprocess.TimeoutExpired:
            os.killpg(dvc.pid, signal.SIGKILL)
            raise SystemExit(f"{stage} goes on after {number.name} to {target}") from None
    return was_there


def _send_signal(dvc: subprocess.Popen[bytes], target: str, number: signal.Signals) -> bool:
    """Send a signal to DVC, its stage, a worker of the stage, or all; return whether it was there.

    If the stage or its workers come later, they are waited for.
    """
    while dvc.poll() is None:
        with suppress(psutil.NoSuchProcess, ProcessLookupError):
            if target == "group":
                os.killpg(dvc.pid, number)
                return True
            parent = psutil.Process(dvc.pid)
            stages = [child for child in parent.children() if "-m" in child.cmdline()]
            workers = [worker for child in stages for worker in child.children(recursive=True)]
            found = {"dvc": [parent], "stage": stages, "worker": workers}[target]
            if found:
                found[-1].send_signal(number)
                return True
        time.sleep(0.02)
    return False


def remove_from_cache(folder: Path, stage: str) -> None:
    """Remove a stage's outputs from DVC's cache, or it would bring them back without a run."""
    lock = yaml.safe_load((folder / "dvc.lock").read_text(encoding="utf-8"))
    for out in lock["stages"][stage]["outs"]:
        cached = folder / ".dvc/cache/files/md5" / out["md5"][:2] / out["md5"][2:]
        cached.unlink(missing_ok=True)


def list_processes(folder: Path) -> dict[int, str]:
    """Return the processes that run in a folder, by number: their commands."""
    found = {}
    for process in psutil.process_iter(["cwd", "cmdline", "status"]):
        facts = process.info
        if facts["cwd"] == str(folder) and facts["status"] != psutil.STATUS_ZOMBIE:
            found[process.pid] = " ".join(facts["cmdline"] or [])
    return found


def list_orphans(folder: Path, known: Collection[int]) -> list[str]:
    """Return the commands that still run in a folder after `END_S`; known: numbers of others."""
    end = time.monotonic() + END_S
    while True:
        running = list_processes(folder)
        orphans = [command for number, command in running.items() if number not in known]
        if not orphans or time.monotonic() > end:
            return orphans
        time.sleep(0.1)


def try_kills(folder: Path, count: int, rng: random.Random) -> Iterator[tuple[str, str, bool]]:
    """Yield the target and the signal of each kill, and whether it was right.

    What was wrong is printed, and the run is put back in order.
    """
    stages = data_stages(LAST_STAGES)
    with_workers = [name for name in stages if "open_workers" in _read_source(name)]
    seconds = dict.fromkeys(stages, FIRST_GUESS_S)
    known, before = list_processes(folder), digest_results(folder)
    while count:
        target, number = rng.choice(TARGETS), rng.choice(SIGNALS)
        stage = rng.choice(with_workers if target == "worker" else stages)
        remove_from_cache(folder, stage)
        delay_s, begin = rng.uniform(0.0, seconds[stage]), time.monotonic()
        with without_server(folder):
            was_there = kill_run(folder, stage, target, number, delay_s)
        if not was_there:  # it had ended
            seconds[stage] = time.monotonic() - begin
            continue
        count -= 1
        what = f"{number.name} to {target} of {stage} after {delay_s:.1f} s"
        faults = [f"still runs: {command}" for command in list_orphans(folder, known)]
        if failure := repro(folder):
            faults.append(failure)
        after = digest_results(folder)
        names = before.keys() | after.keys()
        faults += [name for name in sorted(names) if before.get(name) != after.get(name)]
        print(f"{what}: {faults or 'right'}", flush=True)
        yield target, number.name.removeprefix("SIG"), not faults
        if faults and (failure := repro(folder, "--force")):
            raise SystemExit(f"the pipeline cannot be put back in order:\n{failure}")
        before = digest_results(folder)


def _read_source(stage: str) -> str:
    """Return the source of a stage's module."""
    return (ROOT / f"{stage_module(stage).replace('.', '/')}.py").read_text(encoding="utf-8")


# --- flips


def list_artefacts(folder: Path) -> list[Path]:
    """Return the files of a run that have a checksum, records and kept results among them."""
    records = [path for place in PLACES for path in (folder / place).rglob(RECORD_NAME)]
    named = {path for record in records for path in load_digests(record.parent)}
    return sorted(named.union(records)) + sorted((folder / "data").glob(".*.kept/*"))


def is_noticed(path: Path) -> bool:
    """Return whether the reader of a file finds that it is damaged."""
    if path.parent.suffix == ".kept":
        with redirect_stderr(StringIO()):
            return unseal(path) is None
    try:
        check_file(path if path.name != RECORD_NAME else path.with_name("any"))
    except DamagedFileError:
        return True
    return False


def try_flips(folder: Path, count: int, rng: random.Random) -> Iterator[tuple[str, str, bool]]:
    """Yield the kind of file and who noticed, for each flipped bit, and whether it was right."""
    artefacts, before = list_artefacts(folder), digest_results(folder)
    for number in range(count):
        path = rng.choice(artefacts)
        content, status = path.read_bytes(), path.stat()
        place, bit = rng.randrange(len(content)), rng.randrange(8)
        damaged = bytearray(content)
        damaged[place] ^= 1 << bit
        path.write_bytes(damaged)
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))  # as a disk does it
        right = is_noticed(path)
        if not right:
            print(f"bit {bit} of byte {place} of {path}: not noticed", flush=True)
        yield path.suffix or "kept", "reader", right
        if number % MENDED_EVERY == 0 and path.parent.suffix != ".kept":
            failure = repro(folder)
            right = not failure and digest_results(folder) == before
            print(f"{path}: {'made again' if right else f'not made again {failure}'}", flush=True)
            yield path.suffix, "dvc repro", right
        path.write_bytes(content)
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


# --- the table


def add_counts(fault: str, outcomes: Iterator[tuple[str, str, bool]]) -> None:
    """Add outcomes (of what, by what, whether right) of faults to the table, one by one."""
    for of, by, right in outcomes:
        table = pd.read_csv(TABLE) if TABLE.is_file() else pd.DataFrame(columns=COLUMNS)
        row = pd.DataFrame([[fault, of, by, 1, int(right)]], columns=COLUMNS)
        counts = pd.concat([table, row] if len(table) else [row]).groupby(COLUMNS[:3])
        counts[COLUMNS[3:]].sum().reset_index().to_csv(TABLE, index=False)


def main() -> None:
    """Make the faults that the command line counts, and add what came of them to faults.csv."""
    parser = argparse.ArgumentParser(prog="benchmarks.faults", description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--flips", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path(gettempdir()) / "finloop-faults")
    asked = parser.parse_args()
    folder, rng = asked.folder.resolve(), random.Random(asked.seed)
    if not (folder / "dvc.lock").is_file():
        shutil.rmtree(folder, ignore_errors=True)
        prepare_run(folder)
    with open_stage_server(folder):  # for the runs after faults
        add_counts("flip", try_flips(folder, asked.flips, rng))
        add_counts("kill", try_kills(folder, asked.kills, rng))
    print(pd.read_csv(TABLE).to_string(index=False))


if __name__ == "__main__":
    run(main)
