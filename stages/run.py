"""Run a stage: fix its threads, end it with its parent, turn errors into messages, show progress.

A stage is a module `stages/<word>.py` of this shape; `stages.run` is its first import because the
thread counts must be set before numpy is imported::

    from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

    from finloop.extract.film import ...
    from finloop.extract.settings import ExtractSettings
    from stages.settings import load_settings

    def main() -> None:
        p: ExtractSettings = load_settings("extract")  # as conf/extract/ was composed
        with report_progress("extract", total=frames) as advance:
            ...
            advance()  # one more; advance(30): thirty more
        save_metrics(Path("reports/extract/metrics.json"), {"tracks": 8, "noise_grey": 1.25})

    if __name__ == "__main__":
        run(main)

DVC runs a stage in the repository's root, so a stage's paths are relative to that.
"""

import contextlib
import gc
import importlib.util
import json
import math
import os
import shutil
import signal
import socket
import sys
import time
import webbrowser
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from numbers import Integral, Real
from pathlib import Path
from types import TracebackType
from typing import NoReturn

from finloop.base.digits import round_significant
from finloop.base.errors import FinloopError, user_error
from finloop.base.finding import FINDINGS_NAME, Finding
from finloop.base.process import die_with_parent
from finloop.base.program import HOME, describe_program, holds_sources

THREAD_VARIABLES = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENCV_FOR_THREADS_NUM",
)  # fmt: skip
LINE_EVERY_S = 10.0  # progress where there is no terminal to draw a bar on
# Where a stage server takes commands, of its own Python alone: another one may have other packages.
STAGE_SOCKET = Path(f".dvc/tmp/stages-{zlib.crc32(os.fsencode(sys.prefix)):08x}.socket")


def _hand_over() -> None:
    """Let the stage server of this folder run the present command, and end with its exit status.

    Do nothing without a server (`stages.forks`), or if no `python -m` has started this process.
    """
    module = sys.modules["__main__"].__spec__
    if module is None or not STAGE_SOCKET.exists():
        return
    command = json.dumps([module.name, sys.argv[1:], dict(os.environ)])
    status = b""
    with socket.socket(socket.AF_UNIX) as server:
        try:
            server.connect(str(STAGE_SOCKET))
            die_with_parent()
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C: no traceback
            socket.send_fds(server, [b"\n"], [0, 1, 2])
            server.sendall(f"{command}\n".encode())
            if not server.recv(1):  # the server has ended, and the module has not begun
                return
        except OSError:  # a killed sweep has left the socket
            return
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # from now on the module's process handles it
        with contextlib.suppress(OSError):
            while received := server.recv(1):  # closed when the process of the module has ended
                status = received
    if not status:
        error = FinloopError(
            f"{module.name} was ended from outside, perhaps for lack of memory",
            "memory for a few frames and the tables",
            "close other programs, and give the command again",
        )
        print(f"finloop: {error}", file=sys.stderr)
    os._exit(status[0] if status else 1)


def _limit_threads() -> None:
    """Let each numerical library use two threads, or FINLOOP_THREADS.

    The number is fixed, not the machine's: results differ in their last bits between thread counts.
    """
    for variable in THREAD_VARIABLES:
        os.environ.setdefault(variable, os.environ.get("FINLOOP_THREADS", "2"))


def _copy_machine_code() -> None:
    """Copy compiled functions from the repository into a temporary experiment's folder.

    Such an experiment is a copy of the repository without them. Compiling them again takes ten
    seconds. `base.kernel` checks that the sources are equal.
    """
    root = Path(os.environ.get("DVC_ROOT", "."))  # the repository
    if root.resolve() == Path.cwd():
        return
    for compiled in root.glob("finloop/**/__pycache__/*.nb[ic]"):
        copy = compiled.relative_to(root)
        if not copy.exists():
            copy.parent.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(OSError):  # another stage may be replacing it
                shutil.copyfile(compiled, copy)


