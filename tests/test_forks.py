"""A stage that a server has forked does what it does alone, and ends with its command."""

import json
import os
import signal
import socket
import subprocess
import sys
import venv
from pathlib import Path

import psutil
import pytest
from conftest import ROOT, alive, wait_for

from stages.forks import open_stage_server
from stages.run import STAGE_SOCKET

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the server is Linux's")
MODULE = """
from stages.run import run
import words.colour
import os, signal, sys, time
from finloop.base.errors import FinloopError

def main() -> None:
    print(os.getpid(), sys.argv[1:], os.environ["WORD"], flush=True)
    print("to stderr", file=sys.stderr)
    exec(sys.argv[1])

if __name__ == "__main__":
    run(main)
"""


def write_module(folder: Path) -> None:
    (folder / "words").mkdir()
    (folder / "words/__init__.py").touch()
    (folder / "words/colour.py").write_text("import os\nos.environ['OF_IMPORT'] = 'coral'\n")
    (folder / "words/speaker.py").write_text(MODULE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a module `words.speaker`, which a server starts."""
    folder = tmp_path_factory.mktemp("served")
    write_module(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT))
        with open_stage_server(folder):
            assert (folder / STAGE_SOCKET).is_socket()
            yield folder
    assert not (folder / STAGE_SOCKET).exists()


def open_command(folder: Path, code: str) -> subprocess.Popen[str]:
    """Start the module with this code."""
    return subprocess.Popen(
        [sys.executable, "-m", "words.speaker", code], cwd=folder, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT), "WORD": "sunfish"},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def start(folder: Path, code: str) -> tuple[subprocess.Popen[str], int, str]:
    """Start the module with this code; return the command, the process that runs it, a line."""
    command = open_command(folder, code)
    assert command.stdout is not None
    pid, _, line = command.stdout.readline().partition(" ")
    return command, int(pid), line


@pytest.mark.parametrize(
    "code",
    [
        "pass", "sys.exit(3)", "sys.exit('why')", "raise FinloopError('came', 'wanted', 'do')",
        "sys.exit(os.environ['OF_IMPORT'])", "import gc; sys.exit(str(gc.isenabled()))",
        "import subprocess; sys.exit(subprocess.run([sys.executable, '-c', 'exit(4)']).returncode)",
    ],
)  # fmt: skip
def test_a_forked_stage_does_what_it_does_alone(folder, tmp_path, code):
    write_module(tmp_path)
    ends = []
    for place in (folder, tmp_path):
        command, pid, line = start(place, code)
        text, errors = command.communicate()
        ends.append((line, text, errors, command.returncode))
        assert (pid == command.pid) == (place == tmp_path)  # the server's child, or itself
    assert ends[0] == ends[1] and "sunfish" in ends[0][0]


def test_a_stage_finds_loaded_what_an_earlier_one_has_imported(folder):
    statuses = []
    for name in ("colorsys", "gone", "colorsys"):  # `gone` cannot be imported: nothing changes
        code = f"loaded = 'colorsys' in sys.modules; import {name}; sys.exit(3 * loaded)"
        command, _, _ = start(folder, code)
        command.communicate()
        statuses.append(command.returncode)
    assert statuses == [0, 1, 3]


def test_ctrl_c_ends_a_forked_stage_as_it_ends_one_alone(folder):
    command, pid, _ = start(folder, "signal.pause()")
    for process in (command.pid, psutil.Process(pid).ppid(), pid):  # as a terminal signals them all
        os.kill(process, signal.SIGINT)
    assert "interrupted" in command.communicate()[1]
    assert command.returncode == 130


@pytest.fixture
def unready(tmp_path):
    """A server of `tmp_path` that takes commands and does not begin them: it still imports."""
    write_module(tmp_path)
    (tmp_path / STAGE_SOCKET).parent.mkdir(parents=True)
    with socket.socket(socket.AF_UNIX) as server, pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)  # a socket's path must be short
        server.bind(str(STAGE_SOCKET))
        server.listen()
        yield server


def test_ctrl_c_ends_a_command_that_waits_for_its_server(unready, tmp_path):
    command = open_command(tmp_path, "pass")
    with unready.accept()[0] as connection:
        connection.recv(1)  # it waits from now on
        command.send_signal(signal.SIGINT)
        assert command.communicate() == ("", "")
    assert command.returncode == -signal.SIGINT


def test_a_stage_starts_alone_if_its_server_ends_before_it_begins(unready, tmp_path):
    command = open_command(tmp_path, "pass")
    unready.accept()[0].close()
    assert command.communicate()[0].startswith(f"{command.pid} ")
    assert command.returncode == 0


def test_another_python_starts_a_stage_alone(folder, tmp_path):
    venv.create(tmp_path, symlinks=True)
    python = [str(tmp_path / "bin/python"), "-m", "words.speaker", "pass"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    ended = subprocess.run(python, cwd=folder, env=environment, capture_output=True, text=True)
    assert "lacks cv2" in ended.stderr


def test_a_forked_stage_ends_with_its_command(folder):
    command, pid, _ = start(folder, "signal.pause()")
    stage = psutil.Process(pid)
    command.kill()
    command.communicate()
    assert wait_for(lambda: not alive(stage))


def test_a_forked_stage_ends_with_a_command_that_never_read_of_its_begin(folder, monkeypatch):
    environment = os.environ | {"PYTHONPATH": str(ROOT), "WORD": "sunfish"}
    reader, writer = os.pipe()
    monkeypatch.chdir(folder)  # a socket's path must be short
    with socket.socket(socket.AF_UNIX) as command, os.fdopen(reader) as lines:
        command.connect(str(STAGE_SOCKET))
        socket.send_fds(command, [b"\n"], [writer] * 3)
        os.close(writer)
        started = json.dumps(["words.speaker", ["signal.pause()"], environment])
        command.sendall(f"{started}\n".encode())
        stage = psutil.Process(int(lines.readline().partition(" ")[0]))
    assert wait_for(lambda: not alive(stage))


def test_a_killed_stage_is_named(folder):
    command, _, _ = start(folder, "os.kill(os.getpid(), signal.SIGKILL)")
    assert "words.speaker was ended from outside" in command.communicate()[1]
    assert command.returncode == 1


def test_a_stage_starts_alone_where_the_server_is_gone(tmp_path):
    write_module(tmp_path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT))
        with open_stage_server(tmp_path):
            (tmp_path / STAGE_SOCKET).rename(tmp_path / "kept")
    (tmp_path / "kept").rename(tmp_path / STAGE_SOCKET)  # as a killed sweep leaves it
    command, pid, _ = start(tmp_path, "pass")
    command.communicate()
    assert (command.returncode, pid) == (0, command.pid)
