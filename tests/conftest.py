"""Fixtures that several tests share: a copy of the repository whose pipeline runs a tiny carp."""

import contextlib
import gc
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("FINLOOP_THREADS", "1")  # a second thread only waits for the other worker
from stages.run import STAGE_SOCKET  # isort: skip  (sets all libraries' threads, before numpy)

import psutil
import pytest
import yaml
from hypothesis import HealthCheck, settings

from stages.forks import open_stage_server

if TYPE_CHECKING:
    from tiny_run import TinyRun

# PyTorch imports Triton where it is installed. Triton and the software renderer of the tank bring an
# LLVM each, and a process that has loaded one crashes on the other. No stage loads both.
sys.modules.setdefault("triton", None)  # type: ignore[arg-type]

ROOT = Path(__file__).parents[1]
OUTPUTS = ("data", "reports")
# Processes are forked from a server, which imports their work wherever a test has started it.
os.environ["PYTHONPATH"] = os.pathsep.join(
    [str(ROOT), str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])]
)
FRONT = ("features",)  # and what it waits for
TINY_CARP = [
    f"{key}={value if isinstance(value, str) else json.dumps(value)}"
    for key, value in yaml.safe_load((ROOT / ".ci/fixture/film.yaml").read_text("utf-8")).items()
]
SMALL_GAIT = {
    "dog_frames": 32, "dog_cycles": 2.0, "dog_width_px": 160, "frame_rate_hz": 8.0, "size_px": 64,
}  # fmt: skip

# On a busy machine any example takes long, and so does drawing it; the same ones come every time.
settings.register_profile(
    "untimed", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("untimed")

PATIENCE_S = 120.0
"""After which a test takes it that nothing will come: a hang ends, a busy machine does not."""

SLOW = ("pipeline",
        "gait_stage", "experiment", "params", "carp", "mend", "sweeps",
        "cluster", "extract", "calibrate", "findings", "render", "clip", "elsewhere", "footage_film", "realism", "modes", "sprites", "morph_simple",
        "given_tracks", "examples", "gait_outline", "resume", "morph_stage", "play", "tank_scene", "retarget", "loops", "bpn", "length", "forecast",
        "distance_map", "gait_tool", "gateways", "export", "gait_transfer", "guides", "features", "play_server", "animate_forecast", "identity", "check",
        "animate_film", "paths", "report", "jumps")  # fmt: skip
"""The files that take most processor time, most of it first, by the word after `test_`."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The slowest file first, so that two workers end at about the same time.

    While one worker runs the pipeline, and compiles its kernels, the other begins with files that
    need none of those: so nothing is compiled by both.
    """
    order = {f"test_{word}.py": number for number, word in enumerate(SLOW)}
    items.sort(key=lambda item: (order.get(item.path.name, len(SLOW)), item.path.name))


def pytest_configure(config: pytest.Config) -> None:
    """No looking for garbage amid the imports: a fifth of the time of collecting the tests.

    The second worker collects from the last file on, the first one from the first: what each has
    compiled, the other finds: an eighth of the time in a fresh clone.
    """
    gc.disable()
    second = getattr(config, "workerinput", {}).get("workerid") == "gw1"
    if second and [Path(one).name for one in config.args] == ["tests"]:
        config.args = sorted(map(str, Path(__file__).parent.glob("test_*.py")), reverse=True)


def pytest_collection_finish() -> None:
    """What was imported stays, and is not looked through again and again; what is new, seldom."""
    gc.freeze()
    gc.set_threshold(100_000, 20, 100)  # a kernel that is compiled makes a million objects
    gc.enable()


@dataclass(frozen=True)
class Copy:
    """A copy of the repository to run DVC in, with an environment of its own."""

    root: Path
    env: dict[str, str]
    kept: Path  # data/ and reports/ after the first run

    def run(self, *command: str, fails: bool = False) -> str:
        """What a command prints, stdout and stderr; it must end well, or with `fails` badly."""
        done = subprocess.run(
            command,
            cwd=self.root,
            env=self.env,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=1800,  # a hang ends, a slow machine does not
        )
        assert (done.returncode != 0) == fails, f"{' '.join(command)}\n{done.stdout}"
        return done.stdout

    def dvc(self, *arguments: str, fails: bool = False) -> str:
        """A DVC command, in a process that does not look for garbage, as a sweep's."""
        from stages.repository import DVC

        return self.run(*DVC, *arguments, fails=fails)

    def git(self, *arguments: str) -> str:
        return self.run("git", *arguments)

    def compose(self, *overrides: str) -> str:
        return self.run("python", "-m", "stages.compose", *TINY_CARP, *overrides)

    def start(self, *command: str) -> subprocess.Popen[str]:
        """Start a command as a terminal would, in a process group of its own."""
        return subprocess.Popen(
            command,
            cwd=self.root,
            env=self.env,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )

    def text(self, path: str) -> str:
        return (self.root / path).read_text(encoding="utf-8")

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Let commands start as in a terminal, by no server that has imported them."""
        socket = self.root / STAGE_SOCKET
        aside = socket.with_suffix(".aside")
        if socket.exists():  # a server is Linux's
            socket.rename(aside)
        try:
            yield
        finally:
            if aside.exists():
                aside.rename(socket)

    def back(self) -> None:
        """As it was after the first run."""
        for name in OUTPUTS:
            shutil.rmtree(self.root / name, ignore_errors=True)
            shutil.copytree(self.kept / name, self.root / name)
        self.git("reset", "--quiet", "--hard", "start")


def alive(process: psutil.Process) -> bool:
    """Whether a process still runs; one that only waits to be collected does not."""
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def wait_for(look: Callable[[], Any], every: float = 0.005) -> Any:
    """What `look` returns as soon as that is true; what it returns in the end if it never is."""
    end = time.monotonic() + PATIENCE_S
    while not (result := look()) and time.monotonic() < end:
        time.sleep(every)
    return result


@pytest.fixture(scope="session", autouse=True)
def no_waiting_for_the_disk() -> Iterator[None]:
    """Nothing a test writes in this process must outlast a failure of power."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda _: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def small_films() -> Iterator[None]:
    """The drawn dog and the drawings in motion are small where a stage runs in this process."""
    from finloop.gait.settings import GaitSettings
    from finloop.morph.settings import MorphSettings

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MorphSettings, "size_px", 64)
        for name, value in SMALL_GAIT.items():
            patch.setattr(GaitSettings, name, value)
        yield


