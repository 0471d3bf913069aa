"""Resample a recorded track to the film's rate: longest stretch, gaps filled, head first."""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.retarget.settings import RetargetSettings
from finloop.retarget.track import Track

_LEAST_TICKS = 4  # of a track that can be followed
_BACKWARDS = 0.25  # of the path; if less is travelled head first, head and tail are swapped


class RecordedMotion(NamedTuple):
    """The used stretch of a recorded track, resampled to ticks of the animation.

    time_s (T,): in the track's file; points (T, m, 2): px of the file; codes (T, c): pose codes, of
    a track of the drawn film, else None; numbers: how much was filled and left out, by name.
    """

    time_s: Floats
    points: Floats
    codes: Floats | None
    numbers: dict[str, float]


def resample_track(track: Track, rate_hz: float, p: RetargetSettings) -> RecordedMotion:
    """Return the longest stretch of a track without a long gap, resampled to ticks by splines.

    rate_hz: ticks per second; p: the time to use, the longest gap, the smoothing. FinloopError if
    the stretch is too short, or the animal swims tail first.
    """
    time = track.frame / track.rate_hz
    wanted = (time >= p.start_s) & (time <= (np.inf if p.end_s is None else p.end_s))
    # The frames of each stretch without a long gap, as indices in the track.
    usable = np.flatnonzero(np.isfinite(track.points).all((1, 2)) & wanted)
    is_gap = np.diff(track.frame[usable]) > 1 + round(p.gap_s * track.rate_hz)
    stretches = np.split(usable, np.flatnonzero(is_gap) + 1)
    longest = max(stretches, key=lambda stretch: np.ptp(time[stretch]) if len(stretch) else -1.0)
    duration_s = float(np.ptp(time[longest])) if len(longest) else 0.0
    ticks = int(duration_s * rate_hz + 1e-6) + 1  # 1e-6: against rounding errors
    if ticks < _LEAST_TICKS or len(longest) < 2:
        raise FinloopError(
            f"the longest stretch of {track.name} without a gap has {len(longest)} frames, "
            f"{duration_s:.2f} s, of {int(wanted.sum())} requested frames",
            f"at least {_LEAST_TICKS / rate_hz:.2g} s, {_LEAST_TICKS} frames of this film",
            "take a track with shorter gaps, another animal (retarget.animal), or another part of "
            "the track (retarget.start_s, end_s)",
        )
    tick_times = time[longest[0]] + np.arange(ticks) / rate_hz

    def resample(values: Floats) -> Floats:
        """Return values (t, …) of the track at the ticks of the longest stretch, smoothed."""
        at_ticks = CubicSpline(time[longest], values[longest])(tick_times)
        if not p.smooth_s:
            return at_ticks
        return gaussian_filter1d(at_ticks, p.smooth_s * rate_hz, axis=0, mode="nearest")

    points = resample(track.points)
    codes = None if track.codes is None else resample(track.codes)
    forward = forward_share(points)
    if forward < _BACKWARDS and not p.allow_backwards:
        raise FinloopError(
            f"{track.name} swims tail first for {1 - forward:.0%} of its path",
            "points from head to tail; most animals swim head first",
            "name the points from head to tail (retarget.body_keypoints), or allow it: "
            "retarget.allow_backwards=true",
        )
    first, last = track.frame[longest[[0, -1]]]
    wanted_frames = int(wanted.sum())
    used_frames = int((wanted & (track.frame >= first) & (track.frame <= last)).sum())
    return RecordedMotion(tick_times, points, codes, {
        "file_frames": wanted_frames,
        "file_frames_used_pct": 100 * used_frames / wanted_frames,
        "gaps_filled_frames": int(last - first) + 1 - len(longest),
        "left_out_s": (wanted_frames - used_frames) / track.rate_hz,
        "stretches_left_out": len(stretches) - 1,
        "forward_pct": 100 * forward,
    })  # fmt: skip


def forward_share(points: Floats) -> float:
    """Return the share (0-1) of its path that an animal travels head first.

    points (T, m, 2): head first; the result is 1 if m is 1, or if the animal never moves.
    """
    if points.shape[1] < 2:
        return 1.0
    direction = points[:, 0] - points[:, -1]
    direction /= np.maximum(np.hypot(*direction.T), 1e-9)[:, None]
    step = np.diff(points.mean(1), axis=0)
    forward_px = (step * (direction[1:] + direction[:-1]) / 2).sum(1)
    path_px = np.abs(forward_px).sum()
    return float(np.maximum(forward_px, 0).sum() / path_px) if path_px > 0 else 1.0
