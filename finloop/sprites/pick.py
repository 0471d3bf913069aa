"""Which frames become sprites, found automatically (fish paper §3.3: there, by hand).

Four sequences are looked for: *straight* (one full tail beat whose end meets its beginning),
*slide* (gliding with a still tail, closing on itself), and the strongest *left* and *right* turns,
from nearly straight through the bend back to nearly straight.

Every candidate has a list of faults, each in units of what is just acceptable, and the one with the
smallest sum wins; so a choice can be explained by reading its faults. Candidates are found in the
features; only the best of these are looked at as pictures.

Glossary: *tail*: the tail tip's sideways offset from the head's axis, body lengths, + = left;
*drift*: change of heading; *step*: picture distance of successive frames.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from finloop.distance.picture import apart, steps
from finloop.features.swimming_type import LEFT, RIGHT, STRAIGHT

SIDES = {"left": LEFT, "right": RIGHT}
WORDS = ("straight", "slide", *SIDES)

# A frame may be used at all: head and tail known, measured at the length the animal has, and no
# other fish within reach of it.
SURE = 0.9  # least head_confidence
LENGTH_OFF = 0.08  # of the track's median length; 98 % of the zebrafish's frames are within it
ALONE = 1.0  # body lengths to the nearest mass centre: nearer, and the two can touch

# Units of the faults.
DRIFT_DEG = 6.0  # over a straight stretch: less than half a sector of 24
ANIMAL_OFF = 0.1  # of the clip's median length: an animal of another size
FLICKER = 10.0  # frames a beat; with 4 one sees the extremes and nothing between
SPEED_CHANGE = 0.4  # second half against first, of their mean
STILL = 0.05  # body lengths that a still tail moves: about its width
FINS = 0.1  # change of area within the stretch, e.g. fins that come and go
WEAKER = 0.1  # of the strongest turn's motion area
STRAIGHTENED = 0.25  # of the peak's bend left at a turn's ends
JUMP_DEG = 25.0  # largest turn between two frames of a turn
SOFT = 0.25  # less sharp than the clip's median
LOPSIDED = 0.25  # mean of the tail over its range

BEAT_S = (0.15, 1.5)  # tail beats between 6.7 and 0.67 Hz can be told from flicker and drift
BEAT_FRAMES = 5  # least; two are Nyquist's limit, five show a wave
BEAT_TAIL = (0.1, 0.6)  # range of the tail in body lengths; half of what steady swimmers show, 0.2
ONE_BEAT = 0.75  # least share of the tail's variance in the fundamental
LEAST_TURN_DEG = 15.0  # a sector of 24: a turn that stays in its orientation is none
STILL_BENT = 0.2  # of the peak: as straight as in a tail beat, a turn begins or ends here
HOLD = 0.9  # of the peak's area from which a turn is held
STRONG = (0.9, 0.75, 0.5, 0.25, 0.0)  # turns of this share of the strongest are taken if clean
PICTURED, A_TRACK = 120, 4  # candidates of a sequence looked at as pictures, of one track
STRANGER = 0.5  # what taking a sequence from another track costs, however alike
ON_SCREEN = 2.0  # weight of the straight cycle's faults: it is seen more than the others
PICTURE = 64  # px, side of the pictures that are compared


@dataclass(frozen=True)
class Stretch:
    """Successive frames of one track; `rows` of the table of swimmers."""

    track_id: int
    first: int
    last: int
    rows: slice
    faults: dict[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.rows.stop - self.rows.start

    @property
    def cost(self) -> float:
        """Sum of the faults; about 1 for each that is just acceptable."""
        return sum(self.faults.values())


Look = Callable[[NDArray[np.intp], NDArray[np.floating]], NDArray[np.float32]]
"""Rows of the table of swimmers and a heading for each → pictures (n, PICTURE, PICTURE, channels)
of these fish, headed right, their mass centres in the middle, all of one length."""


def swimmers(features: pd.DataFrame, tracks: pd.DataFrame) -> pd.DataFrame:
    """All that picking needs to know of every fish of every frame, a row for each of both tables.

    `heading` is unwrapped, `place` is in px, lengths are in body lengths.
    """
    table = features.assign(area_px=tracks["area_px"], contrast=tracks["contrast"])
    of_track = table.groupby("track_id", sort=False)
    length = of_track["body_length_px"].transform("median").to_numpy()
    back = np.radians(table["heading_deg"].to_numpy(float))
    dx = (table["tail_x_px"] - table["head_x_px"]).to_numpy(float)
    dy = (table["tail_y_px"] - table["head_y_px"]).to_numpy(float)
    heading = of_track["heading_deg"].transform(lambda h: np.unwrap(h.to_numpy(float), period=360))
    place = np.column_stack([_smooth_by_track(table, name) for name in ("x_px", "y_px")])
    gone = np.zeros_like(place)
    gone[:-1] = np.diff(place, axis=0)
    last = (of_track.cumcount(ascending=False) == 0).to_numpy()
    gone[last] = gone[np.maximum(np.flatnonzero(last) - 1, 0)]
    whole = pd.DataFrame(
        {
            "track_id": table["track_id"].to_numpy(),
            "frame": table["frame"].to_numpy(),
            "x_px": table["x_px"].to_numpy(),
            "y_px": table["y_px"].to_numpy(),
            "step_x_px": gone[:, 0],
            "step_y_px": gone[:, 1],
            "heading": heading.to_numpy(),
            "bend": table["bend"].to_numpy(float),
            "area_rel": table["motion_area_rel"].to_numpy(float),
            "type": table["swimming_type"].to_numpy(),
            "tail": (-dx * np.sin(back) - dy * np.cos(back)) / length,
            "speed": np.hypot(*gone.T) / length,
            "length_px": length,
            "area_px": table["area_px"].to_numpy(float),
            "contrast": table["contrast"].to_numpy(float),
            "orientations": table["orientations"].to_numpy(),
        }
    )
    whole["alone"] = _alone(table) / np.median(length)
    clip = np.median(table["body_length_px"])
    whole["animal_off"] = np.abs(length / clip - 1) / ANIMAL_OFF
    off = np.abs(table["body_length_px"].to_numpy() / length - 1)
    whole["usable"] = (
        (table["head_confidence"].to_numpy() >= SURE)
        & (off <= LENGTH_OFF)
        & (whole["alone"] > ALONE)
    )
    return whole


def _smooth_by_track(table: pd.DataFrame, name: str) -> NDArray[np.float64]:
    return (
        table.groupby("track_id", sort=False)[name]
        .transform(lambda x: smooth(x.to_numpy(float)))
        .to_numpy()
    )


def smooth(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """¼, ½, ¼ of neighbours (frames,): takes noise out, keeps lines, and monotone runs monotone.

    The ends are continued in a straight line.
    """
    x = np.array(values, np.float64)
    if len(x) < 3:
        return x
    ends = np.r_[2 * x[0] - x[1], x, 2 * x[-1] - x[-2]]
    return convolve1d(ends, [0.25, 0.5, 0.25])[1:-1]


def _alone(table: pd.DataFrame) -> NDArray[np.float64]:
    """Distance (rows,) in px to the nearest other mass centre of the same frame; inf if none."""
    apart = np.full(len(table), np.inf)
    place = table[["x_px", "y_px"]].to_numpy()
    for rows in table.groupby("frame").indices.values():
        if len(rows) > 1:
            gaps = np.hypot(*(place[rows, None] - place[None, rows]).transpose(2, 0, 1))
            np.fill_diagonal(gaps, np.inf)
            apart[rows] = gaps.min(1)
    return apart


def spans(table: pd.DataFrame) -> Iterator[slice]:
    """The rows of each run of successive frames of one track."""
    broken = (np.diff(table["track_id"]) != 0) | (np.diff(table["frame"]) != 1)
    edges = [0, *(np.flatnonzero(broken) + 1).tolist(), len(table)]
    yield from (slice(a, b) for a, b in pairwise(edges) if b > a)


# -- straight and slide ----------------------------------------------------------------------------


def beats(table: pd.DataFrame, rate_hz: float) -> pd.DataFrame:
    """Every stretch that is one tail beat, swum straight: a row each, with its faults so far.

    Columns: start, length (rows of `table`), and one per fault. The frame after the last is in the
    track too, since it is compared with the first.
    """
    least = max(BEAT_FRAMES, round(BEAT_S[0] * rate_hz))
    parts = []
    for track, n, start, at in _straight(table, least, round(BEAT_S[1] * rate_hz)):
        tail = sliding_window_view(track["tail"].to_numpy(), n)[start]
        power = np.abs(np.fft.rfft(tail - tail.mean(1, keepdims=True), axis=1)) ** 2
        power[:, 1 : (n + 1) // 2] *= 2
        total = np.maximum(power[:, 1:].sum(1), 1e-12)
        swing = np.maximum(np.ptp(tail, axis=1), 1e-6)
        faults = _stretch_faults(track, start, n) | {
            "several waves": (1 - power[:, 1] / total) / (1 - ONE_BEAT),
            "flicker": FLICKER / n,
            "lopsided": np.abs(tail.mean(1)) / swing / LOPSIDED,
        }
        parts.append(pd.DataFrame({"start": at, "length": n, "swing": swing, **faults}))
    found = _joined(parts)
    if found.empty:
        return found
    found = found[found["swing"].between(*BEAT_TAIL) & (found["several waves"] <= 1)].copy()
    found["untypical beat"] = np.abs(np.log2(found["swing"] / found["swing"].median()))
    return found.drop(columns="swing")


def slides(table: pd.DataFrame, rate_hz: float, least_s: float, most_s: float) -> pd.DataFrame:
    """Every stretch of gliding, a row each as in `beats`; the tail's fault is 1 where it is still.

    Stretches shorter than `least_s` are among them only if there are no longer ones.
    """
    least, most = max(3, round(least_s * rate_hz)), max(3, round(most_s * rate_hz))
    typical = max(float(table.loc[table["usable"], "speed"].median()), 1e-6)
    for shortest in sorted({least, max(3, least // 2), 3}, reverse=True):
        parts = []
        for track, n, start, at in _straight(table, shortest, most):
            tail = sliding_window_view(track["tail"].to_numpy(), n)[start]
            speed = sliding_window_view(track["speed"].to_numpy(), n)[start].mean(1)
            faults = _stretch_faults(track, start, n) | {
                "tail moves": np.ptp(tail, axis=1) / STILL,
                "tail aside": np.abs(tail.mean(1)) / STILL,
                "untypical speed": np.abs(np.log2(np.maximum(speed, 1e-6) / typical)) / 2,
                "short": least / n,
            }
            parts.append(pd.DataFrame({"start": at, "length": n, **faults}))
        found = _joined(parts)
        if not found.empty:
            still = found[found["tail moves"] <= 1]
            return found if still.empty else still
    return pd.DataFrame()


def _straight(
    table: pd.DataFrame, least: int, most: int
) -> Iterator[tuple[pd.DataFrame, int, NDArray[np.intp], NDArray[np.intp]]]:
    """Windows of `least` … `most` usable straight frames, the frame after them straight as well.

    Yields a track, a length, the windows' first rows in that track and the same in `table`.
    """
    fine = ((table["type"] == STRAIGHT) & table["usable"]).to_numpy()
    for span in spans(table):
        for n in range(least, min(most, span.stop - span.start - 1) + 1):
            start = np.flatnonzero(sliding_window_view(fine[span], n + 1).all(1))
            if start.size:
                yield table.iloc[span], n, start, start + span.start


def _stretch_faults(
    track: pd.DataFrame, start: NDArray[np.intp], n: int
) -> dict[str, NDArray[np.float64]]:
    """Faults of windows of `n` frames of a track that beats and slides have in common."""
    heading = track["heading"].to_numpy()
    speed = sliding_window_view(track["speed"].to_numpy(), n)[start]
    area = sliding_window_view(track["area_px"].to_numpy(), n + 1)[start]
    change = np.abs(speed[:, -(n // 2) :].mean(1) - speed[:, : n // 2].mean(1))
    return {
        "drift": np.abs(heading[start + n] - heading[start]) / DRIFT_DEG,
        "speed changes": change / np.maximum(speed.mean(1), 1e-6) / SPEED_CHANGE,
        "area changes": np.ptp(area, axis=1) / area.mean(1) / FINS,
        "another size": track["animal_off"].to_numpy()[start],
        "not alone": _crowded(sliding_window_view(track["alone"].to_numpy(), n)[start].min(1)),
    }


def _crowded(alone: NDArray[np.floating]) -> NDArray[np.float64]:
    """1 where another fish is just far enough away, 0 from twice that."""
    return np.clip(2 - alone / ALONE, 0, 1)


def _joined(parts: list[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


# -- turns -----------------------------------------------------------------------------------------


def turns(table: pd.DataFrame, side: int) -> pd.DataFrame:
    """Every turn to one side, a row each as in `beats`, from nearly straight to nearly straight.

    Only the strongest that there are: as soon as turns of a share of `STRONG` are clean (no usable
    frame is missing, the heading changes, there is a frame before and after the peak).
    """
    bend = side * table["bend"].to_numpy()
    turning = (table["type"] == side).to_numpy() & table["usable"].to_numpy()
    if not turning.any() or bend[turning].max() <= 0:
        return pd.DataFrame()
    strongest = bend[turning].max()
    rows = [
        found
        for span in spans(table)
        for peak in _peaks(bend[span], turning[span])
        if (found := _turn(table, span, span.start + peak, side, strongest)) is not None
    ]
    for share in STRONG:
        kept = [row for row in rows if row["weaker"] <= (1 - share) / WEAKER + 1e-9]
        if kept:
            return pd.DataFrame(kept)
    return pd.DataFrame()


def _peaks(bend: NDArray[np.floating], turning: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Frames that are bent more than the one before and no less than the one after."""
    inner = np.flatnonzero((bend[1:-1] > bend[:-2]) & (bend[1:-1] >= bend[2:])) + 1
    return inner[turning[inner] & (bend[inner] > 0)]


