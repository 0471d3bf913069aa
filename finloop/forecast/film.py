"""The states of all rows of a film and of their mirror images, and their controls.

A *state* is the posture's codes, and forward, sideways [body lengths/s] and turning speed [rad/s, +
= left] from the frame before. The *past* of a row is its states at the lags, the present one first.
The *control* of a row is the fish's next motion (Eqs. 1, 3): displacement [body lengths] and
included angle [rad] over the next Δ.

Rows n … 2 n − 1 are the mirror images of rows 0 … n − 1. An animal whose sides differ has none.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask, Reals
from finloop.base.axes import to_body_axes
from finloop.base.errors import FinloopError
from finloop.distance.picture import typical_lengths_px
from finloop.features.current import places_through_water
from finloop.features.memory import held_out_block_frames, measure_memory_frames
from finloop.features.table import infer_delta_frames
from finloop.forecast.settings import ForecastSettings
from finloop.pose.film import FilmPoses

MOTION = 3
"""Numbers of a state beside the codes: forward, sideways and turning speed."""

CONTROL = 2
"""Numbers of a control: displacement and included angle."""

LEAST_ROWS = 100
"""Usable rows from which a network can be trained at all: some seconds of film."""
_LEAST_SD = 1e-6  # standard deviation, at least: units must not be 0


@dataclass(frozen=True)
class FilmStates:
    """The states (pose and speeds) and controls (next motion) of a film's n rows and mirror images.

    There are m = n rows, or 2 n with mirror images. states (m, d): pose codes, then body lengths/s
    ahead and to the left, rad/s; control (m, 2): body lengths and rad over the next Δ; both NaN
    where the track does not reach. usable (m,): whether past, control and next state exist. mirror
    (d, d), side (2,): states @ mirror are the mirrored states, control * side the mirrored
    controls; identity and ones where the sides differ. lags (l,): frames, ascending from 0. scale
    (d,): standard deviations; control_scale (2,): root mean squares. frame (m,): frame numbers;
    delta: Δ in frames; rate_hz: frames per second; count: n; memory: frames after which a posture
    is half forgotten.
    """

    states: Floats
    control: Floats
    usable: Mask
    mirror: Floats
    side: Floats
    lags: Ints
    scale: Floats
    control_scale: Floats
    frame: Ints
    delta: int
    rate_hz: float
    count: int
    memory: float

    @property
    def rows(self) -> Ints:
        """Return the numbers (k,) of the usable rows, from which the network can learn."""
        return np.flatnonzero(self.usable)

    def past(self, rows: Ints) -> Floats:
        """Return the pasts (k, l, d) of rows (k,): states at the l lags, the present one first."""
        return self.states[np.asarray(rows)[:, None] - self.lags]


def compute_film_states(
    features: pd.DataFrame, codes: Reals, mirror: Reals | None, rate_hz: float, p: ForecastSettings
) -> FilmStates:
    """Return pose, speeds and next motion of all rows of a film and of their mirror images.

    codes (n, c): of the rows' postures, the most important first, of which enough are kept for
    `p.pose_variance_ratio` of the variance; mirror (c, c): the matrix that mirrors codes, None if
    the fish may not be mirrored. FinloopError if too few rows have a past and a future, or no fish
    turns or moves in them.
    """
    delta, n = infer_delta_frames(features), len(features)
    track, frame = (features[name].to_numpy(np.int64) for name in ("track_id", "frame"))
    lags = np.unique(np.round(np.array(p.lag_deltas) * delta)).astype(np.int64)
    variance = (np.asarray(codes, float) ** 2).mean(0).cumsum()  # of the first 1, 2 … codes
    code_count = 1 + int(np.searchsorted(variance, p.pose_variance_ratio * variance[-1]))
    states = np.concatenate(
        [np.asarray(codes, float)[:, :code_count], _measure_speeds(features, rate_hz)], 1
    )
    angle = np.radians(features["included_angle_deg"].to_numpy(float))
    control = np.stack([features["displacement"].to_numpy(float), angle], 1)
    row_in_track = np.arange(n) - np.searchsorted(track, track)
    next_row = np.append((np.diff(track) == 0) & (np.diff(frame) == 1), False)
    # The first row of a track has no speeds yet, so the past begins at the second.
    usable = (row_in_track > lags[-1]) & next_row & np.isfinite(control).all(1)
    _refuse_poor_film(control[usable], features["swimming_type"].to_numpy()[usable])
    scale = np.maximum(np.nanstd(states, axis=0), _LEAST_SD)
    control_scale = np.sqrt(np.nanmean(control**2, axis=0))
    # Matrix and signs that mirror a state and a control.
    mirror_states, mirror_control = np.eye(code_count + MOTION), np.ones(2)
    if mirror is not None:
        mirror_states[:code_count, :code_count] = np.asarray(mirror)[:code_count, :code_count]
        mirror_states[-2, -2] = mirror_states[-1, -1] = -1  # speed to the left, turning
        mirror_control[1] = -1  # the angle
        states = np.concatenate([states, states @ mirror_states])
        control = np.concatenate([control, control * mirror_control])
        usable, frame = np.tile(usable, 2), np.tile(frame, 2)
    return FilmStates(
        states=states, control=control, usable=usable, mirror=mirror_states, side=mirror_control,
        lags=lags, scale=scale, control_scale=control_scale, frame=frame, delta=delta,
        rate_hz=rate_hz, count=n, memory=measure_memory_frames(codes, track),
    )  # fmt: skip


def _refuse_poor_film(control: Floats, swimming_type: Ints) -> None:
    """Raise FinloopError if the usable rows of a film are too few, or no fish moves or turns.

    control (k, 2): displacement and angle of each usable row; swimming_type (k,): 0 = straight.
    """
    lack = ""
    if len(control) < LEAST_ROWS:
        lack = f"{len(control)} rows with a past, a next frame and a control"
    elif np.ptp(control[:, 0]) < 1e-6:
        lack = "no fish that moves"
    elif not swimming_type.any():  # no steering can be learnt
        lack = "no fish that turns"
    if lack:
        raise FinloopError(
            f"the film has {lack}",
            f"at least {LEAST_ROWS} rows in tracks of some seconds, in which a fish moves and "
            "turns",
            "take a longer film, or leave the forecast out (matching.uses=[film])",
        )


def posture_mirror_matrix(poses: FilmPoses, look: Reals) -> Reals | None:
    """Return the matrix (c, c) that mirrors posture codes; None if the fish may not be mirrored.

    look (m, k): light and skin of each row, and of mirror images if these may be shown.
    """
    return poses.shapes.mirror_matrix if len(look) > len(poses.codes) else None


def _measure_speeds(features: pd.DataFrame, rate_hz: float) -> Floats:
    """Return the forward, sideways [body lengths/s] and turning [rad/s] speeds (n, 3) of rows.

    They are NaN at a track's first row and after a missing frame.
    """
    place = places_through_water(features)
    heading = np.radians(features["heading_deg"].to_numpy(float))
    length = typical_lengths_px(features).to_numpy(float)
    step, turn = (np.diff(values, axis=0, prepend=values[:1]) for values in (place, heading))
    travel = to_body_axes(step, np.append(heading[:1], heading[:-1])) / length[:, None]
    motion = np.column_stack([travel, np.angle(np.exp(1j * turn))]) * rate_hz
    track, frame = features["track_id"].to_numpy(), features["frame"].to_numpy()
    first = np.append(True, (np.diff(track) != 0) | (np.diff(frame) != 1))
    motion[first] = np.nan
    return motion


@dataclass(frozen=True)
class Partition:
    """Row numbers of a film: (k,) to learn from, and (q,) held out to test predictions."""

    train: Ints
    held_out: Ints


def split_held_out(film: FilmStates, p: ForecastSettings) -> Partition:
    """Return which usable rows to learn from, and which, in random stretches, to hold out.

    A stretch holds all fish. A row whose past or next state lies in the other part is in neither.
    Each part has at most `p.most_rows`: in a long film a random sample. FinloopError if the film is
    shorter than two stretches.
    """
    rows, least = film.rows, int(film.lags[-1]) + 2  # frames from the past to the next state
    block = held_out_block_frames(
        p.held_out_block_deltas, p.held_out_ratio, film.delta, film.frame[rows], least
    )
    first_block = (film.frame[rows] - film.lags[-1]) // block  # of the past
    last_block = (film.frame[rows] + 1) // block  # of the next state
    blocks = np.unique(first_block)
    count = min(max(1, round(p.held_out_ratio * len(blocks))), len(blocks) - 1)
    chosen = np.random.default_rng((p.seed, 0)).permutation(blocks)[:count]
    begins_in, ends_in = np.isin(first_block, chosen), np.isin(last_block, chosen)
    parts = Partition(train=rows[~begins_in & ~ends_in], held_out=rows[begins_in & ends_in])
    if min(len(parts.train), len(parts.held_out)) == 0:
        raise FinloopError(
            f"{len(parts.train)} rows to learn from and {len(parts.held_out)} to test with, in "
            f"stretches of {block} frames",
            "at least one row of each kind",
            "lower forecast.held_out_block_deltas, or take a longer film",
        )
    rng = np.random.default_rng((p.seed, 2))  # not the numbers that chose the blocks

    def sample(part: Ints) -> Ints:
        """Return at most `p.most_rows` random rows of a part, ascending."""
        if len(part) <= p.most_rows:
            return part
        return np.sort(rng.choice(part, p.most_rows, replace=False))

    return Partition(train=sample(parts.train), held_out=sample(parts.held_out))
