"""The normalised clip: what is written comes back, whole or not at all, and fast to reach."""

import errno
import json
import os
import subprocess
import sys
import textwrap
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from finloop.base.errors import FinloopError
from finloop.io import atomic
from finloop.io.movie import VideoWriter
from finloop.io.video import (
    VideoFacts,
    load_facts,
    load_mask,
    read_chosen_frames,
    read_frames,
    save_facts,
    save_mask,
)

RATE = Fraction(2807, 100)
FACTS = VideoFacts(
    source="file",
    width_px=33,
    height_px=17,
    frames=7,
    frame_rate=RATE,
    colour=True,
    segments=((0, 3), (3, 7)),
    pixel_aspect=Fraction(16, 15),
    notes=("crooked",),
)


def noise(count: int, shape: tuple[int, ...]) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (count, *shape), dtype=np.uint8)


def write(path: Path, frames: np.ndarray, crf: int = 0) -> Path:
    colour = frames.ndim == 4
    with VideoWriter(path, frames.shape[2], frames.shape[1], RATE, colour, crf) as writer:
        for frame in frames:
            writer.write(frame)
    return path


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """100 frames of noise: over three stretches between key frames."""
    frames = noise(100, (48, 64))
    return write(tmp_path_factory.mktemp("film") / "clip.mp4", frames), frames


@pytest.mark.parametrize("size", [(48, 64), (47, 63), (263, 500), (1, 1), (17, 33)])
def test_lossless_grey_is_bit_exact_at_any_size(tmp_path, size):
    frames = noise(3, size)
    back = list(read_frames(write(tmp_path / "clip.mp4", frames)))
    np.testing.assert_array_equal(back, frames)


@pytest.mark.parametrize("size", [(48, 64), (47, 63)])
def test_colour_keeps_its_meaning(tmp_path, size):
    """Even sizes are 4:2:0, so colours are compared where they are even over many pixels."""
    colours = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [9, 99, 199]])
    frames = np.broadcast_to(colours[:, None, None], (5, *size, 3)).astype(np.uint8)
    path = write(tmp_path / "clip.mp4", frames)
    back = np.array(list(read_frames(path, colour=True)))
    assert back.shape == frames.shape
    assert np.abs(back.astype(int) - frames).max() <= 2
    grey = np.array(list(read_frames(path)))
    luma = colours @ [0.299, 0.587, 0.114]  # BT.601, full range
    assert np.abs(grey - luma[:, None, None]).max() <= 1


def test_no_row_or_column_is_lost_at_odd_sizes_in_colour(tmp_path):
    frames = np.zeros((2, 9, 11, 3), np.uint8)
    frames[:, -1, -1] = 255
    back = next(read_frames(write(tmp_path / "clip.mp4", frames), colour=True))
    assert back[-1, -1].min() > 250
    assert back[:-1, :-1].max() < 5


def test_mono_film_can_be_read_as_rgb(tmp_path):
    frames = noise(2, (16, 16))
    path = write(tmp_path / "clip.mp4", frames)
    np.testing.assert_array_equal(
        list(read_frames(path, colour=True)), np.repeat(frames[..., None], 3, axis=3)
    )


def test_lossy_is_smaller_and_near(tmp_path):
    y, x = np.mgrid[:64, :64]
    frames = np.array([128 + 100 * np.sin((x + k) / 9) * np.cos(y / 7) for k in range(8)])
    frames = frames.astype(np.uint8)
    exact, near = write(tmp_path / "a.mp4", frames), write(tmp_path / "b.mp4", frames, crf=20)
    assert near.stat().st_size < exact.stat().st_size
    error = np.array(list(read_frames(near))).astype(float) - frames
    assert 0 < np.sqrt(np.mean(error**2)) < 4


@pytest.mark.parametrize(
    ("start", "stop"),
    [(0, None), (0, 5), (1, 4), (11, 13), (12, 15), (23, 61), (99, None), (100, None)],
)
def test_any_range_is_exact_and_frames_outlive_the_reading(film, start, stop):
    path, frames = film
    back = list(read_frames(path, start=start, stop=stop))
    assert len(back) == len(frames[start:stop])
    for one, other in zip(back, frames[start:stop], strict=True):
        np.testing.assert_array_equal(one, other)