def _require_packages() -> None:
    """End the program with a message if the present Python lacks the packages of the project."""
    missing = [name for name in ("cv2", "numpy", "pydantic") if not importlib.util.find_spec(name)]
    if missing:
        error = FinloopError(
            f"{sys.executable} lacks {', '.join(missing)}",
            "the environment from `make setup`, first on PATH",
            "make repro; or: source .venv/bin/activate, then call dvc again",
        )
        sys.exit(f"finloop: {error}")


_limit_threads()
_hand_over()
THREADS = int(os.environ["OMP_NUM_THREADS"])  # processes that a stage may work on, too
PROCESSES = "FINLOOP_PROCESSES"  # how many processes a stage works on, where that is not THREADS
if "DVC_STAGE" in os.environ:  # started by DVC, not by hand or in a test
    # dvc.yaml's commands begin with `exec`, so that the parent is DVC itself and no shell between:
    # else the stage of a killed `dvc repro` runs on beside that of the next one.
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C amid the imports: no traceback
    gc.disable()  # amid the imports, a third of their time; `run` enables it
    _copy_machine_code()
_require_packages()


def _require_own_program() -> None:
    """Raise FinloopError if the present folder has finloop's sources, but another finloop runs.

    `python -m` takes the present folder's finloop, unless Python is told not to look there.
    """
    if holds_sources(Path.cwd()) and Path.cwd().resolve() != HOME:
        raise FinloopError(
            f"{describe_program()}, runs in the working copy {Path.cwd()}",
            "the finloop of this working copy",
            "unset PYTHONSAFEPATH, and call python without -P and -I",
        )


def run(main: Callable[[], None]) -> NoReturn:
    """Run a stage's `main`, report errors, and end the process with an exit status.

    An error gives one message on stderr. Only an unforeseen exception shows its traceback, too.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    gc.freeze()  # imported objects stay: the collector never examines them
    gc.enable()  # it was off during the imports
    try:
        _require_own_program()
        _require_output_places()
        main()
        _note_origins()
    except KeyboardInterrupt:
        print("\nfinloop: interrupted; the same command goes on from here", file=sys.stderr)
        sys.exit(130)
    except Exception as error:
        print_error(type(error), error, error.__traceback__)
        sys.exit(1)
    sys.exit(0)


def print_error(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print an error's message on stderr; of an unforeseen exception its traceback, too.

    It takes what `sys.excepthook` takes, and stands there: so it also reports what the imports of a
    stage raise.
    """
    message = user_error(error) if isinstance(error, Exception) else None
    if message is None:
        sys.__excepthook__(kind, error, trace)
        if not isinstance(error, Exception):
            return
        message = FinloopError(
            f"an error in the program itself: {type(error).__name__}: {error}",
            "no error, or a message with a remedy",
            "report it, with the traceback above",
        )
    print(f"finloop: {message}", file=sys.stderr)


def _stage_name() -> str:
    """Return the name in dvc.yaml of the module that `python -m` runs; "" for another program."""
    module = sys.modules["__main__"].__spec__  # None unless started by `python -m`
    return module.name.removeprefix("stages.").replace(".", "-") if module else ""


def _require_output_places() -> None:
    """Raise FinloopError if an output of the present stage could not be written, or is a link.

    Otherwise the stage or DVC, which takes no link, would say so after the work.
    """
    if name := _stage_name():
        from finloop.io.atomic import require_output_place
        from stages.origins import output_paths, read_stages  # not at the top: they need YAML

        for path in output_paths(read_stages().get(name, {})):
            require_output_place(Path(path))


def _note_origins() -> None:
    """Write into a stage's folder what it was made from; do nothing if no stage runs."""
    if name := _stage_name():
        from stages.origins import note_origins  # not at the top: it needs the right Python

        note_origins(name)


def open_in_browser(url: str) -> None:
    """Open a page if there is a desktop; else do nothing.

    Without a desktop a text browser would take over the terminal.
    """
    screens = map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))
    if sys.platform in ("darwin", "win32") or any(screens):
        webbrowser.open(url)


