"""Start stages by forking a process that has imported them: `python -m stages.forks` is its server.

In a run on a tiny film, stages work for 2 s and import for 6 s. In each clone of a sweep or study,
a server imports the module of a stage when the stage first starts, and when it has run, what it has
imported meanwhile. DVC starts every stage as always; `stages.run`, the stage's first import, hands
the rest of the stage to the server. The server forks itself. Its child has the command's output,
environment and exit status, and ends when the command ends.
"""

from stages.run import STAGE_SOCKET, print_error  # isort: skip  (before numpy)

import gc
import importlib
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from select import select
from threading import Thread

from finloop.base.process import die_with_parent

READY = "ready\n"  # what the server prints when it takes commands
COMMAND_S = 10.0  # within which a command says what it is
LONGEST_LIST = 1 << 20  # bytes of a list of modules


@contextmanager
def open_stage_server(folder: Path) -> Iterator[None]:
    """Let a server start the stages of a folder in less time; do nothing on other systems.

    Only Linux forks a process safely whose libraries have threads that wait.
    """
    if sys.platform != "linux":
        yield
        return
    (folder / STAGE_SOCKET).parent.mkdir(parents=True, exist_ok=True)
    (folder / STAGE_SOCKET).unlink(missing_ok=True)
    with subprocess.Popen(
        [sys.executable, "-m", "stages.forks"], cwd=folder, text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    ) as server:  # fmt: skip
        try:
            assert server.stdout is not None
            server.stdout.readline()  # READY; empty if there is no server: stages start without it
            yield
        finally:
            server.kill()
            (folder / STAGE_SOCKET).unlink(missing_ok=True)


def _serve() -> tuple[str, socket.socket, socket.socket]:
    """Fork a child for each command; return in children alone.

    The result is the command's module, its connection, and a socket to the server, which imports
    the modules that are sent there. A child has the standard streams, the arguments and the
    environment of its command, and what imports have changed in the environment.
    """
    environment_before = dict(os.environ)
    from_children, to_server = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(STAGE_SOCKET))
        listener.listen()
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # no child stays as a zombie
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # its children handle Ctrl-C, and need it
        print(READY, end="", flush=True)
        while True:
            if from_children in select([listener, from_children], [], [])[0]:
                _import_modules(json.loads(from_children.recv(LONGEST_LIST)))
                continue
            connection, _ = listener.accept()
            streams: list[int] = []
            try:
                connection.settimeout(COMMAND_S)
                streams = socket.recv_fds(connection, 1, 3)[1]
                with connection.makefile() as text:
                    module, arguments, environment = json.loads(text.readline())
            except (OSError, ValueError):  # the command ended before it said what it is
                for stream in (*streams, connection.detach()):
                    os.close(stream)
                continue
            _import_modules([module])
            gc.freeze()  # a child's collector examines none of what is imported
            is_child = os.fork() == 0
            for number, stream in enumerate(streams):
                if is_child:
                    os.dup2(stream, number)
                os.close(stream)
            if is_child:
                sys.modules.pop(module, None)  # it runs as `__main__`
                sys.argv[1:] = arguments
                changed = set(os.environ.items()) - set(environment_before.items())
                os.environ.clear()
                os.environ.update(environment | dict(changed))
                return module, connection, to_server
            connection.close()


def _import_modules(names: Iterable[str]) -> None:
    """Import modules; leave out those that fail: a child raises the error again."""
    for name in names:
        with suppress(Exception):
            importlib.import_module(name)


def _end_with_command(connection: socket.socket) -> None:
    """Wait until the command at the other end of a connection ends; then end this process."""
    with suppress(OSError):  # it has ended before it read that the module begins
        connection.recv(1)
    os._exit(1)


def main() -> None:
    """Serve the present folder; in a forked child, run a module as `python -m` does.

    The child sends its command a byte when it begins, then the exit status, and closes the
    connection when it ends.
    """
    die_with_parent()
    gc.disable()
    # PyTorch imports Triton, whose LLVM and that of a renderer cannot share a process: no stage
    # loads both, but the server would.
    sys.modules.setdefault("triton", None)  # type: ignore[arg-type]
    module, connection, server = _serve()
    die_with_parent()
    loaded = {*sys.modules, module}
    gc.enable()
    connection.settimeout(None)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # else it learns no status of its own children
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with suppress(OSError):  # its command has ended
        connection.send(b"\n")  # the module begins
    Thread(target=_end_with_command, args=(connection,), daemon=True).start()
    status: object = 1
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
        status = 0
    except SystemExit as end:
        status = end.code
    except BaseException as error:
        print_error(type(error), error, error.__traceback__)
    if isinstance(status, str):
        print(status, file=sys.stderr)
    number = status if isinstance(status, int) else int(status is not None)
    with suppress(OSError):  # the server has ended
        server.send(json.dumps([name for name in sys.modules if name not in loaded]).encode())
    connection.send(bytes([number % 256]))
    sys.exit(number)


if __name__ == "__main__":
    main()
