"""Long runs: interrupted they go on where they were; a full disk, and frames that are damaged."""

import errno
import shutil
from collections import Counter, namedtuple
from pathlib import Path

import av
import pytest
from conftest import TINY_CARP
from scratch import content, prepare

import stages.clip
import stages.extract
from finloop.base.errors import FinloopError
from finloop.drawn.carp.settings import CarpFilm
from finloop.extract import film
from finloop.extract.table import tracks_schema
from finloop.io import atomic
from finloop.io.atomic import require_free_space
from finloop.io.checkpoints import Checkpoints, remove_folders_except
from finloop.io.numbers import load_numbers
from finloop.io.table import load_table
from finloop.io.video import ARENA_NAME, FACTS_NAME, KEY_FRAME_EVERY, load_facts, load_mask
from finloop.verbs import Film, track

FILM = [*TINY_CARP, "clip.frames=72", "clip.crf=0"]
SHORT = KEY_FRAME_EVERY  # frames of a piece
EXTRACT, CHECKPOINTS = Path("data/extract"), Path("data/.extract.part")
Usage = namedtuple("Usage", "total used free")


# --- checkpoints


@pytest.mark.parametrize("left", [0, 4, 12, -1])
def test_a_piece_that_is_kept_is_not_made_again_unless_it_is_damaged(tmp_path, left):
    checkpoints = Checkpoints(tmp_path)
    assert checkpoints.stored_bytes() == 0
    for make in (lambda: list(range(99)), lambda: 1 / 0):
        assert checkpoints.load_or_make("1", make) == list(range(99))
    assert checkpoints.stored_bytes() == (tmp_path / "1").stat().st_size
    (tmp_path / "1").write_bytes((tmp_path / "1").read_bytes()[:left])
    assert checkpoints.load_or_make("1", lambda: "new") == "new"
    assert checkpoints.load_or_make("1", lambda: 1 / 0) == "new"


def test_pieces_of_something_else_are_removed(tmp_path):
    for name in "abc":
        Checkpoints(tmp_path / name).load_or_make("1", lambda: 1)
    remove_folders_except(tmp_path, ["b"])
    assert [path.name for path in tmp_path.iterdir()] == ["b"]
    remove_folders_except(tmp_path, [])
    assert not tmp_path.exists()


# --- the stage


@pytest.fixture(scope="module")
def film_run(tmp_path_factory):
    """A folder with a clip, and what an undisturbed run makes of it."""
    folder = tmp_path_factory.mktemp("filmed")
    prepare(folder, *FILM)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(film, "_STRETCH", SHORT)
        patch.setattr(CarpFilm, "light_drift", 0.0)
        stages.clip.main()
        stages.extract.main()
    return folder


@pytest.fixture
def workspace(film_run, tmp_path, monkeypatch):
    prepare(tmp_path, *FILM)
    shutil.copytree(film_run / "data/clip", tmp_path / "data/clip")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(film, "_STRETCH", SHORT)
    return tmp_path


@pytest.fixture
def span_counts(monkeypatch):
    counts, compute = Counter(), film._detect_span

    def count_span(film, scene, detector, span):
        counts[span[0]] += 1
        return compute(film, scene, detector, span)

    monkeypatch.setattr(film, "_detect_span", count_span)
    return counts


def interrupt(monkeypatch, frames=40):
    """Run the stage until so many frames are done."""
    with monkeypatch.context() as patch:
        left = iter(range(frames))
        links = film.TrackLinker.link_frame

        def link_or_stop(*given):
            if next(left, None) is None:
                raise KeyboardInterrupt
            return links(*given)

        patch.setattr(film.TrackLinker, "link_frame", link_or_stop)
        with pytest.raises(KeyboardInterrupt):
            stages.extract.main()


@pytest.mark.usefixtures("workspace")
def test_an_interrupted_run_goes_on_where_it_was(film_run, span_counts, monkeypatch, capsys):
    interrupt(monkeypatch)
    assert not EXTRACT.exists() and dict(span_counts) == dict.fromkeys((0, 12, 24, 36), 1)
    stages.extract.main()
    assert set(span_counts.values()) == {1} and len(span_counts) == 6
    assert content(EXTRACT) == content(film_run / EXTRACT)
    assert content(Path("reports/extract")) == content(film_run / "reports/extract")
    assert not CHECKPOINTS.exists()
    assert "continues with" in capsys.readouterr().err