def test_spread_frames_are_exact(film):
    path, frames = film
    wanted = [0, 0, 3, 31, 32, 90, 99]
    np.testing.assert_array_equal(list(read_chosen_frames(path, wanted)), frames[wanted])
    with pytest.raises(ValueError, match="ascend"):
        next(read_chosen_frames(path, [3, 1]))


def test_grey_frames_are_not_to_be_written_to(film):
    """They show the memory from which the decoder predicts the next frame."""
    frame = next(read_frames(film[0]))
    with pytest.raises(ValueError, match="read-only"):
        frame[0, 0] = 0


def test_rate_and_order_are_in_the_file(film):
    with av.open(str(film[0])) as container:
        stream = container.streams.video[0]
        assert stream.average_rate == RATE
        assert stream.frames == 100


FRESH = """
    import sys
    from fractions import Fraction
    from pathlib import Path
    import numpy as np
    from finloop.io.movie import VideoWriter
    y, x = np.mgrid[:240, :320]
    path = Path(sys.argv[1])
    with VideoWriter(path, 320, 240, Fraction(25), crf=15) as writer:
        for k in range(6):
            wave = 120 + 60 * np.sin((x + 3 * k) / 9) * np.cos((y - 2 * k) / 11)
            writer.write(wave.astype(np.uint8))
    sys.stdout.buffer.write(path.read_bytes())
"""


def test_same_frames_give_the_same_bytes_whatever_lay_in_the_memory_before(tmp_path):
    # glibc fills memory that is given out with the complement of the number, and that is given back
    # with the number: a long-lived process has such rubbish everywhere, a fresh one zeros.
    def write_clip(rubbish):
        return subprocess.run(
            [sys.executable, "-c", textwrap.dedent(FRESH), tmp_path / "clip.mp4"],
            env=os.environ | {"MALLOC_PERTURB_": str(rubbish)},
            capture_output=True,
            check=True,
        ).stdout

    assert len(zeros := write_clip(0)) > 1000
    assert write_clip(1) == zeros


@pytest.mark.parametrize("bad", [np.zeros((8, 8), np.uint8), np.zeros((16, 16), np.int32)])
def test_a_frame_of_another_shape_is_refused(tmp_path, bad):
    with (
        pytest.raises(ValueError, match="wanted"),
        VideoWriter(tmp_path / "clip.mp4", 16, 16, RATE) as writer,
    ):
        writer.write(bad)
    assert not list(tmp_path.iterdir())


# --- whole or not at all


def test_nothing_is_left_of_an_unfinished_clip(tmp_path):
    path = write(tmp_path / "clip.mp4", noise(2, (16, 16)))
    before = path.read_bytes()
    with pytest.raises(KeyboardInterrupt), VideoWriter(path, 16, 16, RATE) as writer:
        for frame in noise(20, (16, 16)):
            writer.write(frame)
        assert len(list(tmp_path.iterdir())) == 2  # so there is something to remove
        raise KeyboardInterrupt
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize("count", [1, 100])
def test_a_full_disk_is_said_and_nothing_is_left(tmp_path, monkeypatch, count):
    """One frame fails when the file is closed, a hundred on the way."""
    opened = av.open
    monkeypatch.setattr(av, "open", lambda _, *args, **named: opened("/dev/full", *args, **named))
    with pytest.raises(FinloopError, match="disk is full"):
        write(tmp_path / "clip.mp4", noise(count, (64, 64)))
    assert not list(tmp_path.iterdir())


