"""What was written is what is read: one flipped bit is noticed, wherever it is."""

import hashlib
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from scratch import content
from tiny_run import STAGES, stage_run

import stages.verify
from benchmarks.faults import list_artefacts
from finloop.base.errors import FinloopError
from finloop.base.schema import Column, Schema
from finloop.io import checksums
from finloop.io.checkpoints import Checkpoints
from finloop.io.checksums import (
    RECORD_NAME,
    DamagedFileError,
    check_file,
    file_digest,
    find_damage,
    save_checksums,
    seal,
    unseal,
)
from finloop.io.numbers import load_numbers
from finloop.io.table import load_csv, load_table, save_table
from finloop.io.video import read_frames
from finloop.project import Project
from stages.kept import KeptResults
from stages.origins import note_origins
from stages.reuse import reuse_or_make

tiny = stage_run(*STAGES)


@pytest.fixture(scope="module")
def whole(tiny: Path) -> Path:
    """The run on a tiny carp, with its checksums as `stages.run` writes them after each stage."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tiny)
        for stage in STAGES:
            note_origins(stage)
    return tiny


@contextmanager
def flip_bit(path: Path, share: float, bit: int = 0) -> Iterator[None]:
    """One bit of a file is another one; share: where, from 0 at its head to 1 at its end."""
    before = path.read_bytes()
    after = bytearray(before)
    after[round(share * (len(before) - 1))] ^= 1 << bit
    path.write_bytes(after)
    try:
        yield
    finally:
        path.write_bytes(before)


LOADS: dict[str, Callable[[Project], Any]] = {
    "animate/beside/measures.csv": lambda run: load_csv(run.data / "animate/beside/measures.csv"),
    "animate/hybrid.parquet": lambda run: run.edit_list("hybrid", "render"),
    "animate/hybrid/drawn.json": lambda run: run.drawn_scale("hybrid"),
    "animate/hybrid/goals.json": lambda run: run.goals("hybrid"),
    "bpn/model.json": lambda run: run.motion_network,
    "calibrate/steps.parquet": lambda run: run.school_rule,
    "calibrate/zones.json": lambda run: run.school_rule,
    "clip/arena.png": lambda run: run.arena,
    "clip/clip.mp4": lambda run: next(read_frames(run.data / "clip/clip.mp4")),
    "clip/facts.json": lambda run: run.facts,
    "distance/pairs.parquet": lambda run: run.similar_pairs,
    "distance/steps/facts.json": lambda run: run.map_facts,
    "distance/steps/steps.parquet": lambda run: run.step_distances,
    "extract/background.png": lambda run: run.background,
    "extract/cutouts.arrow": lambda run: run.cutouts,
    "extract/scene.json": lambda run: run.scene,
    "extract/tracks.parquet": lambda run: run.tracks(),
    "features/features.parquet": lambda run: run.features,
    "gateways/gateways.parquet": lambda run: run.gateways,
    "identity/identities.parquet": lambda run: run.identities,
    "jumps/jumps.parquet": lambda run: run.jumps,
    "jumps/look.parquet": lambda run: run.row_looks,
    "loops/loops.parquet": lambda run: run.loops,
    "pose/outlines.npy": lambda run: run.outlines,
    "pose/poses.parquet": lambda run: run.poses,
    "pose/postures.npy": lambda run: run.poses,
    "pose/shapes.json": lambda run: run.poses,
    "sprites/sprites.arrow": lambda run: run.sprite_cutouts,
    "sprites/sprites.parquet": lambda run: run.sprites,
    "../reports/bpn/curve.csv": lambda run: load_csv(run.root / "reports/bpn/curve.csv"),
    "../reports/pose/metrics.json": lambda run: load_numbers(run.root / "reports/pose"),
}


def test_a_whole_run_is_loaded(whole):
    for name, load in LOADS.items():
        with Project(whole) as project:
            assert load(project) is not None, name


@pytest.mark.parametrize("share", [0, 0.5, 1])
def test_no_reader_takes_a_file_with_a_flipped_bit(whole, share):
    for name, load in LOADS.items():
        path = whole / "data" / name
        with flip_bit(path, share), Project(whole) as project:
            with pytest.raises(DamagedFileError, match=rf"{path.name} is damaged.*\n.*\n.*repro"):
                load(project)


@pytest.fixture(scope="module")
def plain_run(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same run without checksums."""
    folder = tmp_path_factory.mktemp("plain")
    shutil.copytree(whole, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns(RECORD_NAME))
    return folder