@pytest.fixture
def no_drawing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are put together but not painted, where a test does not look at pictures."""
    from matplotlib.figure import Figure  # which the process that runs no test does without

    monkeypatch.setattr(Figure, "savefig", lambda _, path, **_options: Path(path).touch())


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory: pytest.TempPathFactory) -> "TinyRun":
    """What the stages make of a drawn carp of two seconds: run once for all workers."""
    from tiny_run import TinyRun  # which imports this module

    base = tmp_path_factory.getbasetemp()
    return TinyRun((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "tiny")


def run_copy(make: pytest.TempPathFactory, tiny_run: "TinyRun", words: Collection[str]) -> Copy:
    """The repository, copied, with a run of some of its stages on a drawn carp, all committed.

    The stages have run in this process, thirty starts less. DVC takes what they made as made by it:
    that it runs them to the same bytes, tests/test_pipeline.py shows.
    """
    from scratch import composed_once
    from tiny_run import STAGES, pipeline_of

    import stages.params
    from benchmarks.pipeline import with_dependencies
    from stages.origins import note_origins

    root = make.mktemp("finloop")
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    for name in subprocess.check_output(listed, cwd=ROOT, text=True).split("\0"):
        if name not in ("", "dvc.lock") and (ROOT / name).is_file():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, root / name)
    if set(words) != set(STAGES):
        (root / "dvc.yaml").write_text(pipeline_of(words))
    for package in (path.parent.relative_to(ROOT) for path in ROOT.glob("finloop/**/__init__.py")):
        compiled = ROOT / package / "__pycache__"  # by numba, half a minute: done once for both
        compiled.mkdir(exist_ok=True)
        (root / package / "__pycache__").symlink_to(compiled)
    apart = make.mktemp("apart")
    env = {key: value for key, value in os.environ.items() if not key.startswith(("GIT_", "DVC_"))}
    env |= {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{env['PATH']}",
        "SHELL": "/bin/sh",  # not every shell makes way for a command without `exec`
        "GIT_CONFIG_GLOBAL": os.devnull,
        "DVC_GLOBAL_CONFIG_DIR": str(apart / "global"),
        "DVC_SITE_CACHE_DIR": str(apart / "site"),
    }
    del env["PYTHONPATH"]
    env.pop("PYTHONDONTWRITEBYTECODE", None)  # else every stage compiles the same modules again
    copy = Copy(root, env, apart)
    copy.git("init", "--quiet", ".")
    (root / ".git/info").mkdir(exist_ok=True)
    (root / ".git/info/exclude").write_text("__pycache__\n")  # a link is no folder to git
    copy.git("config", "user.name", "test")
    copy.git("config", "user.email", "test@example.org")
    (root / "params.yaml").write_text(composed_once(TINY_CARP), encoding="utf-8")
    with (root / ".dvc/config").open("a") as config:
        config.write(f"\n['remote \"lab\"']\n    url = {apart / 'lab'}\n")
    copy.git("add", "--all")
    copy.git("commit", "--quiet", "--message", "before the first run")
    tiny_run.bring(root, words)
    with contextlib.chdir(root):
        stages.params.main()  # of the params.yaml that Hydra has composed
        for word in with_dependencies(words):  # as `stages.run.run` does after each
            note_origins(word)
    copy.dvc("commit", "--force", "--quiet")
    copy.git("add", "--all")
    copy.git("commit", "--quiet", "--message", "the first run")
    copy.git("tag", "start")
    for name in OUTPUTS:
        shutil.copytree(root / name, apart / name)
    return copy


def end_processes(root: Path) -> None:
    """DVC's queue has a worker that waits for more."""
    for process in psutil.process_iter(["cwd"]):
        if process.info["cwd"] == str(root):
            process.kill()


@pytest.fixture(scope="session")
def first_run(tmp_path_factory: pytest.TempPathFactory, tiny_run: "TinyRun") -> Iterator[Copy]:
    """A copy whose whole pipeline has run."""
    from tiny_run import STAGES

    yield (copy := run_copy(tmp_path_factory, tiny_run, STAGES))
    end_processes(copy.root)


@pytest.fixture(scope="session")
def front_run(tmp_path_factory: pytest.TempPathFactory, tiny_run: "TinyRun") -> Iterator[Copy]:
    """A copy whose pipeline ends with `features`.

    DVC reads and writes the whole of dvc.lock at every step. With all stages that is most of what
    it does, and how it stops, goes on, refuses and sweeps is the same with a few.
    """
    copy = run_copy(tmp_path_factory, tiny_run, FRONT)
    with open_stage_server(copy.root):  # DVC's imports, a second each time, are made once
        yield copy
    end_processes(copy.root)


@pytest.fixture
def front(front_run: Copy) -> Iterator[Copy]:
    """The copy with the stages up to `features`, put back in order after the test."""
    yield front_run
    front_run.back()