def _turn(
    table: pd.DataFrame, span: slice, peak: int, side: int, strongest: float
) -> dict[str, float] | None:
    """The turn around a row where the bend is largest; None if there is no whole one."""
    bend = side * table["bend"].to_numpy()
    first = _downhill(bend, peak, span.start, -1)
    last = _downhill(bend, peak, span.stop - 1, 1)
    before = first - 1  # the head has begun to turn by the first frame that is bent at all
    if before >= span.start and abs(bend[before]) < STRAIGHTENED * bend[peak]:
        first = before
    inside = slice(first, last + 1)
    held = np.flatnonzero(bend[inside] >= HOLD * bend[peak]) + first
    if first == held[0] or last == held[-1] or last + 1 >= span.stop:
        return None
    if not table["usable"].to_numpy()[inside].all():
        return None
    if (table["type"].to_numpy()[inside] == -side).any():
        return None
    heading = table["heading"].to_numpy()[first : last + 2]
    step = side * np.diff(smooth(heading))
    if step.sum() < LEAST_TURN_DEG:
        return None
    area = table["area_px"].to_numpy()[inside]
    ends = np.abs(bend[[first, last]])
    n = last - first + 1
    return {
        "start": first,
        "length": n,
        "weaker": (1 - bend[peak] / strongest) / WEAKER,
        "bent at the ends": ends.sum() / bend[peak] / (2 * STRAIGHTENED),
        "turns back": -np.minimum(step, 0).sum() / DRIFT_DEG,
        "goes on": abs(heading[-1] - heading[-2]) / DRIFT_DEG,
        "bends twice": _climbs(bend[inside]) / bend[peak] / STRAIGHTENED,
        "jumps": step.max() / JUMP_DEG,
        "flicker": FLICKER / n,
        "area changes": np.abs(np.diff(area)).max() / area.mean() / FINS,
        "another size": table["animal_off"].to_numpy()[first],
        "not alone": float(_crowded(table["alone"].to_numpy()[inside].min())),
    }


