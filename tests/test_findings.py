"""What would be better filmed otherwise: each fault is found in a film that has it, and no other."""

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from scipy.special import erf
from scratch import carp_frames, write_frames
from toy_insect import WalkerFilm, walker_frames

from finloop.base.parallel import ALONE
from finloop.base.settings import settings
from finloop.clip.rewrite import make_clip
from finloop.clip.verdict import list_findings as judge_film
from finloop.clip.write import open_clip_source
from finloop.extract.samples import measure_edge_width
from finloop.extract.segment import Silhouette
from finloop.extract.table import tracks_schema
from finloop.extract.verdict import list_findings as judge_animals
from finloop.extract.verdict import measure_area_jumps, measure_area_range
from finloop.extract.write import extract_tracks
from finloop.features.metrics import (
    measure_frames_per_beat,
    measure_heading_jumps,
    summarize_features,
)
from finloop.features.table import measure_features, wrap_deg
from finloop.features.verdict import list_findings as judge_headings
from finloop.io.movie import Mp4Writer, VideoWriter
from finloop.io.table import load_table

SIZE = {"width_px": 320, "height_px": 240, "body_length_px": 60.0}


@pytest.fixture(scope="module")
def carp() -> list[np.ndarray]:
    """Two seconds of a carp."""
    return carp_frames(50, **SIZE)


def faults(folder: Path, frames: list[np.ndarray], rate: float = 25, crf: int = 0) -> set[str]:
    """What finloop finds fault with in a film of these frames."""
    path, clip, tracks = folder / "film.mp4", folder / "clip", folder / "tracks"
    height, width = frames[0].shape
    if crf:
        rgb = [np.repeat(frame[..., None], 3, axis=2) for frame in frames]
        write_frames(Mp4Writer(path, rgb[0].shape, Fraction(rate), crf), rgb)
    else:
        write_frames(VideoWriter(path, width, height, Fraction(rate), False), frames)
    clip.mkdir()
    tracks.mkdir()
    p = settings("clip", source="file", path=str(path))
    made = make_clip(p, open_clip_source(p), clip)
    findings = [*judge_film(made.quality)]
    p = settings("extract")
    extraction = extract_tracks(clip, p, tracks, ALONE)
    facts = vars(extraction.scene) | {
        f"silhouettes_{verdict.replace(' ', '_')}": extraction.verdicts[verdict]
        for verdict in ("fish", "at border")
    }
    facts |= {"area_jumps_pct": extraction.area_jumps_pct, "tank_grain_grey": 0.0}
    facts |= {"area_range": extraction.area_range} | extraction.light._asdict()
    findings += judge_animals(facts)
    table = load_table(tracks / "tracks.parquet", tracks_schema(p.points))
    features, _ = measure_features(table, made.facts.frame_rate_hz, settings("features"))
    findings += judge_headings(summarize_features(features))
    assert all(finding.text and (finding.good or finding.remedy) for finding in findings)
    return {finding.word for finding in findings if not finding.good}


def test_a_good_film_has_no_fault(tmp_path, carp):
    assert faults(tmp_path, carp) == set()


def test_a_film_of_a_tenth_of_the_rate_has_too_few_frames_in_a_beat(tmp_path):
    assert "rate" in faults(tmp_path, carp_frames(40, frame_rate_hz=2.5, **SIZE), rate=2.5)


SPOILT = {  # the fault, and a frame that has it
    "sharpness": lambda frame: cv2.GaussianBlur(frame, (0, 0), 3),
    "size": lambda frame: cv2.resize(frame, (160, 120), interpolation=cv2.INTER_AREA),
    "border": lambda frame: frame[40:170, 60:240].copy(),
}


@pytest.mark.parametrize("fault", SPOILT)
def test_a_film_that_is_blurred_small_or_cut_off_has_this_fault_alone(tmp_path, carp, fault):
    assert faults(tmp_path, [SPOILT[fault](frame) for frame in carp]) == {fault}


def test_an_animal_whose_tail_comes_and_goes_is_not_whole(tmp_path, carp):
    """In every seventh frame the part of the carp below its middle is lost."""
    tank = np.median(carp, axis=0).astype(np.uint8)
    for k in range(3, 50, 7):
        carp = [*carp[:k], carp[k].copy(), *carp[k + 1 :]]
        rows = np.flatnonzero((cv2.absdiff(carp[k], tank) > 40).any(axis=1))
        cut = int(rows[0] + 0.6 * np.ptp(rows))
        carp[k][cut:] = tank[cut:]
    assert faults(tmp_path, carp) == {"parts"}


def test_a_film_that_was_coded_too_small_is_coded_badly(tmp_path, carp):
    assert "coding" in faults(tmp_path, carp, crf=50)


@pytest.mark.parametrize(("leg_width", "bad"), [(0.05, False), (0.08, True)])
def test_an_animal_whose_backbone_runs_into_its_legs_has_no_heading(tmp_path, leg_width, bad):
    film = WalkerFilm(body_length_px=40.0, leg_width=leg_width)
    assert ("heading" in faults(tmp_path, [*walker_frames(film)])) == bad