@pytest.mark.parametrize("content", [None, b"", b"[1]", "half"])
def test_what_is_no_artefact_is_one_message_without_checksums_too(plain_run, content):
    for name, load in LOADS.items():
        if name.endswith((".csv", "metrics.json")):  # read as they are
            continue
        path = plain_run / "data" / name
        before = path.read_bytes()
        path.unlink()
        if content is not None:
            path.write_bytes(before[: len(before) // 2] if content == "half" else content)
        with pytest.raises(FinloopError, match=re.escape(path.name)), Project(plain_run) as run:
            load(run)
        path.write_bytes(before)


def test_every_artefact_is_compared(whole):
    """All but the report, and what stages are given: drawings and gaits."""
    files = {
        path for top in ("data", "reports") for path in (whole / top).rglob("*") if path.is_file()
    }
    report = {whole / "reports" / name for name in ("index.html", "report/metrics.json")}
    assert files - {*list_artefacts(whole)} == report
    for number, path in enumerate(list_artefacts(whole)):
        with flip_bit(path, number % 7 / 6, number % 8):
            with pytest.raises(DamagedFileError, match=r"is damaged"):
                check_file(path) if path.name != RECORD_NAME else check_file(path.parent / "a")
    assert [check_file(path) for path in list_artefacts(whole)] == list_artefacts(whole)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of DVC's cache, with a file and a list of files."""
    monkeypatch.setattr(stages.verify, "run_dvc", lambda *_, **__: (True, f"{tmp_path}\n"))
    for kept, ending in ((b"a film", ""), (b"[]", ".dir")):
        digest = hashlib.md5(kept, usedforsecurity=False).hexdigest()
        path = tmp_path / "files/md5" / digest[:2] / f"{digest[2:]}{ending}"
        path.parent.mkdir(parents=True)
        path.write_bytes(kept)
    return tmp_path


def test_verify_removes_what_is_damaged_in_the_cache_of_dvc(whole, cache, monkeypatch):
    monkeypatch.chdir(whole)
    film, names = sorted(cache.rglob("files/md5/*/*"), key=lambda path: path.suffix)
    for path, other in ((film, names), (names, film)):
        with flip_bit(path, 0.5):
            with pytest.raises(FinloopError, match=rf"{path.name}, in DVC's cache, .*removed"):
                stages.verify.main()
            assert not path.exists() and other.exists()
    stages.verify.main()


@pytest.mark.usefixtures("cache")
def test_verify_names_all_damage_and_has_dvc_look_again(whole, monkeypatch, capsys):
    monkeypatch.chdir(whole)
    stages.verify.main()
    assert "as they were written, in" in capsys.readouterr().out
    film, table = whole / "data/render/modes.mp4", whole / "data/identity/identities.parquet"
    with flip_bit(film, 0.3), flip_bit(table, 0.9):
        before = film.stat().st_mtime_ns
        with pytest.raises(FinloopError) as caught:
            stages.verify.main()
        assert film.stat().st_mtime_ns > before
    assert caught.value.came.count("is damaged") == 2
    assert all(path.name in caught.value.came for path in (film, table))
    stages.verify.main()


def test_a_folder_of_another_version_has_no_record_and_says_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FinloopError, match=r"no folder .* has a record"):
        stages.verify.main()


# --- records


def put(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"what is in {name}")


def test_a_record_names_files_inside_and_beside_and_stands_for_the_folder(tmp_path):
    put(tmp_path, "a/x: y #.txt", "a/b/deep.txt", "beside.txt", "from/1", "from/2/3")
    source, folder = tmp_path / "from", tmp_path / "a"
    records = []
    for _ in range(2):
        save_checksums(folder, [tmp_path / "beside.txt"], [source])
        records.append((folder / RECORD_NAME).read_text())
        assert find_damage(folder) == []
        save_checksums(source)  # from now on it stands for its files
    assert "../from/2/3" in records[0] and "../from/2/3" not in records[1]
    assert "../from/finloop-checksums.yaml" in records[1]
    (tmp_path / "beside.txt").write_text("other")
    (folder / "b/deep.txt").unlink()
    (folder / "x: y #.txt").write_text("other")
    named = {error.came.partition(" is damaged: ")[0] for error in find_damage(folder)}
    wanted = (folder / "b/deep.txt", tmp_path / "beside.txt", folder / "x: y #.txt")
    assert named == {*map(str, wanted)}


def test_a_file_without_a_record_is_read_as_it_is(tmp_path):
    put(tmp_path, "a/1.txt", "a/2.txt")
    save_checksums(tmp_path / "a")
    put(tmp_path, "a/new.txt", "b/1.txt")
    for path in ("a/new.txt", "b/1.txt", "a/missing.txt"):
        assert check_file(tmp_path / path) == tmp_path / path


def test_a_large_file_is_read_once_by_all_processes_and_again_when_it_was_written(
    tmp_path, monkeypatch
):
    reads = []
    read = checksums._read_digest
    monkeypatch.setattr(checksums, "_read_digest", lambda path: reads.append(path) or read(path))
    monkeypatch.setattr(checksums, "_LARGE", 4)
    monkeypatch.setattr(checksums, "_SETTLED_S", 0.0)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "memory"))
    (tmp_path / "memory").mkdir()
    put(tmp_path, "a/x.npy")
    path = tmp_path / "a/x.npy"
    digest = file_digest(path)
    for _ in range(2):
        checksums._known.clear()  # as another process
        assert file_digest(path) == digest
    assert reads == [path]
    path.write_text("longer than it was before")
    assert file_digest(path) != digest and reads == [path, path]
    # A damaged memory does not make a whole file a damaged one.
    save_checksums(path.parent)
    for damaged in (b"0" * 64, b"\xff" * 64, b"0"):
        for note in (tmp_path / "memory").rglob("*-*"):
            if note.is_file():
                note.write_bytes(damaged)
        checksums._known.clear()
        assert check_file(path) == path
    # Without a place for a memory, everything is read.
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    checksums._known.clear()
    assert check_file(path) == path


