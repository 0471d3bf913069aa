"""The door of every stage: one message per error, progress, metrics, threads, an end with DVC."""

import errno
import json
import math
import os
import pty
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
from conftest import alive, wait_for

from finloop.base.errors import FinloopError
from finloop.base.settings import WORDS
from finloop.edit.modes import MODES
from finloop.io.numbers import load_numbers
from finloop.report.headlines import HEADLINES, METRICS
from stages import run as door

ROOT = Path(__file__).parents[1]


def fails(error: BaseException):
    def main() -> None:
        raise error

    return main


def run_to_exit(main, capsys) -> tuple[object, str]:
    """Exit status and what stderr shows (SystemExit's text is printed by the interpreter)."""
    with pytest.raises(SystemExit) as end:
        door.run(main)
    code, text = end.value.code, capsys.readouterr().err
    return (1, text + code) if isinstance(code, str) else (code, text)


def test_a_stage_that_returns_ends_well(capsys):
    assert run_to_exit(lambda: None, capsys) == (0, "")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (FinloopError("came", "a", "b"), "finloop: came\n  wanted: a\n  do:     b"),
        (MemoryError("Unable to allocate 9 GiB"), "out of memory (Unable to allocate 9 GiB)"),
        (MemoryError(), "out of memory\n"),
        (
            OSError(errno.ENOSPC, "No space left", "data/clip.mp4"),
            "data/clip.mp4: the disk is full",
        ),
        (OSError(errno.EDQUOT, "Quota exceeded"), "finloop: the disk is full"),
        (
            OSError(errno.EFBIG, "File too large", "data/jumps"),
            "data/jumps: the file would be larger",
        ),
        (OSError(errno.EROFS, "Read-only file system", "params.yaml"), "params.yaml: Read-only"),
        (OSError(errno.EACCES, "Permission denied", "data"), "data: Permission denied"),
        (FileExistsError(errno.EEXIST, "File exists", "data"), "data: File exists"),
        (FileNotFoundError(errno.ENOENT, "No such file", "fish.svg"), "fish.svg: No such file"),
        (OSError(errno.EMFILE, "Too many open files"), "finloop: Too many open files"),
        (OSError(errno.EIO, "Input/output error", "a", None, "b"), "b: Input/output error"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), "out of memory ([Errno 12] Cannot"),
        (RuntimeError("can't start new thread"), "out of memory (can't start new thread)"),
    ],
)
def test_a_foreseen_error_is_one_message(error, said, capsys):
    code, text = run_to_exit(fails(error), capsys)
    assert code == 1 and said in text and "Traceback" not in text


def test_a_full_disk_is_recognised_when_it_happens(capsys):
    def main() -> None:
        with Path("/dev/full").open("w") as file:
            file.write("x")

    assert "disk is full" in run_to_exit(main, capsys)[1]


