"""What tests/test_parallel.py has worker processes do; they import this alone, which is quick."""

import gc
import os
import signal

from finloop.base.errors import FinloopError


def square(number):
    return number**2


def after_the_next(job):
    """Even items end after the odd ones that follow them: two processes work at a time.

    Each pair has a pipe in the folder, named like the even one, which waits for a writer's end.
    """
    folder, number = job
    pipe = folder / str(number - number % 2)
    if number % 2:
        pipe.write_text("done")
    else:
        assert pipe.read_text() == "done"
    return number, os.getpid()


def fails_at_five(number):
    if number == 5:
        raise FinloopError("five came", "another number", "take another")
    return number


def note_job(job):
    folder, number = job
    (folder / str(number)).touch()
    return number


def collects_garbage(number):
    gc.collect()
    return number


def is_killed(number):
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def is_killed_once(job):
    folder, number = job
    if number == 3 and not (folder / "killed").exists():
        (folder / "killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def cannot_read_once(job):
    folder, number = job
    if number == 3 and not (folder / "failed").exists():
        (folder / "failed").touch()
        raise OSError("the network is away")
    return number


def cannot_read(job):
    folder, number = job
    if number == 0:
        (folder / f"tried-{len(list(folder.glob('tried-*')))}").touch()
        raise FileNotFoundError(folder / "film")
    return number


def notes_itself_and_waits(pipe):
    """Leave the number of this process beside a pipe, and wait for somebody to write."""
    pipe.with_suffix(".pid").write_text(str(os.getpid()))
    return pipe.read_text()


def waits(pipe):
    """Until somebody opens the pipe to write."""
    return pipe.read_text()