def _downhill(bend: NDArray[np.floating], peak: int, end: int, way: int) -> int:
    """The row, going one `way` from a peak, where the fish is straightest before it bends again.

    It goes on while the fish straightens, over small rises, and stops once it is straight.
    """
    low = row = peak
    while row != end and abs(bend[low]) > STILL_BENT * bend[peak]:
        row += way
        if abs(bend[row]) < abs(bend[low]):
            low = row
        elif bend[row] < 0 or bend[row] > bend[low] + STRAIGHTENED * bend[peak]:
            break
    return low


def _climbs(bend: NDArray[np.floating]) -> float:
    """How much the bend falls before its peak and rises after it, together."""
    step = np.diff(bend)
    peak = int(bend.argmax())
    return float(-np.minimum(step[:peak], 0).sum() + np.maximum(step[peak:], 0).sum())


# -- choosing --------------------------------------------------------------------------------------


def pictured(
    table: pd.DataFrame, found: pd.DataFrame, look: Look, sharp: float, *, loops: bool
) -> list[Stretch]:
    """The best candidates with the faults that only their pictures show, at most one a track.

    loops: the frame after the last must resemble the first, within a natural step. `sharp`: the
    clip's median of `sharpness`.
    """
    if found.empty:
        return []
    faults = [name for name in found if name not in ("start", "length")]
    cost = found[faults].sum(axis=1)
    number = table["track_id"].to_numpy()[found["start"]]
    order = cost.sort_values(kind="stable").index
    rank = cost[order].groupby(pd.Series(number, found.index)[order]).cumcount()
    best: dict[int, Stretch] = {}
    for at in order[(rank < A_TRACK).to_numpy()][:PICTURED]:
        start, n = int(found.at[at, "start"]), int(found.at[at, "length"])
        more = {}
        rows = np.arange(start, start + n + 1)
        pictures = look(
            rows, cycle_heading(table, start, n) if loops else table["heading"].to_numpy()[rows]
        )
        if loops:
            more["does not close"] = closure(pictures)
        more["soft"] = max(0.0, 1 - float(np.median(sharpness(pictures))) / sharp) / SOFT
        track = int(table["track_id"].iat[start])
        one = Stretch(
            track, int(table["frame"].iat[start]), int(table["frame"].iat[start + n - 1]),
            slice(start, start + n), {name: float(found.at[at, name]) for name in faults} | more,
        )  # fmt: skip
        if track not in best or one.cost < best[track].cost:
            best[track] = one
    return sorted(best.values(), key=lambda s: s.cost)


