"""The pictures of faults of the film: each shows the frame and the place of its fault."""

from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
from scratch import prepare, write_frames

import stages.clip
import stages.extract
import stages.plots.findings
from finloop.base.settings import settings
from finloop.extract.background import Polarity, Scene
from finloop.extract.samples import TypicalFish
from finloop.io.findings import load_faults
from finloop.io.movie import VideoWriter
from finloop.io.picture import load_picture
from finloop.plots.findings import MARK, FaultPicture, draw_animal_fault, draw_film_fault

TANK = np.full((120, 160), 200, np.uint8)


def with_animal(left: int, top: int, level: int = 60) -> np.ndarray:
    """A frame with an animal of 24 × 8 px."""
    frame = TANK.copy()
    frame[top : top + 8, max(left, 0) : left + 24] = level
    return frame


def draw(word: str, frames: list[np.ndarray], tank=TANK, **columns: list[float]):
    """The picture of a fault of these frames, at 2 Hz."""
    nothing = dict.fromkeys(("shift_x", "shift_y", "change", "field_order"), 0.0)
    table = pd.DataFrame({"light": [1.0] * len(frames)} | nothing).assign(**columns)
    return draw_film_fault(word, table, 2.0, tank, lambda numbers: (frames[k] for k in numbers))


def draw_animal(word: str, frames: list[np.ndarray], tank=TANK) -> FaultPicture | None:
    """The picture of a fault of the animals of these frames."""
    polarity: Polarity = "dark" if tank.mean() > 128 else "bright"
    scene, arena = Scene(tank, polarity, 1.0, 6.0), np.full(tank.shape, 255, np.uint8)
    typical = TypicalFish(24 * 8, 24.0, 140.0, "none")
    labelled = [(f"frame {number}", frame) for number, frame in enumerate(frames)]
    return draw_animal_fault(word, labelled, scene, typical, arena, settings("extract"))


def find_marks(picture: np.ndarray) -> np.ndarray:
    """Which pixels have the colour of a mark."""
    return (picture == MARK).all(axis=-1)


# --- faults of the film


