"""Call functions in a process of their own, which ends where it takes too much time or memory.

A file may come from anybody, and a library that reads it may take hours over a small one. The
process is started once and then waits for further calls. It is a new one and no copy of this one:
a copy of a process whose libraries run threads may hang.
"""

import atexit
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, TypeVar

A = TypeVar("A")
B = TypeVar("B")

_SERVE = "from finloop.base.limited_process import serve_calls; serve_calls()"
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_BUSY = 6  # times as long as the limit that a busy machine may take


class LimitExceededError(Exception):
    """Error of a call that took too much time or memory, or ended its process."""


class LimitedProcess:
    """A process that calls functions, one after another; it is started by the first call.

    seconds: of the processor that a call may take, rounded up, where the system counts them; else,
    and on a busy machine, six times as many by the clock. mebibytes: memory of the process.
    """

    def __init__(self, seconds: int, mebibytes: int) -> None:
        """Keep the limits; nothing runs yet."""
        self._limits = seconds, mebibytes
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._owner = 0  # number of the process that has started it
        atexit.register(self.close)

    def call(self, function: Callable[[A], B], argument: A) -> B:
        """Return function(argument), or raise its exception; function: of a module, by its name.

        LimitExceededError if it takes too much time or memory.
        """
        folder = Path.cwd()  # which may have changed since the process began
        with self._lock:
            process = self._running_process()
            timer = threading.Timer(_BUSY * (self._limits[0] + 1), process.kill)
            timer.start()
            try:
                assert process.stdin is not None and process.stdout is not None
                _send(process.stdin, (folder, function, argument))
                is_error, result = pickle.load(process.stdout)  # from our own program
            except (EOFError, OSError, pickle.UnpicklingError) as error:
                self.close()
                raise LimitExceededError from error
            except BaseException:  # Ctrl-C: the answer is still to come, and nobody waits for it
                self.close()
                raise
            finally:
                timer.cancel()
        if is_error:
            raise result
        answer: B = result
        return answer

    def close(self) -> None:
        """End the process if it runs; a later call starts another."""
        process, self._process = self._process, None
        if process is not None and self._owner == os.getpid():
            process.kill()
            for pipe in (process.stdin, process.stdout):
                assert pipe is not None
                with suppress(OSError):
                    pipe.close()
            process.wait()

    def _running_process(self) -> subprocess.Popen[bytes]:
        """Return the process; start it if this program has none, as one that was forked."""
        if self._process is None or self._owner != os.getpid():
            # It finds the same modules as this program, and none beside them (-P).
            paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", _SERVE],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **_ONE_THREAD, "PYTHONPATH": paths},
            )
            self._owner = os.getpid()
            assert self._process.stdin is not None
            _send(self._process.stdin, self._limits)
        return self._process


def _send(file: IO[bytes], value: object) -> None:
    """Write a value to a pipe."""
    pickle.dump(value, file)
    file.flush()


def serve_calls() -> None:
    """Call the functions that arrive at the standard input, until it is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the program's
    received = sys.stdin.buffer
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a function prints is no answer, and nobody reads it
    seconds, mebibytes = pickle.load(received)
    with suppress(ValueError, OSError):
        _limit_memory(mebibytes)
    while True:
        try:
            folder, function, argument = pickle.load(received)
        except EOFError:
            return
        os.chdir(folder)
        _limit_seconds(seconds)
        try:
            answer = pickle.dumps((False, function(argument)))
        except MemoryError:
            return
        except Exception as error:
            answer = pickle.dumps((True, error))
        answers.write(answer)
        answers.flush()


def _limit_memory(mebibytes: int) -> None:
    """Limit the memory of this process, where the system can."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (mebibytes * 2**20,) * 2)


def _limit_seconds(seconds: int) -> None:
    """Let the system end this process after further seconds of the processor, where it can."""
    if sys.platform != "win32":
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        most = int(used.ru_utime + used.ru_stime) + 1 + seconds
        resource.setrlimit(resource.RLIMIT_CPU, (most, resource.RLIM_INFINITY))