def cycle_heading(table: pd.DataFrame, start: int, n: int) -> NDArray[np.float64]:
    """Heading (n + 1,) along a straight stretch and the frame after it: a line.

    Its slope is the drift from the first frame to that after the last. Both show the same phase of
    the tail beat, so the head's yaw, which a least-squares line would follow, cancels.
    """
    heading = table["heading"].to_numpy()[start : start + n + 1]
    slope = (heading[-1] - heading[0]) / n
    return heading[:-1].mean() + slope * (np.arange(n + 1) - (n - 1) / 2)


def closure(pictures: NDArray[np.floating]) -> float:
    """How far the last picture is from the first, over the median step between these pictures.

    They are a loop's frames and the one after them.
    """
    return float(apart(pictures[-1], pictures[0])) / max(float(np.median(steps(pictures))), 1e-9)


def sharpness(pictures: NDArray[np.floating]) -> NDArray[np.float64]:
    """Gradient energy (n,) of pictures (n, h, w, channels) per opaque pixel."""
    down, right = np.diff(pictures, axis=1)[:, :, :-1], np.diff(pictures, axis=2)[:, :-1]
    return (down**2 + right**2).sum((1, 2, 3)) / np.maximum(pictures[..., -1].sum((1, 2)), 1e-9)


def together(table: pd.DataFrame, found: dict[str, Sequence[Stretch]]) -> dict[str, Stretch]:
    """One stretch of each sequence, so that faults and strangeness are least together.

    Another track than that of the first sequence costs `STRANGER`, and 1 for a tenth of difference
    in length, contrast and area, on average.
    """
    words = [word for word in found if found[word]]
    looks = (
        table[table["type"] == STRAIGHT]
        .groupby("track_id")[["length_px", "contrast", "area_px"]]
        .median()
        .reindex(table["track_id"].unique())
        .fillna(table[["length_px", "contrast", "area_px"]].median())
    )
    like = np.log(looks)

    def strange(a: int, b: int) -> float:
        if a == b:
            return 0.0
        return STRANGER + float(np.abs(like.loc[a] - like.loc[b]).mean()) / ANIMAL_OFF

    best: tuple[float, dict[str, Stretch]] = (np.inf, {})
    for first in found[words[0]]:
        chosen = {words[0]: first}
        total = ON_SCREEN * first.cost
        for word in words[1:]:
            price, chosen[word] = min(
                ((s.cost + strange(first.track_id, s.track_id), s) for s in found[word]),
                key=lambda priced: priced[0],
            )
            total += price
        if total < best[0]:
            best = (total, chosen)
    return best[1]
