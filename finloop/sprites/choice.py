"""The choice of film frames for sprites (fish paper §3.3, which makes it by hand).

Four sequences: *straight* (one full tail beat whose end meets its beginning), *slide* (gliding with
a still tail, also a loop), and the strongest *left* and *right* turns, from nearly straight through
the bend back to nearly straight. Candidates are runs of successive frames of one track; each has
faults, by name, of which 1 is just acceptable. The candidate with the smallest sum of faults is
chosen, so its faults explain the choice. Only the best candidates are compared as pictures.

A side is 1 (left) or −1 (right). `delta` is Δ in frames; `table` is from `swimmer_table`.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Reals
from finloop.base.axes import to_body_axes
from finloop.base.errors import FinloopError
from finloop.base.stretches import spread_rows
from finloop.distance.picture import paired_distances, successive_distances
from finloop.features.current import places_through_water
from finloop.features.swimming_type import LEFT, RIGHT, STRAIGHT
from finloop.sprites.settings import SpritesSettings

SIDES = {"left": LEFT, "right": RIGHT}
SEQUENCES = ("straight", "slide", *SIDES)
"""The sequences of sprites."""

_SAMPLE = 200  # frames that give the clip's median sharpness; more do not change it

Rows = NDArray[np.intp]
DrawPictures = Callable[[Rows, Reals], NDArray[np.float32]]
"""Rows of the table of swimmers and a heading for each → pictures (n, size, size, channels) of
these fish, headed right, their mass centres in the middle, all of one length."""


# -- the table of swimmers -------------------------------------------------------------------------


def swimmer_table(
    features: pd.DataFrame, tracks: pd.DataFrame, settings: SpritesSettings
) -> pd.DataFrame:
    """Measure every fish in every frame for the choice of sprites; return the table, a row each.

    The rows are those of `features` and `tracks`. tail: offset of the tail tip from the head's
    axis, body lengths, + = left; heading: degrees, unwrapped; step_x_px, step_y_px: displacement to
    the next frame, smoothed; speed: body lengths a frame; neighbour_bl: body lengths to the nearest
    other mass centre; size_fault: how far the animal's length is off the film's median, 1 = just
    acceptable; usable: whether the frame may become a sprite.
    """
    table = features.assign(area_px=tracks["area_px"], contrast=tracks["contrast"])
    table = table.reset_index(drop=True)
    by_track = table.groupby("track_id", sort=False)
    length = by_track["body_length_px"].transform("median").to_numpy()
    heading_rad = np.radians(table["heading_deg"].to_numpy(float))
    tail, head = (table[[f"{end}_x_px", f"{end}_y_px"]].to_numpy() for end in ("tail", "head"))
    # Displacements to the next frame; the last of a track is that of the frame before.
    path = pd.DataFrame(places_through_water(table)).groupby(table["track_id"], sort=False)
    place = path.transform(lambda x: smooth_series(x.to_numpy(float))).to_numpy()
    travel = np.diff(place, axis=0, append=place[-1:])
    is_last = (by_track.cumcount(ascending=False) == 0).to_numpy()
    travel[is_last] = travel[np.maximum(np.flatnonzero(is_last) - 1, 0)]
    neighbour_bl = _nearest_neighbour_px(table) / np.median(length)
    length_error = np.abs(table["body_length_px"].to_numpy() / length - 1)
    measured = ["bend", "area_px", "contrast"]
    copied = table[["track_id", "frame", "x_px", "y_px", "orientations", *measured]]
    return copied.astype(dict.fromkeys(measured, float)).assign(
        area_rel=table["motion_area_rel"].to_numpy(float),
        type=table["swimming_type"],
        heading=by_track["heading_deg"].transform(lambda h: np.unwrap(h.astype(float), period=360)),
        step_x_px=travel[:, 0],
        step_y_px=travel[:, 1],
        tail=to_body_axes((tail - head).astype(float), heading_rad)[:, 1] / length,
        speed=np.hypot(*travel.T) / length,
        length_px=length,
        neighbour_bl=neighbour_bl,
        size_fault=np.abs(length / np.median(table["body_length_px"]) - 1) / settings.size_off,
        usable=(table["head_confidence"].to_numpy() >= settings.min_head_confidence)
        & (length_error <= settings.length_off)
        & (neighbour_bl > settings.min_neighbour_distance_bl),
    )


def smooth_series(values: Reals) -> Floats:
    """Return a series (frames,) smoothed by the weights ¼, ½, ¼; straight lines stay the same."""
    extended = np.pad(np.asarray(values, float), 1, "reflect", reflect_type="odd")
    return scipy.ndimage.convolve1d(extended, [0.25, 0.5, 0.25])[1:-1]


def _nearest_neighbour_px(table: pd.DataFrame) -> Floats:
    """Return each fish's distance (rows,) [px] to the nearest other one in its frame, else inf."""
    nearest = np.empty(len(table))
    place = table[["x_px", "y_px"]].to_numpy()
    for rows in table.groupby("frame").indices.values():
        distances, _ = scipy.spatial.KDTree(place[rows]).query(place[rows], k=2)
        nearest[rows] = distances[:, 1]  # the nearest of all is the fish itself
    return nearest


