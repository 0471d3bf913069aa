"""Work done by a cluster: the same bytes as by processes, and what is refused before it begins.

What a worker does is tested in this process; a cluster wants the extra `cluster`.
"""

import os
import pickle
import sys
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest
from conftest import TINY_CARP
from jobs import fails_at_five, is_killed, is_killed_once, note_job, square, waits
from scratch import content, prepare
from tiny_run import stage_run

import stages.clip
import stages.cluster
import stages.extract
import stages.jumps
from finloop.base.errors import FinloopError
from finloop.base.parallel import ALONE, Processes, ordered_map
from finloop.base.settings import settings
from finloop.cluster import workers as at_cluster
from finloop.cluster.workers import DeferredCall, WorkerHome, connect_dask_workers, run_pickled_item
from finloop.jumps import film as jumps_film
from finloop.jumps import signature, visible

START = "the command"
needs_dask = pytest.mark.skipif(
    find_spec("distributed") is None, reason="the extra `cluster` is not installed: make cluster"
)


@pytest.fixture
def home(tmp_path, monkeypatch):
    """The facts of this process, and its folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    return WorkerHome.from_process(tmp_path, START, ["PATH"])


# --- a worker, in this process


def put(folder: Path, work) -> str:
    (folder / "work").write_bytes(pickle.dumps(work))
    return str(folder / "work")


def test_unpickling_a_call_makes_it_in_the_folder_of_who_asks(home, tmp_path, monkeypatch):
    monkeypatch.chdir("/")
    work = put(tmp_path, Path.resolve)
    call = DeferredCall(run_pickled_item, home, work, pickle.dumps(Path("here")))
    assert pickle.loads(pickle.loads(pickle.dumps(call))) == tmp_path / "here"


@pytest.mark.parametrize("fact", ["code", "python", "numpy", "PATH"])
def test_a_worker_of_other_facts_is_refused_by_name(home, tmp_path, fact):
    other = WorkerHome(home.folder, home.start, {**home.facts, fact: "other"})
    with pytest.raises(FinloopError) as caught:
        run_pickled_item(other, put(tmp_path, square), pickle.dumps(7))
    assert f"{fact}: {home.facts[fact]} there, other here" in caught.value.came
    assert START in caught.value.do


def test_the_facts_tell_versions_of_the_code_apart(tmp_path, monkeypatch):
    codes = set()
    for text in ("a", "b"):
        (tmp_path / "finloop").mkdir(exist_ok=True)
        (tmp_path / "finloop/x.py").write_text(text)
        monkeypatch.setattr(at_cluster, "_ROOT", tmp_path)
        codes.add(at_cluster._hash_code.__wrapped__())
    assert len(codes) == 2


@pytest.mark.parametrize("gone", ["folder", "file"])
def test_a_worker_that_does_not_see_the_folder_is_refused(home, tmp_path, gone):
    folder = str(tmp_path / "elsewhere") if gone == "folder" else home.folder
    there = WorkerHome(folder, START, home.facts)
    with pytest.raises(FinloopError) as caught:
        run_pickled_item(there, str(tmp_path / "work"), pickle.dumps(7))
    assert folder in caught.value.came and START in caught.value.do


def test_no_dask_is_one_message(home, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(FinloopError) as caught, connect_dask_workers(LOCAL, home, 2):
        pass
    assert caught.value.do == "run `make cluster`"


def test_a_stage_asks_the_cluster_that_is_named(tmp_path, monkeypatch):
    prepare(tmp_path, *TINY_CARP, "cluster=local")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(FinloopError, match="Dask is not installed"):
        with stages.cluster.open_workers([]):
            pass


def test_processes_work_where_no_cluster_is_named(tmp_path, monkeypatch):
    prepare(tmp_path, *TINY_CARP)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stages.cluster, "THREADS", 1)
    with stages.cluster.open_workers([]) as crew:
        assert crew == Processes(1) and crew.is_alone


# --- a cluster

LOCAL = settings("cluster", source="local")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shared")
    (folder / "data").mkdir()
    return folder


@pytest.fixture(scope="module")
def cluster(folder):
    """Two workers of Dask."""
    home = WorkerHome.from_process(folder, START, [])
    with connect_dask_workers(LOCAL, home, 2, ["jobs"]) as workers:
        yield workers


def of_address(cluster):
    return settings("cluster", scheduler_address=cluster.client.scheduler.address)


@needs_dask
def test_each_item_is_worked_once_in_order(cluster, folder):
    assert cluster.count == 2 and not cluster.is_alone
    assert list(ordered_map(square, range(12), cluster)) == [k**2 for k in range(12)]
    assert not list((folder / "data").iterdir())


@needs_dask
def test_an_error_in_a_worker_is_the_same_error_here(cluster):
    results = ordered_map(fails_at_five, range(40), cluster)
    assert [next(results) for _ in range(5)] == [0, 1, 2, 3, 4]
    with pytest.raises(FinloopError) as caught:
        next(results)
    assert (caught.value.came, caught.value.do) == ("five came", "take another")


@needs_dask
def test_no_more_is_worked_ahead_than_a_result_for_each_worker(cluster, tmp_path):
    results = ordered_map(note_job, ((tmp_path, number) for number in range(60)), cluster)
    for taken in range(1, 20):
        next(results)
        assert len(list(tmp_path.iterdir())) <= taken + cluster.count + 1


@needs_dask
def test_what_a_killed_worker_held_is_done_again(cluster, tmp_path):
    jobs = [(tmp_path, number) for number in range(6)]
    assert list(ordered_map(is_killed_once, jobs, cluster)) == [k**2 for k in range(6)]
    assert (tmp_path / "killed").exists()


@needs_dask
def test_a_piece_that_kills_every_worker_is_one_message(cluster, monkeypatch):
    monkeypatch.setattr(at_cluster, "TRIES", 1)
    with pytest.raises(FinloopError, match="worker processes were ended"):
        list(ordered_map(is_killed, range(2, 9), cluster))
    cluster.client.wait_for_workers(2)


@needs_dask
def test_a_cluster_of_other_code_or_folder_is_refused_before_it_works(cluster, folder, monkeypatch):
    home = WorkerHome.from_process(folder, START, [])
    other = WorkerHome(home.folder, START, {**home.facts, "code": "other"})
    with pytest.raises(FinloopError, match="code: ") as caught:
        with connect_dask_workers(of_address(cluster), other, 2):
            pass
    assert START in caught.value.do


@needs_dask
def test_no_scheduler_is_one_message(home, monkeypatch):
    monkeypatch.setattr(at_cluster, "_CONNECT_S", 0.2)
    nobody = settings("cluster", scheduler_address="tcp://127.0.0.1:9")
    with pytest.raises(FinloopError, match="no scheduler") as caught:
        with connect_dask_workers(nobody, home, 2):
            pass
    assert START in caught.value.do


@needs_dask
def test_where_nobody_is_left_to_work_it_is_said(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(at_cluster, "_LOOK_S", 0.05)
    monkeypatch.setattr(at_cluster, "_BACK_S", 0.1)
    monkeypatch.setattr(type(cluster), "count_threads", lambda self: {})
    pipes = [tmp_path / "a", tmp_path / "b"]
    for pipe in pipes:
        os.mkfifo(pipe)
    with pytest.raises(FinloopError, match="no worker"):
        list(ordered_map(waits, pipes, cluster))
    for pipe in pipes:
        with suppress(OSError):  # ENXIO: nobody reads
            os.close(os.open(pipe, os.O_WRONLY | os.O_NONBLOCK))


pose_run = stage_run("pose")


class Posted:
    """Workers to whom all is pickled, in this process."""

    count, is_alone = 2, False

    @contextmanager
    def open_submitter(self, work):
        there = pickle_copy(work)
        yield lambda item: Done(pickle_copy(there(pickle_copy(item))))


class Done(NamedTuple):
    """A piece of work that has been done already."""

    made: object

    def result(self):
        return self.made


def pickle_copy(what):
    return pickle.loads(pickle.dumps(what))


@pytest.mark.parametrize("where", ["posted", pytest.param("dask", marks=needs_dask)])
def test_jumps_are_the_same_bytes_from_other_workers(pose_run, where, monkeypatch, request):
    """By blocks of 50 rows, so that there are several; each worker opens the film anew."""
    monkeypatch.chdir(pose_run)
    for place in (signature, visible, jumps_film):
        monkeypatch.setattr(place, "_BATCH", 50)
    crew = Posted()
    if where == "dask":
        cluster = request.getfixturevalue("cluster")
        crew = replace(cluster, home=replace(cluster.home, folder=str(pose_run)))
    made = []
    for who in (ALONE, crew):
        opened = nullcontext(who)
        monkeypatch.setattr(stages.jumps, "open_workers", lambda *_, _of=opened, **__: _of)
        stages.jumps.main()
        made.append((content(pose_run / "data/jumps"), content(pose_run / "reports/jumps")))
    assert made[0] == made[1]


@needs_dask
def test_extract_gives_the_same_bytes(cluster, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stages.cluster, "THREADS", 1)
    made = {}
    address = of_address(cluster).scheduler_address
    for where in ([], [f"cluster.scheduler_address={address}"]):
        prepare(tmp_path, *TINY_CARP, "clip.frames=60", *where)
        if not made:
            stages.clip.main()
        stages.extract.main()
        made[len(where)] = content(tmp_path / "data/extract"), content(tmp_path / "reports")
    assert made[0] == made[1]