def test_a_stage_does_not_begin_where_an_output_is_a_link(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(door, "_stage_name", lambda: "extract")
    Path("data").symlink_to("another disk")
    code, text = run_to_exit(fails(AssertionError("it begins")), capsys)
    assert code == 1 and text.startswith("finloop: data is a link to another disk")


def test_a_bug_keeps_its_traceback_and_is_named_last(capsys):
    code, text = run_to_exit(fails(ZeroDivisionError("1/0")), capsys)
    assert code == 1 and text.startswith("Traceback")
    named = "finloop: an error in the program itself: ZeroDivisionError: 1/0"
    assert text.splitlines()[-3].startswith(named)


def test_ctrl_c_is_not_an_error_in_the_program(capsys):
    code, text = run_to_exit(fails(KeyboardInterrupt()), capsys)
    assert code == 130 and "interrupted" in text and "Traceback" not in text


def test_progress_in_a_log_is_a_few_lines(monkeypatch, capsys):
    now = iter(np.arange(0, 1e6, 0.1))  # every look at the clock finds 0.1 s gone
    monkeypatch.setattr(door.time, "monotonic", lambda: next(now))
    with door.report_progress("extract", total=500) as advance:
        for _ in range(499):
            advance()
        advance(n=1)
    lines = capsys.readouterr().err.splitlines()
    assert 3 <= len(lines) <= 10
    assert lines[-1].startswith("extract: 500 of 500 frames, ")
    paces = [re.search(r"(\d+) of 500 .* (\d+) s left$", line) for line in lines[:-1]]
    for told in paces:  # at 0.1 s a frame
        assert told and float(told[2]) == pytest.approx((500 - int(told[1])) * 0.1, abs=1)


def test_progress_without_a_known_end(capsys):
    with door.report_progress("clip", total=None, unit="bytes") as advance:
        advance(3)
    assert capsys.readouterr().err == "clip: 3 bytes, 0 s\n"


def test_progress_on_a_terminal_is_a_bar():
    code = (
        "from stages.run import report_progress\n"
        "with report_progress('extract', total=3) as advance: [advance() for _ in range(3)]"
    )
    ours, theirs = pty.openpty()
    env = os.environ | {"COLUMNS": "100", "TERM": "xterm"}
    with subprocess.Popen([sys.executable, "-c", code], stderr=theirs, env=env, cwd=ROOT) as child:
        child.wait()
    os.close(theirs)
    shown = os.read(ours, 100_000).decode()
    os.close(ours)
    assert "3/3" in shown
    assert "━━━" in shown


def test_metrics_are_flat_sorted_and_short_and_metrics_json_has_those_to_compare(tmp_path):
    path = tmp_path / "reports/report/metrics.json"
    numbers = {"tracks": np.int64(8), "figures": 1 / 3, "a_deg": np.float32(2.5)}
    door.save_metrics(path, numbers | {"no_truth": None, "no_fish": math.nan, "none": math.inf})
    all_numbers = {"a_deg": 2.5, "figures": 0.3333, "tracks": 8}
    assert load_numbers(path.parent) == all_numbers
    # DVC takes the names at the top for metrics, and draws the list as a table.
    rows = [{"number": name, "value": value} for name, value in all_numbers.items()]
    assert json.loads(path.read_text()) == {"figures": 0.3333, "numbers": rows}
    assert len(path.read_text().splitlines()) == 8  # a line a number: a change is easy to read


def test_headlines_are_few_and_in_words():
    for word, headlines in HEADLINES.items():
        assert 1 <= len(headlines) <= max(12, 3 * len(MODES)) and len(
            {one.name for one in headlines}
        ) == len(headlines), word
        assert all(one.meaning and len(one.meaning) <= 80 for one in headlines)
    assert {*HEADLINES, *MODES, "cluster"} >= set(WORDS)


def test_what_dvc_compares_are_headlines_and_fits_one_screen():
    assert set(METRICS) == set(HEADLINES)
    for word, compared in METRICS.items():
        assert set(compared) <= {headline.name for headline in HEADLINES[word]}
    counts = {word: len(compared) for word, compared in METRICS.items()}
    assert max(counts.pop(word) for word in ("animate", "realism")) <= 3 * len(MODES)
    assert sum(counts.values()) <= 2 * len(counts)


def test_a_metric_is_a_number(tmp_path):
    with pytest.raises(TypeError, match="metric note must be a number, got 'x'"):
        door.save_metrics(tmp_path / "metrics.json", {"note": "x"})  # type: ignore[dict-item]


def in_stage(code: str, **env: str) -> subprocess.CompletedProcess[str]:
    threads = {*door.THREAD_VARIABLES, "FINLOOP_THREADS"}
    clean = {key: value for key, value in os.environ.items() if key not in threads}
    return subprocess.run(
        [sys.executable, "-c", code], env=clean | env, cwd=ROOT, capture_output=True, text=True
    )


def test_threads_are_set_before_numpy():
    code = (
        "import sys, os, stages.run as door\n"
        "print('numpy' in sys.modules, {os.environ[v] for v in door.THREAD_VARIABLES})"
    )
    assert in_stage(code).stdout == "False {'2'}\n"
    assert in_stage(code, FINLOOP_THREADS="3").stdout == "False {'3'}\n"


def test_a_python_without_the_packages_says_what_to_do():
    code = (
        "import importlib.util as util\n"
        "util.find_spec = lambda name: None if name == 'numpy' else object()\n"
        "import stages.run"
    )
    done = in_stage(code)
    assert done.returncode == 1 and "lacks numpy" in done.stderr and "make repro" in done.stderr


def test_a_temporary_experiment_brings_what_its_repository_has_compiled(tmp_path):
    compiled = "finloop/extract/__pycache__/backbone.trace-1.py311.nbi"
    repository, experiment = tmp_path / "repository", tmp_path / "experiment"
    (repository / compiled).parent.mkdir(parents=True)
    (repository / compiled).write_bytes(b"code")
    experiment.mkdir()
    env = {"PYTHONPATH": str(ROOT), "DVC_STAGE": "extract", "DVC_ROOT": str(repository)}
    for _ in range(2):  # the second time there is nothing to bring
        subprocess.run(
            [sys.executable, "-c", "import stages.run"],
            env=os.environ | env,
            cwd=experiment,
            check=True,
        )
        assert (experiment / compiled).read_bytes() == b"code"


@pytest.mark.skipif(sys.platform != "linux", reason="PR_SET_PDEATHSIG is Linux's")
@pytest.mark.parametrize("by_dvc", [True, False])
def test_a_stage_ends_with_dvc_however_dvc_ends(by_dvc):
    # 2: PR_GET_PDEATHSIG, the signal that comes when the parent ends, 0 for none
    stage = (
        "import stages.run, ctypes, signal\n"
        "number = ctypes.c_int()\n"
        "ctypes.CDLL(None).prctl(2, ctypes.byref(number))\n"
        "print(number.value, flush=True)\n"
        "signal.pause()"
    )
    parent_code = (
        "import subprocess, sys\n"
        f"child = subprocess.Popen([sys.executable, '-c', {stage!r}], stdout=subprocess.PIPE)\n"
        "print(int(child.stdout.readline()), child.pid, flush=True)\n"
        "child.wait()"
    )
    env = {key: value for key, value in os.environ.items() if key != "DVC_STAGE"}
    if by_dvc:
        env["DVC_STAGE"] = "extract"
    command = [sys.executable, "-c", parent_code]
    with subprocess.Popen(command, env=env, cwd=ROOT, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        end_signal, number = map(int, parent.stdout.readline().split())
        child = psutil.Process(number)
        parent.kill()
    assert end_signal == (signal.SIGKILL if by_dvc else 0)
    if not by_dvc:
        child.kill()
    assert wait_for(lambda: not alive(child))