# -- runs of frames --------------------------------------------------------------------------------


@dataclass(frozen=True)
class FrameRun:
    """Successive frames of one track that could become the sprites of a sequence.

    first, last: frame numbers, both included; rows: the same frames in the table of swimmers.
    """

    track_id: int
    first: int
    last: int
    rows: slice
    faults: dict[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.rows.stop - self.rows.start

    @property
    def cost(self) -> float:
        """Return the sum of these frames' faults; about 1 for each that is just acceptable."""
        return sum(self.faults.values())


def _parse_frame_run(table: pd.DataFrame, sequence: str, text: str, hold_share: float) -> FrameRun:
    """Return the run of frames that a setting `sprites.<sequence>_frames` lists in its text.

    text: "track:first-last", as "8:120-140". hold_share: share of the largest bend of a turn from
    which on a fish counts as holding it. FinloopError if the text or the track is wrong, frames are
    missing, or show no turn where one is wanted.
    """
    name = f"sprites.{sequence}_frames={text}"
    match = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*-\s*(\d+)\s*", text)
    if match is None:
        raise FinloopError(
            name, 'a track and its first and last frame, as "8:120-140"', "write it in this form"
        )
    number, first, last = map(int, match.groups())
    ids = table["track_id"].unique()
    track = np.flatnonzero(table["track_id"] == number)
    if not track.size:
        raise FinloopError(
            f"{name}: there is no track {number}",
            "one of " + ", ".join(map(str, ids[:40])) + (", …" if len(ids) > 40 else ""),
            "see reports/film/features/trajectories.png and data/features/features.parquet",
        )
    frames = table["frame"].to_numpy()[track]
    least = 3 if sequence in SIDES else 2
    if last - first + 1 < least:
        raise FinloopError(
            f"{name}: {max(0, last - first + 1)} frames", f"at least {least}", "list more frames"
        )
    rows = track[(frames >= first) & (frames <= last)]
    if len(rows) != last - first + 1:
        raise FinloopError(
            f"{name}: track {number} lacks {last - first + 1 - len(rows)} of these frames",
            f"frames within {frames[0]}-{frames[-1]}, where track {number} is",
            "list frames of that range, or another track",
        )
    run = FrameRun(number, first, last, slice(int(rows[0]), int(rows[-1]) + 1))
    if sequence in SIDES and "hold" not in turn_phases(table, run, SIDES[sequence], hold_share):
        raise FinloopError(
            f"{name}: the fish does not bend to the {sequence} between its first and last frame",
            f"frames before, during and after a bend to the {sequence}",
            "list frames of a turn to that side (see reports/film/features/fig7.png)",
        )
    return run


def turn_phases(table: pd.DataFrame, run: FrameRun, side: int, hold_share: float) -> list[str]:
    """Return the phase of each frame of a turn: "in", "hold" or "out"; ["none"] without a bend.

    The phase is "hold" while the fish is bent by at least the share `hold_share` of the largest
    bend, "in" before and "out" after.
    """
    bend = side * table["bend"].to_numpy()[run.rows]
    peak = int(bend.argmax())
    if bend[peak] <= 0 or peak in (0, len(bend) - 1):
        return ["none"]
    strong = bend >= hold_share * bend[peak]
    # The strong frames next to the peak; argmin finds the first that is not strong.
    first = peak - int(np.argmin(np.r_[strong[:peak][::-1], False]))
    last = peak + int(np.argmin(np.r_[strong[peak + 1 :], False]))
    first, last = max(first, 1), min(last, len(bend) - 2)
    return ["in"] * first + ["hold"] * (last - first + 1) + ["out"] * (len(bend) - 1 - last)


def cycle_headings(table: pd.DataFrame, first_row: int, frames: int) -> Floats:
    """Return headings [°] that change evenly over a run and the frame after it, (frames + 1,).

    They lie on a line: its mean over the run is the run's, its slope that from the run's first
    frame to the frame after it. first_row: of the run, in `table`; the row after the run must
    belong to its track.
    """
    heading = table["heading"].to_numpy()[first_row : first_row + frames + 1]
    # Both frames show the same phase of the tail beat, so the head's yaw, which a least-squares
    # line would follow, cancels.
    slope = (heading[-1] - heading[0]) / frames
    return heading[:-1].mean() + slope * (np.arange(frames + 1) - (frames - 1) / 2)


# -- candidates: tail beats and glides -------------------------------------------------------------
# A table of candidates has the columns start (row of the table of swimmers), length (frames) and
# one per fault. The frame after a candidate is of the same track: it is compared with the first.


def find_tail_beats(
    table: pd.DataFrame, delta_frames: int, settings: SpritesSettings
) -> pd.DataFrame:
    """Return the candidates for a tail beat: straight swimming with one wave of the tail.

    The result has a row per candidate, the columns of `_candidate_table`, and the fault "untypical
    beat". That says by how many octaves the range of the tail tip differs from the candidates'
    median. If no fish swims straight for the shortest beat, the result has neither rows nor
    columns.
    """
    least = max(settings.beat_frames, round(settings.beat_least * delta_frames))
    most = round(settings.beat_most * delta_frames)
    parts = []
    for runs in _find_straight_runs(table, least, most):
        tail = runs.values("tail")
        swing = np.maximum(np.ptp(tail, axis=1), 1e-6)
        faults = {
            "several waves": (1 - _share_of_one_wave(tail)) / (1 - settings.one_wave),
            "flicker": settings.flicker_frames / runs.frames,
            "lopsided": np.abs(tail.mean(1)) / swing / settings.lopsided,
        }
        parts.append(_candidate_table(runs, faults, settings).assign(swing=swing))
    if not parts:
        return pd.DataFrame()
    waves = pd.concat(parts, ignore_index=True)
    is_beat = waves["swing"].between(settings.min_tail_swing_bl, settings.max_tail_swing_bl)
    waves = waves[is_beat & (waves["several waves"] <= 1)]
    untypical = np.abs(np.log2(waves["swing"] / waves["swing"].median()))
    return waves.drop(columns="swing").assign(**{"untypical beat": untypical})


def _share_of_one_wave(values: Reals) -> Reals:
    """Return the share of each row's variance (k, n) that is one sine wave over its n values.

    By Parseval's theorem: power at the frequency 1 / n, divided by that at all but 0.
    """
    power = np.abs(np.fft.rfft(values, axis=1)) ** 2
    power[:, 1 : (values.shape[1] + 1) // 2] *= 2  # the spectrum's other half, which rfft omits
    return power[:, 1] / np.maximum(power[:, 1:].sum(1), 1e-12)


def find_glides(table: pd.DataFrame, delta_frames: int, settings: SpritesSettings) -> pd.DataFrame:
    """Return the candidates for a glide: straight swimming with a still tail.

    The columns are those of `_candidate_table`. Runs shorter than `slide_least` are included only
    if there are no longer ones, and those whose tail moves more than `tail_motion_bl` only if no
    tail is still.
    """
    least = max(3, round(settings.slide_least * delta_frames))
    most = max(3, round(settings.slide_most * delta_frames))
    typical_speed = max(float(table.loc[table["usable"], "speed"].median()), 1e-6)
    for shortest in sorted({least, max(3, least // 2), 3}, reverse=True):
        parts = []
        for runs in _find_straight_runs(table, shortest, most):
            tail, speed = runs.values("tail"), runs.values("speed").mean(1)
            faults = {
                "tail moves": np.ptp(tail, axis=1) / settings.tail_motion_bl,
                "tail aside": np.abs(tail.mean(1)) / settings.tail_motion_bl,
                "untypical speed": np.abs(np.log2(np.maximum(speed, 1e-6) / typical_speed)) / 2,
                "short": least / runs.frames,
            }
            parts.append(_candidate_table(runs, faults, settings))
        if parts:
            glides = pd.concat(parts, ignore_index=True)
            still = glides[glides["tail moves"] <= 1]
            return glides if still.empty else still
    return pd.DataFrame()


def _find_substitute_tail_beats(
    table: pd.DataFrame, delta_frames: int, settings: SpritesSettings
) -> pd.DataFrame:
    """Return glides that replace a missing tail beat, as candidates like those of `find_glides`.

    They are of straight frames, else of usable frames of any swimming type, else of any frames.
    """
    as_straight = table.assign(type=np.int8(STRAIGHT))
    for rows in (table, as_straight, as_straight.assign(usable=True)):
        if not (glides := find_glides(rows, delta_frames, settings)).empty:
            return glides
    return pd.DataFrame()


class StraightRuns(NamedTuple):
    """All runs of one length, in one track without a gap, of usable frames of straight swimming.

    track: the track's rows of the table of swimmers, the first of which is `offset`; frames: the
    length of a run; first (k,): where in the track each run begins. One such frame follows each.
    """

    track: pd.DataFrame
    offset: int
    frames: int
    first: Rows

    def values(self, column: str, following: int = 0) -> Reals:
        """Return a column's values in each run, and `following` frames after it, (k, frames)."""
        windows = sliding_window_view(self.track[column].to_numpy(), self.frames + following)
        return windows[self.first]


def _find_straight_runs(
    table: pd.DataFrame, least_frames: int, most_frames: int
) -> Iterator[StraightRuns]:
    """Yield the runs of usable frames of straight swimming, by track and length of the runs.

    The frame after each run is usable and straight, too: it tells whether the run closes.
    """
    is_suitable = ((table["type"] == STRAIGHT) & table["usable"]).to_numpy()
    for span in _unbroken_row_slices(table):
        for n in range(least_frames, min(most_frames, span.stop - span.start - 1) + 1):
            first = np.flatnonzero(sliding_window_view(is_suitable[span], n + 1).all(1))
            if first.size:
                yield StraightRuns(table.iloc[span], span.start, n, first)


def _unbroken_row_slices(table: pd.DataFrame) -> Iterator[slice]:
    """Yield a slice of rows for each longest run of successive frames of one track."""
    broken = (np.diff(table["track_id"]) != 0) | (np.diff(table["frame"]) != 1)
    edges = [0, *(np.flatnonzero(broken) + 1).tolist(), len(table)]
    yield from (slice(a, b) for a, b in pairwise(edges) if b > a)


def _candidate_table(
    runs: StraightRuns, special_faults: dict[str, Floats | float], settings: SpritesSettings
) -> pd.DataFrame:
    """Return runs as a table of candidates: start, length and a column for each fault.

    The faults are those of all straight runs, and `special_faults`, by name, (k,) or one for all k
    runs.
    """
    half = runs.frames // 2
    heading, speed = runs.values("heading", following=1), runs.values("speed")
    area = runs.values("area_px", following=1)
    change = np.abs(speed[:, -half:].mean(1) - speed[:, :half].mean(1))
    return pd.DataFrame({
        "start": runs.first + runs.offset,
        "length": runs.frames,
        "drift": np.abs(heading[:, -1] - heading[:, 0]) / settings.drift_deg,
        "speed changes": change / np.maximum(speed.mean(1), 1e-6) / settings.speed_change,
        "area changes": np.ptp(area, axis=1) / area.mean(1) / settings.area_change,
        "another size": runs.values("size_fault")[:, 0],
        "not alone": _crowding_fault(runs.values("neighbour_bl").min(1), settings),
        **special_faults,
    })  # fmt: skip


def _crowding_fault(neighbour_bl: Reals, settings: SpritesSettings) -> Floats:
    """Return how near another fish is: 1 at the least distance allowed, 0 from twice that on.

    neighbour_bl: body lengths to the nearest other fish.
    """
    return np.clip(2 - neighbour_bl / settings.min_neighbour_distance_bl, 0, 1)


# -- candidates: turns -----------------------------------------------------------------------------


def find_turns(table: pd.DataFrame, side: int, settings: SpritesSettings) -> pd.DataFrame:
    """Return the candidates for a turn to one side: the film's strongest whole turns.

    A turn is whole if all its frames are usable, it has frames before and after the largest bend,
    and the heading changes. Weaker turns are included only if there are no stronger ones: see
    `strong` in the settings.
    """
    bend = side * table["bend"].to_numpy()
    turning = (table["type"] == side).to_numpy() & table["usable"].to_numpy()
    if not turning.any() or bend[turning].max() <= 0:
        return pd.DataFrame()
    strongest = float(bend[turning].max())
    turns = []
    for span in _unbroken_row_slices(table):
        track, bends = table.iloc[span], bend[span]
        peaks = np.flatnonzero((bends[1:-1] > bends[:-2]) & (bends[1:-1] >= bends[2:])) + 1
        for peak in peaks[turning[span][peaks] & (bends[peaks] > 0)]:
            turn = _measure_turn(track, bends, side, peak, strongest, settings)
            if turn is not None:
                turns.append(turn | {"start": span.start + turn["start"]})
    for share in settings.strong:
        # The fault `weaker` is (1 - bend / strongest bend) / settings.weaker.
        strong = [turn for turn in turns if turn["weaker"] <= (1 - share) / settings.weaker + 1e-9]
        if strong:
            return pd.DataFrame(strong)
    return pd.DataFrame()


def _find_substitute_turns(table: pd.DataFrame, side: int) -> pd.DataFrame:
    """Return bends to one side, as candidates that replace a missing whole turn.

    Each lasts from one minimum of the bend to the next. Its only fault, "weaker", is how much
    weaker it is than the strongest bend, as a share.
    """
    bends = []
    for span in _unbroken_row_slices(table):
        bend = side * table["bend"].to_numpy()[span][:-1]  # a frame must follow a candidate
        is_minimum = (bend[1:-1] < bend[:-2]) & (bend[1:-1] <= bend[2:])
        minima = np.flatnonzero(np.r_[True, is_minimum, True][: len(bend)])  # and both ends
        for first, last in pairwise(minima.tolist()):
            peak = float(bend[first : last + 1].max())
            if last - first >= 2 and peak > max(0.0, bend[first], bend[last]):
                bends.append((span.start + first, last - first + 1, peak))
    candidates = pd.DataFrame(bends, columns=["start", "length", "weaker"])
    return candidates.assign(weaker=1 - candidates["weaker"] / candidates["weaker"].max())


def _find_turn_span(
    track: pd.DataFrame, bend: Floats, side: int, peak_row: int, settings: SpritesSettings
) -> tuple[int, int] | None:
    """Return the first and the last row of the turn around a row; None if the turn is not whole.

    The arguments are those of `_measure_turn`.
    """
    first = _find_straightest_row(bend, peak_row, 0, settings)
    last = _find_straightest_row(bend, peak_row, len(bend) - 1, settings)
    earlier = first - 1  # the head has begun to turn by the first frame that is bent at all
    if earlier >= 0 and abs(bend[earlier]) < settings.extra_bend * bend[peak_row]:
        first = earlier
    inside = slice(first, last + 1)
    strong = np.flatnonzero(bend[inside] >= settings.hold * bend[peak_row]) + first
    is_whole = (
        strong[0] != first  # it does not begin strongly bent, nor end so
        and strong[-1] != last
        and last + 1 < len(bend)  # a frame follows, to compare with
        and track["usable"].to_numpy()[inside].all()
        and (track["type"].to_numpy()[inside] != -side).all()
    )
    return (first, last) if is_whole else None


def _measure_turn(
    track: pd.DataFrame, bend: Floats, side: int, peak_row: int, strongest_bend: float,
    settings: SpritesSettings,
) -> dict[str, float] | None:  # fmt: skip
    """Return start, length and faults of the turn around a row; None if the turn is not whole.

    start: its first row in `track`; length: its frames. track: rows of the table of swimmers; bend:
    of each row, + = to the side; peak_row: where the bend is largest; strongest_bend: of the film.
    """
    span = _find_turn_span(track, bend, side, peak_row, settings)
    if span is None:
        return None
    first, last = span
    inside = slice(first, last + 1)
    heading = track["heading"].to_numpy()[first : last + 2]
    step = side * np.diff(smooth_series(heading))
    if step.sum() < settings.min_turn_deg:
        return None
    area = track["area_px"].to_numpy()[inside]
    neighbour_bl = track["neighbour_bl"].to_numpy()[inside].min()
    end_bends = np.abs(bend[[first, last]])
    # Bends besides the largest one: where the bend falls before the peak, or rises after it.
    change, peak = np.diff(bend[inside]), int(bend[inside].argmax())
    second_bend = float(-np.minimum(change[:peak], 0).sum() + np.maximum(change[peak:], 0).sum())
    n = last - first + 1
    return {
        "start": first,
        "length": n,
        "weaker": (1 - bend[peak_row] / strongest_bend) / settings.weaker,
        "bent at the ends": end_bends.sum() / bend[peak_row] / (2 * settings.extra_bend),
        "turns back": -np.minimum(step, 0).sum() / settings.drift_deg,
        "goes on": abs(heading[-1] - heading[-2]) / settings.drift_deg,
        "bends twice": second_bend / bend[peak_row] / settings.extra_bend,
        "jumps": step.max() / settings.jump_deg,
        "flicker": settings.flicker_frames / n,
        "area changes": np.abs(np.diff(area)).max() / area.mean() / settings.area_change,
        "another size": track["size_fault"].to_numpy()[first],
        "not alone": float(_crowding_fault(neighbour_bl, settings)),
    }


def _find_straightest_row(
    bend: Reals, peak_row: int, end_row: int, settings: SpritesSettings
) -> int:
    """Return the row, from a peak towards `end_row`, where the fish is straightest.

    bend: of each row of a track, + = to the side of the turn. The search ends at a straight fish, a
    bend to the other side, or where the bend rises again by more than a little.
    """
    direction = 1 if end_row > peak_row else -1
    straightest = row = peak_row
    while row != end_row and abs(bend[straightest]) > settings.straight_bend * bend[peak_row]:
        row += direction
        if abs(bend[row]) < abs(bend[straightest]):
            straightest = row
        elif bend[row] < 0 or bend[row] > bend[straightest] + settings.extra_bend * bend[peak_row]:
            break
    return straightest


# -- the choice ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ChosenFrames:
    """The film's frames that become the sprites of one sequence.

    mirrored: the frames show a turn to the other side, and the sprites are their mirror images.
    stands_in: the film has no tail beat, no long glide with a still tail, or no whole turn, and
    these frames are the best substitute.
    """

    run: FrameRun
    mirrored: bool = False
    stands_in: bool = False


def choose_frames(
    table: pd.DataFrame, draw_pictures: DrawPictures, delta_frames: int, settings: SpritesSettings
) -> dict[str, ChosenFrames]:
    """Choose the film's frames for each sequence of sprites: those of the settings, else the best.

    delta_frames: Δ in frames. The result is by the names in `SEQUENCES`. A side without a turn gets
    the opposite turn, mirrored. A film without a tail beat or a whole turn gets the best
    substitute. FinloopError if the settings name frames that do not exist, or the fish never bends.
    """
    typical_sharpness = _measure_typical_sharpness(table, draw_pictures)

    def best_runs(sequence: str, candidates: pd.DataFrame) -> list[FrameRun]:
        """Return the best candidate of each track for a sequence, the best first."""
        return best_runs_of_tracks(
            table, candidates, draw_pictures, typical_sharpness, settings,
            is_cycle=sequence not in SIDES,
        )  # fmt: skip

    runs: dict[str, Sequence[FrameRun]] = {}
    for sequence in SEQUENCES:
        text = getattr(settings, f"{sequence}_frames")
        if text is not None:
            runs[sequence] = [_parse_frame_run(table, sequence, text, settings.hold)]
        elif sequence in SIDES:
            runs[sequence] = best_runs(sequence, find_turns(table, SIDES[sequence], settings))
        else:
            find_candidates = find_tail_beats if sequence == "straight" else find_glides
            runs[sequence] = best_runs(sequence, find_candidates(table, delta_frames, settings))
    stands_in: set[str] = set()  # sequences for which the film shows only a substitute
    if not runs["straight"]:
        substitutes = _find_substitute_tail_beats(table, delta_frames, settings)
        runs["straight"] = best_runs("straight", substitutes)
        stands_in.add("straight")
    if not (runs["left"] or runs["right"]):
        for sequence, side in SIDES.items():
            runs[sequence] = best_runs(sequence, _find_substitute_turns(table, side))
            stands_in.add(sequence)
    _refuse_missing_runs(runs)
    choices = {
        sequence: ChosenFrames(run, stands_in=sequence in stands_in)
        for sequence, run in choose_run_combination(table, runs, settings).items()
    }
    return _fill_in_missing_sequences(choices)


def _measure_typical_sharpness(table: pd.DataFrame, draw_pictures: DrawPictures) -> float:
    """Return the median sharpness of the film's fish, in a sample of its usable frames.

    Without usable frames, any are taken.
    """
    usable = np.flatnonzero(table["usable"])
    usable = usable if usable.size else np.arange(len(table))
    sample = spread_rows(usable, _SAMPLE)
    pictures = draw_pictures(sample, table["heading"].to_numpy()[sample])
    return float(np.median(measure_sharpness(pictures)))


def _refuse_missing_runs(runs: dict[str, Sequence[FrameRun]]) -> None:
    """Raise FinloopError if there is no run of straight swimming, or no turn; runs: by sequence."""
    missing = [] if runs["straight"] else ["four frames of one track, one after the other"]
    if not (runs["left"] or runs["right"]):
        missing.append("a fish that bends")
    if missing:
        raise FinloopError(
            f"the film does not show {' nor '.join(missing)}",
            "a fish that swims, some seconds of it",
            "take a longer film (reports/film/features/trajectories.png shows what was followed)",
        )


def _fill_in_missing_sequences(choices: dict[str, ChosenFrames]) -> dict[str, ChosenFrames]:
    """Return choices for all sequences: one without frames borrows those of another one.

    A missing glide gets those of the tail beat, a missing turn the opposite one, mirrored. A glide
    that is too short, or whose tail moves, counts as a substitute, too.
    """
    glide = choices.get("slide", choices["straight"])
    is_true_glide = "slide" in choices and all(
        glide.run.faults.get(fault, 0.0) <= 1 for fault in ("short", "tail moves")
    )
    filled = choices | {"slide": replace(glide, stands_in=not is_true_glide)}
    for sequence, opposite in (("left", "right"), ("right", "left")):
        if sequence not in choices:
            filled[sequence] = replace(choices[opposite], mirrored=True)
    return {sequence: filled[sequence] for sequence in SEQUENCES}


def best_runs_of_tracks(
    table: pd.DataFrame, candidates: pd.DataFrame, draw_pictures: DrawPictures,
    typical_sharpness: float, settings: SpritesSettings, *, is_cycle: bool,
) -> list[FrameRun]:  # fmt: skip
    """Return the best run of frames of each track, judged by its pictures too; the best first.

    candidates: from `find_tail_beats` and the like; typical_sharpness: the median of
    `measure_sharpness` over the film; is_cycle: whether the frame after the last should look like
    the first.
    """
    if candidates.empty:
        return []
    faults = [name for name in candidates if name not in ("start", "length")]
    track_ids = table["track_id"].to_numpy()[candidates["start"]]
    best: dict[int, FrameRun] = {}
    for label in _choose_promising(candidates[faults].sum(axis=1), track_ids, settings):
        start, n = int(candidates.at[label, "start"]), int(candidates.at[label, "length"])
        rows = np.arange(start, start + n + 1)
        heading = cycle_headings(table, start, n) if is_cycle else table["heading"].to_numpy()[rows]
        pictures = draw_pictures(rows, heading)
        picture_faults = {"does not close": measure_loop_closure(pictures)} if is_cycle else {}
        blur = 1 - float(np.median(measure_sharpness(pictures))) / typical_sharpness
        picture_faults["blurred"] = max(0.0, blur) / settings.blur
        track = int(table["track_id"].iat[start])
        run = FrameRun(
            track,
            first=int(table["frame"].iat[start]),
            last=int(table["frame"].iat[start + n - 1]),
            rows=slice(start, start + n),
            faults=candidates.loc[label, faults].to_dict() | picture_faults,
        )
        if track not in best or run.cost < best[track].cost:
            best[track] = run
    return sorted(best.values(), key=lambda run: run.cost)


def _choose_promising(
    cost: pd.Series, track_ids: NDArray[np.integer], settings: SpritesSettings
) -> pd.Index:
    """Return the labels of the candidates that are worth drawing, the cheapest first.

    They are a few of each track, and not too many in all. cost: sum of each candidate's faults
    without its pictures, by label; track_ids: of the same candidates.
    """
    order = cost.sort_values(kind="stable").index
    rank_in_track = cost[order].groupby(pd.Series(track_ids, cost.index)[order]).cumcount()
    few_of_each = order[(rank_in_track < settings.candidates_per_track).to_numpy()]
    return few_of_each[: settings.candidates]


def measure_loop_closure(pictures: Reals) -> float:
    """Return how visible the jump from a loop's end to its start is; 1: as any other step.

    It is the picture distance (Eq. 5) from the frame after the loop to the first frame, which it
    should equal, over the loop's median step. pictures (n + 1, size, size, channels): the n frames
    of the loop and the frame after them.
    """
    jump = float(paired_distances(pictures[-1], pictures[0]))
    return jump / max(float(np.median(successive_distances(pictures))), 1e-9)


def measure_sharpness(pictures: Reals) -> Floats:
    """Return how sharp each picture is (n,): its summed squared gradient over its summed alpha.

    pictures (n, h, w, channels): values 0 … 1, alpha last.
    """
    down, right = np.diff(pictures, axis=1)[:, :, :-1], np.diff(pictures, axis=2)[:, :-1]
    return (down**2 + right**2).sum((1, 2, 3)) / np.maximum(pictures[..., -1].sum((1, 2)), 1e-9)


def choose_run_combination(
    table: pd.DataFrame, runs: dict[str, Sequence[FrameRun]], settings: SpritesSettings
) -> dict[str, FrameRun]:
    """Return one run of frames for each sequence: few faults, and few changes of the animal.

    runs: the candidates of each sequence; those without any are left out of the result. A run costs
    its faults, those of the first sequence `cycle_weight` times. A sequence of another track than
    the first one costs `track_change_cost`, and 1 more for an average relative difference of
    `size_off` in length, contrast and area.
    """
    sequences = [sequence for sequence in runs if runs[sequence]]
    # Differences of logarithms are relative differences.
    log_appearance = np.log(_typical_appearance(table))

    def change_cost(track_a: int, track_b: int) -> float:
        """Return the cost of a change of the animal between two sequences; 0 without a change."""
        if track_a == track_b:
            return 0.0
        difference = float(np.abs(log_appearance.loc[track_a] - log_appearance.loc[track_b]).mean())
        return settings.track_change_cost + difference / settings.size_off

    best: tuple[float, dict[str, FrameRun]] = (np.inf, {})
    for first in runs[sequences[0]]:
        choice = {sequences[0]: first}
        total = settings.cycle_weight * first.cost
        for sequence in sequences[1:]:
            costs = [run.cost + change_cost(first.track_id, run.track_id) for run in runs[sequence]]
            choice[sequence] = runs[sequence][int(np.argmin(costs))]
            total += min(costs)
        if total < best[0]:
            best = (total, choice)
    return best[1]


def _typical_appearance(table: pd.DataFrame) -> pd.DataFrame:
    """Return the median length, contrast and area of each track where it swims straight.

    A track that never does gets the medians of all rows. The index is the track's number.
    """
    names = ["length_px", "contrast", "area_px"]
    straight = table[table["type"] == STRAIGHT]
    of_tracks = straight.groupby("track_id")[names].median()
    return of_tracks.reindex(table["track_id"].unique()).fillna(table[names].median())