# --- pieces and caches: made again


def test_each_flipped_bit_of_a_sealed_file_is_noticed(tmp_path, capsys):
    path, inside = tmp_path / "piece", b"what was found"
    path.write_bytes(seal(inside))
    assert unseal(path) == inside and unseal(tmp_path / "none") is None
    length = path.stat().st_size
    for place in range(length):
        with flip_bit(path, place / (length - 1), place % 8):
            assert unseal(path) is None
    assert capsys.readouterr().err.count("piece is damaged") == length


@pytest.mark.parametrize("share", [0, 0.5, 1])
def test_a_damaged_piece_of_an_interrupted_run_is_named_and_made_again(tmp_path, capsys, share):
    pieces = Checkpoints(tmp_path)
    assert pieces.load_or_make("12", lambda: [1]) == [1]
    with flip_bit(tmp_path / "12", share):
        assert pieces.load_or_make("12", lambda: [2]) == [2]
        assert "12 is damaged; what it kept is made again" in capsys.readouterr().err
        assert pieces.load_or_make("12", lambda: [3]) == [2]
    # One of a former version, without a checksum.
    (tmp_path / "12").write_bytes((tmp_path / "12").read_bytes()[32:])
    assert pieces.load_or_make("12", lambda: [4]) == [4]


def test_a_damaged_result_that_was_kept_is_named_and_missing(tmp_path, capsys):
    kept = KeptResults(tmp_path, "", {})
    kept.save_values("loops", [1 / 3])
    assert kept.load_values("loops") == [1 / 3]
    for share in (0, 0.5, 1):
        with flip_bit(next(tmp_path.iterdir()), share):
            assert kept.load_values("loops") is None
    assert capsys.readouterr().err.count("is damaged") == 3


def test_a_film_that_was_kept_is_made_again_if_a_file_of_it_is_damaged(tmp_path, capsys):
    def make(folder: Path) -> dict[str, float]:
        put(folder, "clip.mp4", "deep/mask.png")
        return {"frames": 7.0}

    first, again = tmp_path / "first", tmp_path / "again"
    kept = tmp_path / "kept/1"
    assert reuse_or_make(kept, first, make) == {"frames": 7.0}
    files = sorted(path for path in kept.rglob("*") if path.is_file())
    assert len(files) == 4
    for share in (0, 0.5, 1):
        for path in files:
            damaged = bytearray(path.read_bytes())
            damaged[round(share * (len(damaged) - 1))] ^= 1
            path.unlink()  # it is a link to the file of the earlier run, too
            path.write_bytes(damaged)
            assert reuse_or_make(kept, again, make) == {"frames": 7.0}
            assert content(again) == content(first) and find_damage(kept) == []
            shutil.rmtree(again)
    assert capsys.readouterr().err.count("1 is damaged") == 12
    assert reuse_or_make(kept, again, partial(pytest.fail, "made again")) == {"frames": 7.0}
    assert content(again) == content(first)


# --- a table without a record


def test_a_page_of_a_table_that_stands_alone_is_compared(tmp_path):
    schema = Schema(Column("x", "float64", "px"), Column("n", "int32", "1"))
    path = tmp_path / "alone.parquet"
    save_table(path, pd.DataFrame({"x": [0.1 * k for k in range(4000)], "n": range(4000)}), schema)
    whole = load_table(path, schema)
    noticed = 0
    for share in (0.2, 0.4, 0.6, 0.8):
        with flip_bit(path, share), pytest.raises(FinloopError, match="cannot be read as a table"):
            noticed += 1
            load_table(path, schema)
    assert noticed == 4 and load_table(path, schema).equals(whole)