@pytest.mark.parametrize(("ahead_pct", "good"), [(8.2, False), (99.8, True)])
def test_heads_that_travel_backwards_are_doubtful(ahead_pct, good):
    metrics = {"headed_along_travel_pct": ahead_pct, "heading_jumps_pct": 0, "frames_per_beat": 8}
    (finding,) = (f for f in judge_headings(metrics) if f.word == "head")
    assert finding.good == good and f"{ahead_pct:.0f} %" in finding.text


@pytest.mark.parametrize("word", ["black", "white"])
def test_an_animal_without_a_grey_level_is_not_exposed(tmp_path, carp, word):
    """The carp is darker than its tank."""
    middle = float(np.median(carp[0]))
    spoilt = []
    for frame in carp:
        level = (frame.astype(float) - middle) * 3
        level = middle + level if word == "black" else 255 - middle - level
        spoilt.append(np.clip(level, 0, 255).astype(np.uint8))
    assert word in faults(tmp_path, spoilt)


# --- the measures


def bends(values: np.ndarray) -> pd.DataFrame:
    """Features of one animal that bends so."""
    return pd.DataFrame({"track_id": 0, "frame": np.arange(len(values)), "bend": values})


@pytest.mark.parametrize("frames", [2.5, 4.0, 7.3, 30.0])
def test_a_sine_has_its_frames_in_a_beat(frames):
    beat = bends(0.1 * np.sin(2 * np.pi * np.arange(3000) / frames + 0.4))
    assert measure_frames_per_beat(beat) == pytest.approx(frames, rel=0.01)


def test_what_does_not_bend_has_no_beat():
    assert np.isnan(measure_frames_per_beat(bends(np.zeros(9))))
    assert np.isnan(measure_frames_per_beat(bends(np.ones(2))))
    unknown = {"heading_jumps_pct": np.nan, "frames_per_beat": np.nan}
    assert not [*judge_headings(unknown)]


def headings(*tracks: list[float]) -> pd.DataFrame:
    """Features of animals that head so, a track each."""
    number = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
    frame = np.concatenate([np.arange(len(track)) for track in tracks])
    heading_deg = wrap_deg(np.concatenate(tracks))
    return pd.DataFrame({"track_id": number, "frame": frame, "heading_deg": heading_deg})


@pytest.mark.parametrize("turned_deg", [0.0, 100.0, -170.0])
def test_jumps_of_a_heading_are_counted_whichever_way_it_points(turned_deg):
    steady, jumpy = np.full(4, turned_deg), turned_deg + np.array([0, 40, 90, 90.0])
    assert measure_heading_jumps(headings(steady, jumpy)) == pytest.approx(100 / 6)


def test_between_tracks_no_heading_jumps():
    assert measure_heading_jumps(headings([0.0, 0.0], [180.0, 180.0])) == 0
    assert np.isnan(measure_heading_jumps(headings([0.0], [180.0])))


def test_an_area_jumps_if_it_is_off_for_a_frame_or_two():
    frame = np.arange(40)
    grown = 100 * 1.04**frame  # as an animal that comes nearer
    off = grown.copy()
    off[[7, 8, 20]] *= [1.3, 1.3, 0.8]
    track = np.repeat([0, 1], 40)
    both = np.concatenate([grown, off])
    shuffled = np.random.default_rng(0).permutation(80)
    jumps = measure_area_jumps(track[shuffled], np.tile(frame, 2)[shuffled], both[shuffled])
    assert jumps == pytest.approx(100 * 3 / 72)
    assert measure_area_jumps(np.zeros(40, int), frame, grown) == 0
    assert np.isnan(measure_area_jumps(np.zeros(40, int), 2 * frame, off))
    assert np.isnan(measure_area_jumps(np.arange(3), frame[:3], off[:3]))


def test_the_area_range_is_that_of_the_median_track():
    area = np.concatenate([np.full(40, 100.0), np.linspace(100, 200, 101)])
    track = np.repeat([0, 1], [40, 101])
    order = np.random.default_rng(0).permutation(141)
    assert measure_area_range(track[order], area[order]) == pytest.approx(190 / 110)
    assert measure_area_range(track[:81], area[:81]) == pytest.approx(1.36 / 1.04, rel=0.01)
    assert measure_area_range(track[:70], area[:70]) == 1


@pytest.mark.parametrize("contrast", [40.0, 200.0])
@pytest.mark.parametrize("sigma", [3.0, 5.0])
def test_an_outline_is_as_wide_as_its_blur(contrast, sigma):
    """The steepest slope of a blurred step is contrast / (σ √2π)."""
    x = np.arange(80)[None] - np.array([[19.5], [60.5]])
    step = (1 + erf(np.array([[1], [-1]]) * x / sigma / 2**0.5)) / 2
    field = np.repeat(np.rint(contrast * step.prod(axis=0))[None], 9, axis=0).astype(np.uint8)
    found = Silhouette(0, 0, field > contrast / 3, field, contrast, 400.0, False)
    assert measure_edge_width(found) == pytest.approx(sigma * (2 * np.pi) ** 0.5, rel=0.1)