def test_flicker_is_shown_as_halves_of_two_successive_frames():
    frames = [TANK, TANK, TANK // 2, TANK // 2]
    shown = draw("flicker", frames, light=[1.0, 1.0, 0.5, 0.5])
    assert shown.caption == "Left half: frame 1; right half: frame 2."
    assert (shown.picture[120, 10, 0], shown.picture[120, -10, 0]) == (200, 100)


def test_drift_is_shown_in_the_darkest_and_the_brightest_time_and_no_flash_counts():
    light = np.r_[np.linspace(1, 1.5, 20), np.linspace(1.5, 0.7, 20)]
    light[5] = 2.0
    shown = draw("drift", [TANK] * 40, light=light)
    first, second = (int(part.split("frame ")[1].strip(".")) for part in shown.caption.split(";"))
    assert 15 <= first <= 24 and second >= 35


def test_shake_is_shown_in_the_frame_that_moved_farthest_unless_it_is_less_than_a_pixel():
    rng = np.random.default_rng(1)
    tank = np.kron(rng.integers(60, 200, (12, 16)), np.ones((10, 10))).astype(np.uint8)
    frames = [tank, np.roll(tank, 3, axis=1), np.roll(tank, 1, axis=1), tank, tank]
    shown = draw("shake", frames, tank, shift_x=[0.0, 3.0, 1.0, 0.0, 0.0])
    assert shown.caption.startswith("Frame 1 ") and "3 px" in shown.caption
    assert np.ptp(shown.picture[..., 0].astype(int) - shown.picture[..., 1]) > 100  # coloured edges
    assert (shown.picture[..., 1] == shown.picture[..., 2]).all()
    assert draw("shake", frames, tank, shift_x=[0.0, 0.5, 0.3, 0.0, 0.0]) is None


def test_a_repeated_frame_is_shown_beside_those_before_and_after():
    frames = [with_animal(left, 50) for left in (20, 40, 60, 60, 80)]
    shown = draw("doubled", frames, change=[np.nan, 9.0, 9.0, 0.0, 9.0])
    assert shown.caption.startswith("Frames 2, 3 and 4")
    before, repeat, after = np.hsplit(shown.picture, 3)
    assert (before == repeat).all() and not (repeat == after).all()
    assert (repeat == 60).any()  # the animal


def test_interlaced_rows_are_shown_where_most_moves():
    woven = with_animal(30, 50)
    woven[1::2] = with_animal(40, 50)[1::2]
    shown = draw("interlaced", [TANK, TANK, woven], field_order=[np.nan, 0.0, 0.7])
    assert shown.caption.startswith("Frame 2")
    rows = (shown.picture[..., 0] == 60).sum(axis=1)
    assert len(np.unique(rows)) > 1 and rows.any()


# --- faults of the animals


def test_the_largest_animal_that_is_cut_off_is_outlined():
    frames = [with_animal(60, 50), with_animal(-6, 50), with_animal(-12, 50)]
    shown = draw_animal("border", frames)
    assert shown is not None and shown.caption == "What is cut off, outlined: frame 1."
    assert find_marks(shown.picture)[:, :40].any() and (shown.picture == 60).any()
    assert draw_animal("border", frames[:1]) is None


@pytest.mark.parametrize(("word", "turn"), [("black", np.array), ("white", np.invert)])
def test_what_is_plain_is_outlined_where_most_of_an_animal_is_plain(word, turn):
    half = with_animal(60, 50)
    half[50:58, 60:72] = 0
    few = with_animal(10, 50)
    few[52:54, 12:16] = 0
    frames = [turn(frame) for frame in (with_animal(10, 50), few, half)]
    shown = draw_animal(word, frames, turn(TANK))
    assert shown is not None and shown.caption == f"What is plain {word}, outlined: frame 2."
    y, x = np.nonzero(find_marks(shown.picture))
    assert np.ptp(x) == pytest.approx(np.ptp(y) * 11 / 7, rel=0.15)  # 12 × 8 px
    assert draw_animal(word, frames[:1], turn(TANK)) is None


@pytest.mark.parametrize("word", ["size", "sharpness", "contrast", "coding"])
def test_an_animal_of_typical_area_is_outlined(word):
    large = with_animal(60, 50) & with_animal(60, 54)
    shown = draw_animal(word, [TANK, large, with_animal(60, 50)])
    assert shown is not None and shown.caption.endswith("frame 2.")
    columns = np.flatnonzero(find_marks(shown.picture).any(axis=0))
    assert np.ptp(columns) == pytest.approx(23 * 5, abs=8)  # 64 px of the frame are 320
    assert draw_animal(word, [TANK]) is None


def test_a_fault_of_the_whole_film_has_no_picture():
    frames = [with_animal(60, 50)] * 2
    assert draw("rate", frames) is None and draw_animal("rate", frames) is None


# --- the stage


def run_stages(folder, film: list[np.ndarray], *more_films: list[np.ndarray]) -> None:
    """Make clips of films, follow their animals, and draw the faults."""
    for number, frames in enumerate((film, *more_films)):
        path = folder / f"films/{number}.mp4"
        path.parent.mkdir(exist_ok=True)
        height, width = frames[0].shape
        write_frames(VideoWriter(path, width, height, Fraction(25), False), frames)
    prepare(folder, "clip=file", "clip.path=films", "extract.min_track_frames=5")
    stages.clip.main()
    stages.extract.main()
    stages.plots.findings.main()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def swim(level: int) -> list[np.ndarray]:
    """A film of an animal of a grey level that swims through the tank."""
    rng = np.random.default_rng(1)
    tank = np.clip(TANK + rng.normal(0, 2, TANK.shape), 0, 255).astype(np.uint8)
    frames = []
    for left in range(10, 110, 4):
        frame = tank.copy()
        frame[50:60, left : left + 40] = level
        frames.append(frame)
    return frames


def test_each_fault_of_each_film_that_is_seen_in_a_frame_has_a_picture(folder):
    run_stages(folder, swim(60), swim(0))
    home = folder / "reports/film/findings"
    table = pd.read_csv(home / "pictures.csv", dtype=str)
    black = table[table["what"] == "black"]
    assert black[["film", "picture"]].to_numpy().tolist() == [["1", "1_black.png"]]
    assert black["caption"].item().startswith("What is plain black, outlined: 1 frame ")
    faults = load_faults([folder / "data/clip", folder / "data/extract"])
    assert {*zip(table["film"], table["what"], strict=True)} <= {
        *zip(faults["film"], faults["what"], strict=True)
    }
    for name in table["picture"]:
        assert load_picture(home / name).shape == (240, 320, 3)
    assert len([*home.iterdir()]) == 1 + len(table)


def test_without_a_fault_nothing_is_written(folder):
    run_stages(folder, swim(60))
    assert load_faults([folder / "data/clip", folder / "data/extract"]).empty
    assert not (folder / "reports/film").exists()
