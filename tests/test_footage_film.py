"""Real film of animals, where it is at hand: some seconds of each through all three stages.

The clips are not part of this repository; a test without its clip is skipped.
"""

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from scratch import prepare

import stages.clip
import stages.extract
import stages.features
from finloop.features.table import wrap_deg
from finloop.io.numbers import load_numbers
from finloop.io.wheel import PACKAGE, find_cache_folder

CLIPS = ROOT.parent / "shared" / "clips"
ZEBRAFISH = find_cache_folder() / f"{PACKAGE.replace('==', '-')}-test_A.avi"


@pytest.fixture
def shot(tmp_path, monkeypatch):
    """Run a film through the stages: its numbers, and its feature table."""

    def run(path, *overrides):
        if not path.exists():
            pytest.skip(f"{path.name} is not at hand")
        prepare(tmp_path, "clip=file", f"clip.path={path}", *overrides)
        monkeypatch.chdir(tmp_path)
        for stage in (stages.clip, stages.extract, stages.features):
            stage.main()
        numbers = {}
        for word in ("clip", "extract", "features"):
            numbers |= load_numbers(tmp_path / f"reports/{word}")
        return numbers, pd.read_parquet(tmp_path / "data/features/features.parquet")

    return run


def test_zebrafish(shot):
    numbers, table = shot(ZEBRAFISH, "clip.end_s=3")
    assert numbers["frames"] == 85
    assert numbers["fish_frames"] > 0.95 * 8 * numbers["frames"]  # eight fish, a few touch
    assert numbers["fish_frames_in_tracks_of_60_frames"] > 0.6 * 8 * numbers["frames"]
    assert table.groupby("frame").size().max() == 8
    assert numbers["body_length_median_px"] == pytest.approx(65, abs=4)
    assert numbers["headed_along_travel_pct"] >= 99
    assert numbers["heading_off_travel_median_deg"] < 8
    step = table.groupby("track_id")[["x_px", "y_px"]].diff()
    # At frame 21 all are startled and dart off, more than a body length a frame, as themselves.
    assert 65 < np.nanmax(np.hypot(step["x_px"], step["y_px"])) < 80


def test_mouse(shot):
    numbers, table = shot(CLIPS / "mouse.mp4", "clip.start_s=60", "clip.end_s=62")
    assert numbers["tracks"] == 1
    assert numbers["fish_frames"] == numbers["frames"] == 60
    assert numbers["head_confidence_min"] > 0.99
    assert numbers["headed_along_travel_pct"] >= 95
    turned = np.abs(wrap_deg(np.diff(table["heading_deg"])))
    assert turned.max() < 60  # head and tail are never exchanged, nor is the tail lost


@pytest.mark.parametrize(("name", "frames"), [("trout.avi", 57), ("sunfish.avi", 60)])
def test_fish_that_swim_in_place(shot, name, frames):
    # Side by side with the current, heads to the left; the sunfish spreads its pectoral fins.
    numbers, table = shot(CLIPS / name, "extract.background=threshold", f"clip.end_s={frames / 10}")
    assert numbers["tracks"] == 1
    assert numbers["fish_frames"] == numbers["frames"] == frames
    assert np.abs(wrap_deg(table["heading_deg"] - 180)).max() < 10
    assert numbers["head_confidence_min"] > 0.99
    assert numbers["straight_pct"] == 100
    assert table["body_length_px"].std() < 0.03 * table["body_length_px"].mean()
    # The tail beats to both sides, in a wave: the bend changes its sign.
    assert table["bend"].min() < -0.005
    assert table["bend"].max() > 0.005
