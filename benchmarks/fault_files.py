"""Damaged and hostile files: each reader of foreign files gives a result or one message.

`python -m benchmarks.fault_files` prints the table and writes benchmarks/fault_files.csv; --count
files for each reader (10,000), --only names of readers, --keep a folder for the files that failed.
Each reader gets files of real shape. First come hostile ones as they stand; then bits are flipped,
parts cut, swapped, repeated and overwritten, and numbers replaced by hostile values. A child
process for each reader has 1 GiB of memory beyond what its libraries take, and 10 s of processor
time for each file. An audit hook counts what a file runs or connects to.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import argparse
import gc
import json
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any, NamedTuple

import pandas as pd

from benchmarks.fault_seeds import CANARY, READERS, Reader
from benchmarks.mutations import mutate
from benchmarks.pipeline import write_table
from finloop.base import limited_process
from finloop.base.errors import FinloopError

MOST_MEMORY = 2**30  # bytes
MOST_SECONDS = 10  # of processor time, for one file
MOST_LETTERS = 5000  # of a message
RUNS = (
    "os.system", "os.exec", "os.posix_spawn", "os.fork", "os.forkpty", "subprocess.Popen",
    "socket.connect", "socket.bind", "socket.getaddrinfo", "pickle.find_class", "os.remove",
    "os.rename", "os.chmod", "shutil.rmtree",
)  # fmt: skip
"""Audit events of what no file may do."""


class Outcome(NamedTuple):
    """What a reader made of one file: "result", "message", or a fault, with its details."""

    kind: str
    details: str = ""
    seconds: float = 0.0


def attack(
    name: str, count: int, seed: int, folder: Path, keep: Path | None = None
) -> tuple[dict[str, Any], list[str]]:
    """Give a reader hostile and mutated files; return its table row, and its faults in words.

    name: of the reader. folder: an empty one to work in. keep: where to copy files that failed.
    """
    reader, outcomes = READERS[name], list[Outcome]()
    (folder / "whole").mkdir()
    reader.make(folder / "whole")
    (folder / "hostile").mkdir()
    for number, content in enumerate(reader.hostile[:count]):
        made = content() if callable(content) else content
        (folder / f"hostile/{number}").write_bytes(made)
    faults, peak, slowest = list[str](), 0, 0.0
    while len(outcomes) < count:
        found, killed_by, memory = _run_child(reader, folder, len(outcomes), count, seed)
        peak = max(peak, memory)
        if killed_by:
            kind = "slow" if killed_by == signal.SIGPROF else "crash"
            found = [*found, Outcome(kind, signal.Signals(killed_by).name)]
        for outcome in found:
            slowest = max(slowest, outcome.seconds)
            if outcome.kind not in ("result", "message"):
                number = len(outcomes)
                faults.append(f"{name} {number}: {outcome.kind} {outcome.details}")
                if keep is not None:
                    _write_case(reader, folder, number, seed)
                    place = keep / f"{name.replace(' ', '_')}_{number}"
                    shutil.copytree(folder / "case", place, dirs_exist_ok=True)
            outcomes.append(outcome)
    kinds = Counter(outcome.kind for outcome in outcomes)
    row = {
        "reader": name, "files": len(outcomes), "results": kinds.pop("result", 0),
        "messages": kinds.pop("message", 0), "faults": sum(kinds.values()),
        "slowest_s": round(slowest, 2), "memory_mib": peak >> 20,
    }  # fmt: skip
    return row, faults


def _run_child(
    reader: Reader, folder: Path, first: int, count: int, seed: int
) -> tuple[list[Outcome], int, int]:
    """Read the files from number `first` in a child process, until it has read all, or dies.

    Return the outcomes, the number of the signal that killed it, 0 = none, and the most bytes of
    memory that it had more than at its beginning.
    """
    read_end, write_end = os.pipe()
    child = os.fork()
    if not child:
        os.close(read_end)
        with os.fdopen(write_end, "w") as pipe:
            try:
                _read_cases(reader, folder, range(first, count), seed, pipe)
            except BaseException:
                traceback.print_exc()
                os._exit(1)
        os._exit(0)
    os.close(write_end)
    with os.fdopen(read_end) as pipe:
        lines = [json.loads(line) for line in pipe]
    _, status, usage = os.wait4(child, 0)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status):
        raise RuntimeError(f"the child of {reader} has failed")
    start = lines[0]["memory"] if lines else 0
    outcomes = [Outcome(**line) for line in lines[1:]]
    killed_by = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    return outcomes, killed_by, max(0, usage.ru_maxrss * 1024 - start)


def _read_cases(reader: Reader, folder: Path, numbers: range, seed: int, pipe: Any) -> None:
    """Read mutated files with limits of memory and time; write each outcome as a line of JSON."""
    ran: list[str] = []
    is_watching = False

    def listen(event: str, arguments: tuple[Any, ...]) -> None:
        """Note what a file runs; called by Python itself."""
        if is_watching and event in RUNS and not _is_own_process(sys._getframe(1)):
            ran.append(f"{event}{arguments!r:.200}")

    sys.addaudithook(listen)
    os.chdir(folder)
    reader.read(folder / "whole")  # libraries are imported, processes of theirs run
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)  # libraries complain of each damaged file
    gc.collect()
    gc.freeze()
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resident = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    resource.setrlimit(resource.RLIMIT_AS, (size + MOST_MEMORY, size + MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    pipe.write(json.dumps({"memory": resident}) + "\n")
    for number in numbers:
        _write_case(reader, folder, number, seed)
        pipe.flush()
        begin = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, MOST_SECONDS)
        is_watching = True
        try:
            reader.read(folder / "case")
            kind, details = "result", ""
        except FinloopError as error:
            kind, details = _judge_message(error)
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            kind, details = "traceback", f"{type(error).__name__} {error!s:.300} ({where})"
        is_watching = False
        gc.collect()  # what an error still refers to
        signal.setitimer(signal.ITIMER_PROF, 0)
        if (folder / CANARY).exists():
            ran.append(CANARY)
        if ran:
            kind, details = "ran", ", ".join(ran)
            ran.clear()
        seconds = time.process_time() - begin
        pipe.write(json.dumps({"kind": kind, "details": details, "seconds": seconds}) + "\n")


def _is_own_process(frame: FrameType | None) -> bool:
    """Return whether finloop starts or hears its own process, in a frame or in its callers."""
    while frame is not None:
        if frame.f_code.co_filename == limited_process.__file__:
            return True
        frame = frame.f_back
    return False


def _judge_message(error: FinloopError) -> tuple[str, str]:
    """Return the kind of outcome that an error is: a message, or why it is none."""
    text = str(error)
    if not (error.came and error.wanted and error.do):
        return "bad message", f"an empty part: {text!r:.300}"
    if len(text) > MOST_LETTERS:
        return "bad message", f"{len(text)} letters: {text!r:.300}"
    if any(not (letter.isprintable() or letter == "\n") for letter in text):
        return "bad message", f"it steers the terminal: {text!r:.300}"
    return "message", ""


def _write_case(reader: Reader, folder: Path, number: int, seed: int) -> None:
    """Write the files of one case into the folder `case`: hostile ones first, then mutated ones."""
    case = folder / "case"
    shutil.rmtree(case, ignore_errors=True)
    shutil.copytree(folder / "whole", case)
    path = case / reader.target
    if number < len(reader.hostile):
        shutil.copyfile(folder / f"hostile/{number}", path)
    else:
        path.write_bytes(mutate(path.read_bytes(), (seed, number), reader.repair))


def attack_all(
    names: Sequence[str], count: int, seed: int, keep: Path | None = None
) -> Iterator[tuple[dict[str, Any], list[str]]]:
    """Yield the row and the faults of each reader."""
    for name in names:
        with TemporaryDirectory() as folder:
            yield attack(name, count, seed, Path(folder), keep)


def _call_inside(_: object, function: Callable[[Any], Any], argument: Any) -> Any:
    """Return function(argument), called in this process."""
    return function(argument)


def main() -> None:
    """Attack the readers; print and write the table; exit with 1 if one has a fault."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fault_files", description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[], choices=[*READERS], metavar="READER")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--mutated", action="store_true", help="leave the hostile files out")
    parser.add_argument("--inside", action="store_true", help="start no process for each HDF5")
    options = parser.parse_args()
    if options.mutated:
        READERS.update({name: replace(reader, hostile=()) for name, reader in READERS.items()})
    if options.inside:
        setattr(limited_process.LimitedProcess, "call", _call_inside)  # noqa: B010
    rows, faults = list[dict[str, Any]](), list[str]()
    names = options.only or [*READERS]
    for row, found in attack_all(names, options.count, options.seed, options.keep):
        rows.append(row)
        faults += found
        print(json.dumps(row), *found[:20], sep="\n  ", file=sys.stderr, flush=True)
    if options.only:
        print(pd.DataFrame(rows).to_string(index=False))
    else:
        write_table(__file__, pd.DataFrame(rows))
    sys.exit(min(1, len(faults)))


if __name__ == "__main__":
    main()