@pytest.mark.parametrize("change", ["parameter", "film"])
def test_nothing_is_taken_from_a_run_of_something_else(workspace, span_counts, monkeypatch, change):
    interrupt(monkeypatch)
    (before,) = CHECKPOINTS.iterdir()
    if change == "parameter":
        prepare(workspace, *FILM, "extract.noise_sigmas=6")
    else:
        (workspace / "data/clip/more.txt").write_text("another clip")
    interrupt(monkeypatch)
    (after,) = CHECKPOINTS.iterdir()
    assert after != before and dict(span_counts) == dict.fromkeys((0, 12, 24, 36), 2)


# --- the disk


def test_room_is_looked_for_where_the_folder_will_be(tmp_path):
    require_free_space(tmp_path / "new/one", 1.0, "it", "give up")
    with pytest.raises(FinloopError, match=r"it will take about 1\.0 EB"):
        require_free_space(tmp_path / "new/one", 1e18, "it", "give up")


@pytest.mark.parametrize("word", ["clip", "extract"])
def test_a_disk_that_is_too_small_is_refused_with_numbers(workspace, monkeypatch, word):
    monkeypatch.setattr(atomic.shutil, "disk_usage", lambda _: Usage(1, 1, 2000))
    before = content(workspace / "data")
    with pytest.raises(FinloopError) as caught:
        getattr(stages, word).main()
    assert "72 frames" in caught.value.came and "2.0 kB are free" in caught.value.came
    assert content(workspace / "data") == before


def test_a_disk_that_gets_full_leaves_nothing_half(workspace, film_run, monkeypatch):
    with monkeypatch.context() as patch:
        write, room = Path.write_bytes, iter(range(3))

        def full(path, content):
            if next(room, None) is None:
                write(path, content[: len(content) // 2])
                raise OSError(errno.ENOSPC, "No space left on device")
            return write(path, content)

        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(FinloopError, match="disk is full"):
            stages.extract.main()
    (checkpoints,) = CHECKPOINTS.iterdir()
    assert len(list(checkpoints.iterdir())) == 3 and not EXTRACT.exists()
    assert not list(workspace.glob("data/**/.*.part/*.part"))
    stages.extract.main()
    assert content(EXTRACT) == content(film_run / EXTRACT)


# --- frames that cannot be decoded


def damage(clip, first, last):
    with av.open(str(clip)) as container:
        stream = container.streams.video[0]
        packets = [(p.pts, p.pos, p.size) for p in container.demux(stream) if p.size]
    content = bytearray(clip.read_bytes())
    for number, (_, place, size) in enumerate(sorted(packets)):
        if first <= number <= last:
            content[place : place + size] = bytes(size)
    clip.write_bytes(content)


def test_frames_that_cannot_be_decoded_are_named_and_the_rest_goes_on(workspace, film_run, capsys):
    damage(workspace / "data/clip/clip.mp4", 27, 28)
    stages.extract.main()
    said = capsys.readouterr().err
    metrics = load_numbers(Path("reports/extract"))
    table, whole = (
        load_table(folder / EXTRACT / "tracks.parquet", tracks_schema(33), ["frame", "x_px"])
        for folder in (workspace, film_run)
    )
    left = sorted(set(whole["frame"]) - set(table["frame"]))
    assert left == list(range(27, 36)) and metrics["frames_lost"] == 9
    assert "9 of 72 frames" in said and "27-35" in said
    clip = workspace / "data/clip"
    film = Film(clip, load_facts(clip / FACTS_NAME), load_mask(clip / ARENA_NAME, 320, 240))
    with pytest.warns(UserWarning, match="9 of 72 frames .* 27-35"):
        track(film, workspace / "by_verb")
    kept = whole[~whole["frame"].isin(left)]
    assert table["x_px"].to_numpy() == pytest.approx(kept["x_px"].to_numpy(), abs=0.5)


def test_a_clip_of_which_nothing_can_be_decoded_is_one_message(workspace):
    damage(workspace / "data/clip/clip.mp4", 0, 99)
    with pytest.raises(FinloopError, match="cannot be read as a normalised clip"):
        stages.extract.main()
