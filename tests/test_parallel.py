"""Work on several processes: the order of results, errors, and that nothing is left hanging."""

import errno
import gc
import multiprocessing
import os
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from fractions import Fraction

import cv2
import numpy as np
import psutil
import pytest
from conftest import PATIENCE_S, ROOT, wait_for
from jobs import (
    after_the_next,
    cannot_read,
    cannot_read_once,
    collects_garbage,
    fails_at_five,
    is_killed,
    is_killed_once,
    note_job,
    square,
)

from finloop.base import parallel
from finloop.base.errors import FinloopError
from finloop.base.parallel import Processes, Threads, ordered_map, prefetch, start_fork_server
from finloop.io.movie import VideoWriter
from finloop.io.video import read_frames


@pytest.fixture(scope="module", autouse=True)
def quick_to_start():
    """Processes are forked from one that has imported their work."""
    start_fork_server(["jobs", parallel.__name__])


@pytest.fixture(autouse=True)
def no_hanging():
    """Kill worker processes that do not end by themselves."""

    def kill(*_):
        for process in multiprocessing.active_children():
            process.kill()

    before = signal.signal(signal.SIGALRM, kill)
    signal.alarm(30)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("workers", [1, 2, 3])
@pytest.mark.parametrize("kind", [Processes, Threads])
def test_each_item_is_worked_once(kind, workers):
    assert list(ordered_map(square, range(12), kind(workers))) == [k**2 for k in range(12)]
    assert list(ordered_map(square, [], kind(workers))) == []
    assert list(ordered_map(square, [3], kind(workers))) == [9]


@pytest.mark.parametrize("workers", [2, 3])
def test_results_come_in_order_and_not_as_they_end(workers, tmp_path):
    for even in range(0, 12, 2):
        os.mkfifo(tmp_path / str(even))
    jobs = [(tmp_path, number) for number in range(12)]
    results = list(ordered_map(after_the_next, jobs, Processes(workers)))
    assert [number for number, _ in results] == list(range(12))
    places = {place for _, place in results}
    assert len(places) >= 2 and os.getpid() not in places


def test_threads_work_at_a_time_in_this_process(tmp_path):
    for even in range(0, 12, 2):
        os.mkfifo(tmp_path / str(even))
    before = cv2.getNumThreads()
    results = ordered_map(after_the_next, [(tmp_path, k) for k in range(12)], Threads(2))
    assert [(next(results), cv2.getNumThreads()) for _ in range(6)] == [
        ((number, os.getpid()), 1) for number in range(6)
    ]
    assert [number for number, _ in results] == list(range(6, 12))
    assert cv2.getNumThreads() == before


@pytest.mark.parametrize("workers", [Processes(1), Processes(2), Threads(2)], ids=str)
def test_an_error_in_a_worker_is_the_same_error_here(workers):
    results = ordered_map(fails_at_five, range(40), workers)
    assert [next(results) for _ in range(5)] == [0, 1, 2, 3, 4]
    with pytest.raises(FinloopError) as caught:
        next(results)
    assert (caught.value.came, caught.value.do) == ("five came", "take another")


class Counted:
    """Workers that count what they are given."""

    def __init__(self, workers):
        self.workers, self.submitted = workers, 0
        self.count, self.is_alone = workers.count, workers.is_alone

    @contextmanager
    def open_submitter(self, work):
        with self.workers.open_submitter(work) as submit:

            def submit_and_count(item):
                self.submitted += 1
                return submit(item)

            yield submit_and_count


@pytest.mark.parametrize("workers", [Processes(1), Processes(2), Threads(2)], ids=str)
def test_no_more_is_worked_ahead_than_a_result_for_each_worker(workers, tmp_path):
    counted = Counted(workers)
    results = ordered_map(note_job, ((tmp_path, number) for number in range(60)), counted)
    for taken in range(1, 9):
        next(results)
        if workers.is_alone:
            assert len(list(tmp_path.iterdir())) == taken
        else:
            assert taken < counted.submitted <= taken + workers.count + 1


EMPLOYER = """
from pathlib import Path
import dear
from finloop.base.parallel import Processes, ordered_map, start_fork_server
from jobs import notes_itself_and_waits
if __name__ == "__main__":
    start_fork_server(["jobs"])
    list(ordered_map(notes_itself_and_waits, [Path("a"), Path("b")], Processes(2)))
"""


