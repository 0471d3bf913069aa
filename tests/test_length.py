"""A film that is one frame longer gives the same result, but for that frame."""

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from scratch import write_frames

from finloop.base.parallel import ALONE
from finloop.base.settings import settings
from finloop.clip.rewrite import make_clip
from finloop.clip.write import open_clip_source
from finloop.extract.samples import measure_scene_and_fish
from finloop.extract.write import extract_tracks
from finloop.io.movie import VideoWriter
from finloop.io.video import CLIP_NAME, read_chosen_frames


def worm_in_its_place(count: int) -> list[np.ndarray]:
    """A bright worm on black that creeps by less than its length, and wriggles."""
    along = np.linspace(-1, 1, 41)
    frames = []
    for k in range(count):
        x = 170 + 34 * along + 22 * np.sin(k / 17)
        y = 120 + 10 * np.sin(3 * along + k / 4) + 16 * np.cos(k / 9)
        frame = np.zeros((240, 340), np.uint8)
        for px, py, half in zip(x, y, 6 * np.sqrt(1 - 0.9 * along**2), strict=True):
            cv2.circle(frame, (round(px * 16), round(py * 16)), round(half * 16), 150, -1, shift=4)
        frames.append(cv2.GaussianBlur(frame, (0, 0), 1.2))
    return frames


def fish_on_a_circle(count: int, floor: float, level: float) -> np.ndarray:
    """Pictures (count, h, w) float32 of a fish that swims on a circle, over an even floor."""
    frames = np.full((count, 260, 320), floor, np.float32)
    for k, frame in enumerate(frames):
        turn = k / 11
        middle = 160 + 80 * np.cos(turn), 130 + 70 * np.sin(turn)
        cv2.ellipse(frame, (middle, (18, 60), np.degrees(turn) + 6 * np.sin(k)), level, -1)
        ahead = middle[0] - 26 * np.sin(turn), middle[1] + 26 * np.cos(turn)
        cv2.circle(frame, (round(ahead[0]), round(ahead[1])), 8, level, -1)
    return frames


def dark_ground(count: int) -> list[np.ndarray]:
    """A fish whose brightness changes, over black."""
    frames = fish_on_a_circle(count, 3, 1)
    shine = 150 + 60 * np.sin(np.arange(count) / 2)
    return [np.where(f < 2, s, f).astype(np.uint8) for f, s in zip(frames, shine, strict=True)]


def flicker(count: int) -> list[np.ndarray]:
    """A dark fish in light that flickers by a tenth."""
    light = np.random.default_rng(1).uniform(0.9, 1.1, count)[:, None, None]
    return [*np.rint(fish_on_a_circle(count, 130, 40) * light).astype(np.uint8)]


def following_crop(count: int) -> list[np.ndarray]:
    """A picture that follows a fish over black, some frames late, past another fish."""
    frames = []
    for k, frame in enumerate(fish_on_a_circle(count, 3, 180)):
        x, y = 160 + 80 * np.cos((k - 4) / 11), 130 + 70 * np.sin((k - 4) / 11)
        cv2.ellipse(frame, ((250 - 2.0 * k, 130.0 + k), (10, 36), 4.0 * k), 220, -1)
        padded = cv2.copyMakeBorder(frame, 80, 80, 80, 80, cv2.BORDER_CONSTANT, value=3)
        frames.append(padded[round(y) : round(y) + 160, round(x) : round(x) + 160].astype(np.uint8))
    return frames


@pytest.mark.parametrize("draw", [worm_in_its_place, dark_ground, flicker, following_crop])
def test_a_frame_more_changes_no_other(tmp_path: Path, draw):
    rows, mended, looks = [], [], []
    for count in (45, 46):
        folder = tmp_path / str(count)
        clip, tracks = folder / "clip", folder / "tracks"
        clip.mkdir(parents=True)
        tracks.mkdir()
        frames = draw(count)
        height, width = frames[0].shape
        film = VideoWriter(folder / "film.mp4", width, height, Fraction(25), False)
        write_frames(film, frames)
        p = settings("clip", source="file", path=str(folder / "film.mp4"))
        mended.append(make_clip(p, open_clip_source(p), clip).mended)
        some = read_chosen_frames(clip / CLIP_NAME, [*range(0, 45, 10)], colour=False)
        looks.append(np.array([*some]))
        rows.append(extract_tracks(clip, settings("extract"), tracks, ALONE).lengths.total())
    assert len(set(mended)) == 1
    assert max(np.abs(look - looks[0].astype(float)).mean() for look in looks) < 1
    assert np.ptp(np.array(rows) - [45, 46]) <= 2, rows
    assert min(rows) >= 40


def test_a_pale_ghost_of_one_side_is_no_part_of_the_tank():
    """A bright animal whose head is in one place in every other frame: the median holds it."""
    frames = []
    for k in range(25):
        x, y = (100, 120) if k % 2 == 0 else (250, 100 + k)
        turn = np.sin(2.0 * k)
        frame = np.zeros((240, 420), np.uint8)
        tail = round(x + 100 * np.cos(turn)), round(y + 100 * np.sin(turn))
        cv2.line(frame, (x, y), tail, 150, 13)
        cv2.circle(frame, (x, y), 11, 70, -1)
        frames.append(cv2.GaussianBlur(frame, (0, 0), 1))
    arena = np.full(frames[0].shape, 255, np.uint8)
    scene, _ = measure_scene_and_fish(frames, arena, settings("extract"))
    assert scene.polarity == "bright" and scene.background.max() < 10