def test_what_a_killed_process_left_is_removed_and_what_a_running_one_writes_is_not(tmp_path):
    leaves = """
        import sys, os
        from pathlib import Path
        from finloop.io.atomic import whole_file, whole_folder
        with whole_folder(Path(sys.argv[1]) / "render") as one, whole_file(Path(sys.argv[1]) / "a.b") as two:
            (one / "film.mp4").touch(), two.touch()
            print(flush=True), sys.stdin.readline()
            os.kill(os.getpid(), 9)
    """
    command = [sys.executable, "-c", textwrap.dedent(leaves), str(tmp_path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=Path(__file__).parents[1]
    ) as process:
        assert process.stdout.readline()
        atomic.save_bytes(tmp_path / "c", b"")
        assert len(list(tmp_path.iterdir())) == 3
        process.communicate(b"\n")
    assert len(list(tmp_path.iterdir())) == 3
    atomic.save_bytes(tmp_path / "c", b"")
    assert [path.name for path in tmp_path.iterdir()] == ["c"]


def test_whole_folder_replaces_or_leaves(tmp_path):
    folder = tmp_path / "clip"
    for text in ("old", "new"):
        with atomic.whole_folder(folder) as part:
            (part / "inner").mkdir()
            (part / "inner/a.txt").write_text(text)
    with pytest.raises(FinloopError, match="disk is full"), atomic.whole_folder(folder) as part:
        (part / "b.txt").write_text("half")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert [path.name for path in tmp_path.iterdir()] == ["clip"]
    assert (folder / "inner/a.txt").read_text() == "new"


# --- a clip that is not as it was written


def remux(source: Path, target: Path, left_out: int = -1) -> Path:
    """Copy a film of 100 frames with its index in front, perhaps without one frame."""
    options = {"movflags": "faststart"}
    with av.open(str(source)) as film, av.open(str(target), "w", options=options) as copy:
        stream = copy.add_stream_from_template(film.streams.video[0])
        skipped = film.streams.video[0].duration * left_out // 100
        for packet in film.demux(video=0):
            if packet.dts is not None and packet.pts != skipped:
                packet.stream = stream
                copy.mux(packet)
    return target


def test_a_missing_frame_is_said(tmp_path, film):
    with pytest.raises(FinloopError, match="normalised clip"):
        list(read_frames(remux(film[0], tmp_path / "clip.mp4", left_out=5)))


def test_an_early_end_is_said(tmp_path, film):
    """The index is whole, the data behind it are not."""
    short = remux(film[0], tmp_path / "clip.mp4")
    with av.open(str(short)) as container:
        at = [packet.pos for packet in container.demux(video=0)][50]
    short.write_bytes(short.read_bytes()[:at])
    with pytest.raises(FinloopError, match="it ends before frame"):
        list(read_frames(short))
    assert len(list(read_frames(short, stop=20))) == 20


# --- facts and masks


def test_facts_come_back(tmp_path):
    save_facts(tmp_path / "facts.json", FACTS)
    assert load_facts(tmp_path / "facts.json") == FACTS
    record = json.loads((tmp_path / "facts.json").read_text())
    assert record["frame_rate"] == "2807/100"
    assert record["frame_rate_hz"] == 28.07
    assert record["segments"] == [[0, 3], [3, 7]]


@pytest.mark.parametrize("text", ["{}", '{"source": "file"}'])
def test_broken_or_unknown_facts_are_said(tmp_path, text):
    path = tmp_path / "facts.json"
    path.write_text(text)
    with pytest.raises(FinloopError, match="facts of a clip"):
        load_facts(path)
    save_facts(path, FACTS)
    path.write_text(path.read_text().replace('"source"', '"origin"'))
    with pytest.raises(FinloopError, match="origin"):
        load_facts(path)


def test_masks_come_back_and_bad_ones_are_said(tmp_path):
    mask, path = noise(1, (9, 13))[0] > 128, tmp_path / "arena.png"
    save_mask(path, mask)
    np.testing.assert_array_equal(load_mask(path, 13, 9), mask)
    path.unlink()
    with pytest.raises(FinloopError, match="there is no mask picture"):
        load_mask(path, 13, 9)
    save_mask(path, np.ones((9, 14), bool))
    with pytest.raises(FinloopError, match=r"is 14×9 pixels\n.*13×9"):
        load_mask(path, 13, 9)