def test_workers_take_over_imports_and_end_with_who_employs_them(tmp_path):
    """By kill -9, which leaves it no time to say so."""
    notes = [tmp_path / "a.pid", tmp_path / "b.pid"]
    for note in notes:
        os.mkfifo(note.with_suffix(""))
    (tmp_path / "employer.py").write_text(EMPLOYER)
    (tmp_path / "dear.py").write_text("import os\nos.mkdir(f'imported by {os.getpid()}')\n")
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    employer = subprocess.Popen(
        [sys.executable, "-W", "error", "-m", "employer"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert wait_for(lambda: all(note.exists() and note.read_text() for note in notes))
    workers = [psutil.Process(int(note.read_text())) for note in notes]
    assert len(list(tmp_path.glob("imported by *"))) == 2  # by the employer, and by the server
    employer.kill()
    employer.wait()
    assert not psutil.wait_procs(workers, PATIENCE_S)[1]


def test_who_stops_early_does_not_wait_for_the_rest(tmp_path):
    results = ordered_map(note_job, [(tmp_path, number) for number in range(500)], Processes(2))
    next(results)
    results.close()
    assert len(list(tmp_path.iterdir())) <= 4
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("garbage", [False, True])
def test_workers_do_not_free_what_their_parent_opened(tmp_path, garbage):
    # A decoder has threads, which a forked process lacks: to free it there waits for ever.
    with VideoWriter(tmp_path / "c.mp4", 64, 48, Fraction(25)) as writer:
        for level in range(24):
            writer.write(np.full((48, 64), 9 * level, np.uint8))
    gc.disable()
    try:
        frames = read_frames(tmp_path / "c.mp4", threads=2)
        next(frames)
        cycle: list[object] = [frames]
        cycle.append(cycle)
        if garbage:
            del frames, cycle
        assert list(ordered_map(collects_garbage, range(6), Processes(2))) == list(range(6))
    finally:
        gc.enable()


def test_what_a_killed_worker_held_is_done_again(tmp_path):
    jobs = [(tmp_path, number) for number in range(6)]
    squares = [number**2 for number in range(6)]
    assert list(ordered_map(is_killed_once, jobs, Processes(2))) == squares
    assert (tmp_path / "killed").exists()


def test_a_worker_that_is_killed_again_and_again_is_one_message(monkeypatch):
    monkeypatch.setattr(parallel, "TRIES", 2)
    with pytest.raises(FinloopError, match="worker") as caught:
        list(ordered_map(is_killed, range(9), Processes(2)))
    assert "FINLOOP_THREADS=1" in caught.value.do


@pytest.mark.parametrize(
    "error", [OSError("handle is closed"), OSError(errno.EAGAIN, "no more processes")]
)
def test_a_pool_that_breaks_while_a_worker_starts_is_begun_anew(error, monkeypatch):
    submit, errors = ProcessPoolExecutor.submit, [error]

    def breaks_once(pool, *job):
        if errors:
            raise errors.pop()
        return submit(pool, *job)

    monkeypatch.setattr(ProcessPoolExecutor, "submit", breaks_once)
    results = ordered_map(square, range(5), Processes(2))
    if error.errno is None:
        assert list(results) == [0, 1, 4, 9, 16]
    else:
        with pytest.raises(OSError, match="no more processes"):
            list(results)


@pytest.mark.parametrize("workers", [1, 2])
def test_what_gives_an_error_of_the_system_is_tried_again(workers, tmp_path, monkeypatch):
    monkeypatch.setattr(parallel, "_PAUSE_S", 0.0)
    jobs = [(tmp_path, number) for number in range(4)]
    assert list(ordered_map(cannot_read_once, jobs, Processes(workers))) == [0, 1, 2, 3]
    with pytest.raises(FileNotFoundError):
        list(ordered_map(cannot_read, jobs, Processes(workers)))
    assert len(list(tmp_path.glob("tried-*"))) == parallel.TRIES


def test_items_are_made_a_few_ahead_and_an_error_comes_after_the_items_before_it():
    made = []

    def items():
        for number in range(20):
            made.append(number)
            yield number
        raise KeyError("the last")

    got = []
    with pytest.raises(KeyError, match="the last"):
        for number in prefetch(items(), most=3):
            assert number <= len(made) - 1 <= number + 3
            got.append(number)
    assert got == made == list(range(20))


def test_the_kernels_that_workers_inherit_start_no_thread_of_opencv():
    """A fork loses threads, and a worker would wait for them for ever."""
    code = "import cv2, finloop.extract.ready; print(cv2.getNumThreads())"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.split() == ["1"]