@contextmanager
def report_progress(
    stage: str, total: int | None, unit: str = "frames"
) -> Iterator[Callable[..., None]]:
    """Yield `advance(n=1)`, to call when n more items are done; progress is shown on stderr.

    stage: the name to show. total: the number of items to come, None where it is unknown. unit:
    what the items are, in the plural. A terminal shows a bar; else a line is printed at times.
    """
    open_report = _progress_bar if sys.stderr.isatty() else _progress_lines
    with open_report(stage, total, unit) as advance:
        yield advance


@contextmanager
def _progress_bar(stage: str, total: int | None, unit: str) -> Iterator[Callable[..., None]]:
    """Yield `advance(n=1)`, which moves a progress bar on a terminal."""
    from rich import progress as bars
    from rich.console import Console

    columns = (
        "{task.description}", bars.BarColumn(), bars.MofNCompleteColumn(), unit,
        bars.TimeElapsedColumn(), "left", bars.TimeRemainingColumn(),
    )  # fmt: skip
    with bars.Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(f"{stage:<8}", total=total)
        yield lambda n=1: bar.advance(task, n)


@contextmanager
def _progress_lines(stage: str, total: int | None, unit: str) -> Iterator[Callable[..., None]]:
    """Yield `advance(n=1)`, which prints a line of progress at most every `LINE_EVERY_S` seconds.

    A last line is printed when the block ends.
    """
    start_s = last_line_s = time.monotonic()
    done = done_at_last_line = 0

    def write_line(time_left: str = "") -> None:
        """Print how many items are done, and the time since the beginning."""
        of_total = f" of {total}" if total else ""
        elapsed = f"{time.monotonic() - start_s:.0f} s"
        print(f"{stage}: {done}{of_total} {unit}, {elapsed}{time_left}", file=sys.stderr)

    def advance(n: int = 1) -> None:
        """Count n more items; print a line if the last one is old enough."""
        nonlocal done, last_line_s, done_at_last_line
        done += n
        now_s = time.monotonic()
        if now_s - last_line_s >= LINE_EVERY_S:
            # The rate since the last line: earlier items may have been kept results, done at once.
            item_s = (now_s - last_line_s) / max(1, done - done_at_last_line)
            write_line(f", {item_s * max(0, total - done):.0f} s left" if total else "")
            last_line_s, done_at_last_line = now_s, done

    yield advance
    write_line()


def report_findings(folder: Path, findings: Mapping[str, Iterable[Finding]]) -> None:
    """Write findings on films to findings.csv in `folder`, and print them on stderr.

    findings: by the film's name, which is "" for a single film.
    """
    import pandas as pd

    from finloop.io.table import save_csv

    rows = []
    for film, found in findings.items():
        for finding in found:
            rows.append({"film": film} | finding.table_row)
            print(f"finloop: {film and film + ': '}{finding.terminal_line}", file=sys.stderr)
    columns = Finding(word="", good=True, text="").table_row  # also where nothing was found
    table = pd.DataFrame(rows, columns=["film", *columns])
    if set(findings) == {""}:
        table = table.drop(columns="film")
    save_csv(folder / FINDINGS_NAME, table, decimals=0)


def save_metrics(path: Path, numbers: Mapping[str, float | int | None]) -> None:
    """Write finite numbers to reports/<stage>/metrics.json, sorted and rounded.

    METRICS names, by the name of the folder, the headline numbers, which stand at the top. None,
    NaN and infinity are left out: such a number does not exist for this clip (no truth, no fish
    long enough). TypeError for what is no number.
    """
    # Not at the top: they need the right Python.
    from finloop.io.numbers import save_numbers
    from finloop.report.headlines import METRICS

    values: dict[str, float | int] = {}
    for name, value in sorted(numbers.items()):
        if isinstance(value, Integral):
            values[name] = int(value)
        elif isinstance(value, Real) and math.isfinite(value):
            values[name] = round_significant(float(value))
        elif not (value is None or isinstance(value, Real)):
            raise TypeError(f"metric {name} must be a number, got {value!r}")
    save_numbers(path.parent, values, METRICS.get(path.parent.name, []))


sys.excepthook = print_error
