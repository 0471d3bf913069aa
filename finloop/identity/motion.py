"""Measure how far an animal drifts in a gap between tracks, and rate joins by that.

Trial gaps in whole tracks measure it: two places half way are predicted, from before the gap and
from after it; their distance is the mismatch. Places are in body lengths, gaps in frames.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Reals
from finloop.identity.joins import Chains, TrackPairs

_VELOCITY_FRAMES = 2, 4, 8, 16, 32  # over which a velocity may be measured; the best is chosen
_LEAST = 30  # least trial gaps that measure a mismatch
# Share of gaps in which an animal darts anywhere in the tank. From 0.005 to 0.02 the zebrafish's
# joins are the same.
_TAIL = 0.02
_SUREST = 1e6  # largest ratio of probabilities
_LEAST_MISMATCH = 1e-3  # body lengths; no prediction is more exact than the measurement


@dataclass(frozen=True)
class TrackEnds:
    """Where and when tracks begin and end, and the animals' velocities there.

    start, stop (n,): first and last frame. first, last (n, 2): places, body lengths; arriving,
    leaving (n, 2): velocities at start and end, body lengths per frame.
    """

    start: Reals
    stop: Reals
    first: Floats
    last: Floats
    arriving: Floats
    leaving: Floats


def measure_track_ends(frames: list[Reals], places: list[Floats], velocity_steps: int) -> TrackEnds:
    """Return the positions and velocities of animals at both ends of their tracks.

    frames, places: of each track, (k,) frame numbers and (k, 2) body lengths; velocity_steps:
    number of rows over which a velocity is measured, fewer in a shorter track.
    """
    arriving, leaving = [], []
    for frame, place in zip(frames, places, strict=True):
        steps = min(velocity_steps, len(frame) - 1)
        arriving.append(_mean_velocity(frame, place, first=0, last=steps))
        leaving.append(_mean_velocity(frame, place, first=-1 - steps, last=-1))
    return TrackEnds(
        start=np.array([frame[0] for frame in frames]),
        stop=np.array([frame[-1] for frame in frames]),
        first=np.array([place[0] for place in places]),
        last=np.array([place[-1] for place in places]),
        arriving=np.array(arriving),
        leaving=np.array(leaving),
    )


def select_chain_ends(tracks: TrackEnds, chains: Chains) -> TrackEnds:
    """Return where chains begin and end: as their first track begins, and their last one ends."""
    first, last = [chain[0] for chain in chains], [chain[-1] for chain in chains]
    return TrackEnds(
        tracks.start[first], tracks.stop[last], tracks.first[first], tracks.last[last],
        tracks.arriving[first], tracks.leaving[last],
    )  # fmt: skip


def _mean_velocity(frames: Reals, places: Floats, first: int, last: int) -> Floats:
    """Return the mean velocity (2,) of an animal from row `first` to `last`; 0 for one row.

    frames (k,), places (k, 2): of its track; the unit is that of the places, per frame.
    """
    if len(frames) < 2:
        return np.zeros(2)
    return (places[last] - places[first]) / max(frames[last] - frames[first], 1)


@dataclass(frozen=True)
class GapDrift:
    """How far animals drift in a gap: the mismatch of positions predicted from both sides."""

    gaps: Floats  # (k,) lengths in frames, ascending
    mismatch: Floats  # (k,) median distance of the two predictions, body lengths
    share: Floats  # (k,) share of the velocity before the gap that lasts
    tank: float  # area, body lengths²
    velocity_frames: int  # before and after a gap, over which a velocity is measured

    def log_ratio(self, gap_frames: Floats, distance: Floats) -> Floats:
        """Return log(P(one animal) / P(two)) of the tracks around each gap, (e,), by distance.

        gap_frames (e,): lengths; distance (e,): d between the two predicted places, body lengths.
        The result is log((1 − ε) A m² / (π (m² + d²)²) + ε); the fraction is limited. m is the
        median of d for such a gap, A the tank's area, ε the share of animals that may be anywhere.
        The density is Student's t in the plane, with two degrees of freedom: most animals swim on,
        some dart.
        """
        median = np.maximum(np.interp(gap_frames, self.gaps, self.mismatch), _LEAST_MISMATCH)
        density = median**2 / (np.pi * (median**2 + distance**2) ** 2)
        return np.log((1 - _TAIL) * np.minimum(density * self.tank, _SUREST) + _TAIL)


def measure_drift(tracks: pd.DataFrame) -> GapDrift:
    """Return how far animals of a film drift in gaps, measured on artificial gaps.

    tracks: track_id, frame, x, y (body lengths), sorted by track and frame. Trial gaps are cut into
    whole tracks; they double from one frame on, while enough tracks are that long. The velocity is
    measured over the number of frames that gives the least mismatch: over less than a tail beat it
    may point aside. In a film of short tracks an animal may be anywhere after any gap.
    """
    # The tank's area, without the outermost hundredths of all places.
    spread = tracks[["x", "y"]].quantile(0.99) - tracks[["x", "y"]].quantile(0.01)
    tank = float(np.maximum(spread, 1.0).prod())
    anywhere = float(np.sqrt(tank / np.pi))  # mismatch of an animal anywhere: the tank's radius
    # By the number of frames that measure a velocity: the results for gaps of 1, 2, 4 … frames.
    mismatches, shares = dict[int, list[float]](), dict[int, list[float]]()
    for frames in _VELOCITY_FRAMES:
        by_gap, shares_by_gap = _measure_mismatches(tracks, frames)
        if by_gap:
            mismatches[frames], shares[frames] = by_gap, shares_by_gap
    if not mismatches:  # the tracks are too short for any trial gap
        return GapDrift(
            np.ones(1), np.full(1, anywhere), share=np.zeros(1), tank=tank,
            velocity_frames=_VELOCITY_FRAMES[0],
        )  # fmt: skip
    # The best has the least geometric mean of mismatches, over the gaps that all have.
    common = min(map(len, mismatches.values()))
    best = min(
        mismatches, key=lambda frames: np.log(np.add(mismatches[frames][:common], 1e-6)).sum()
    )
    # One more gap, after which an animal may be anywhere: mismatches grow with the root of the gap.
    gaps = 2.0 ** np.arange(len(mismatches[best]))
    longest_mismatch = mismatches[best][-1]  # after the longest gap
    last = max(anywhere, longest_mismatch)
    beyond = gaps[-1] * (last / max(longest_mismatch, _LEAST_MISMATCH)) ** 2 + 1
    return GapDrift(
        np.append(gaps, beyond), np.append(mismatches[best], last),
        share=np.append(shares[best], 0.0), tank=tank, velocity_frames=best,
    )  # fmt: skip


def _measure_mismatches(
    tracks: pd.DataFrame, velocity_frames: int
) -> tuple[list[float], list[float]]:
    """Return how far two predictions differ, and what share of velocity lasts, by length of gap.

    The gaps are 1, 2, 4 … frames long. One prediction of the place half way starts before the gap,
    one after it: the first list has their median distances in body lengths. The second has the
    share (0 to 1) of the velocity before the gap that lasts, fitted by least squares. Both end
    where the film has too few gaps so long.
    """
    place, key = tracks[["x", "y"]].to_numpy(float), tracks[["track_id", "frame"]].to_numpy()
    mismatches, shares = list[float](), list[float]()
    gap = 1
    while True:
        # First rows of trial gaps with both velocities, in one track and without a lost frame.
        span = 2 * velocity_frames + gap
        first = np.flatnonzero((key[span:] - key[:-span] == (0, span)).all(1))
        if len(first) < _LEAST:
            return mismatches, shares
        start = first + velocity_frames  # of the gap
        stop = start + gap
        leaving = (place[start] - place[first]) / velocity_frames
        arriving = (place[stop + velocity_frames] - place[stop]) / velocity_frames
        travel = place[stop] - place[start]
        # Least squares of travel = share · gap · leaving.
        fit = (leaving * travel).sum() / max(gap * (leaving**2).sum(), 1e-12)
        share = float(np.clip(fit, 0, 1))
        shares.append(share)
        mismatch = travel - 0.5 * share * gap * (leaving + arriving)
        mismatches.append(float(np.median(np.hypot(*mismatch.T))))
        gap *= 2


def motion_log_ratios(ends: TrackEnds, drift: GapDrift, pairs: TrackPairs) -> Floats:
    """Return log(P(one animal) / P(two)) of each pair of tracks, (e,), by their motion.

    In a pair, track b begins after a has ended. The place half way between is predicted from both
    sides, from the end of a and from the start of b.
    """
    a, b = pairs
    gap = (ends.start[b] - ends.stop[a]).astype(float)
    half_travel_frames = (0.5 * np.interp(gap, drift.gaps, drift.share) * gap)[:, None]
    from_a = ends.last[a] + half_travel_frames * ends.leaving[a]
    from_b = ends.first[b] - half_travel_frames * ends.arriving[b]
    return drift.log_ratio(gap, np.hypot(*(from_b - from_a).T))
