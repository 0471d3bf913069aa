"""Choose the film rows that a track is drawn from: the cheapest sequence (Viterbi).

Each tick costs the difference between its row and the requested motion, in natural steps, per Δ.
Playing the film on costs nothing. A transition costs `switch` natural steps, plus the difference in
light and skin.
"""

from dataclasses import dataclass, replace

import numpy as np

from finloop.base.arrays import Floats, Ints, Reals
from finloop.base.errors import FinloopError
from finloop.base.nearest import Nearest
from finloop.distance.reel import Reel
from finloop.features.table import infer_delta_frames
from finloop.jumps.settings import JumpsSettings as Weights
from finloop.jumps.signature import (
    change_per_row,
    measure_film_motion,
    measure_motion,
    part_divisors,
)
from finloop.pose.film import FilmPoses

_BEAM = 4  # times the candidates: the sequences kept for the next tick


@dataclass(frozen=True)
class FilmRows:
    """The rows of a film that can be shown, as vectors by which they are compared.

    m is `count`, or twice that with mirror images; a mirror image has its row's number + count.
    values (m, d): posture, its change, and motion; motion alone for a track without postures. seen
    (m, q): what is visible at a jump. Both are in natural steps. follows (m,): the number that
    comes next in the film, −1 = none. scales: factors of the parts of `values`; span: rows over
    which a change is measured.
    """

    count: int
    values: Floats
    seen: Floats
    follows: Ints
    scales: list[Floats]
    span: int

    @classmethod
    def from_reel(
        cls, reel: Reel, poses: FilmPoses, look: Reals, weights: Weights, has_postures: bool
    ) -> "FilmRows":
        """Return the rows of a film as vectors by which they can be compared.

        look: light and skin of each row, then of each mirror image, from the stage `jumps`;
        weights: of pose, its change, motion and look; has_postures: whether the track has postures.
        """
        n, span = len(reel), max(1, round(infer_delta_frames(reel.features) / 4))
        sides = len(look) // n  # 2 with mirror images, else 1
        # The parts of a vector, each (2, n, …): of the rows [0], of their mirror images [1]; and
        # the factors by which they are scaled.
        codes = np.stack([poses.codes, poses.codes @ poses.shapes.mirror_matrix])
        change = np.stack([change_per_row(part, reel.has_next_frame, span) for part in codes])
        motion = measure_film_motion(reel, span)
        scales = [
            weights.pose_weight / part_divisors(codes),
            weights.change / part_divisors(change),
            weights.motion_weight / part_divisors(motion, each=True),
        ]
        pose_part, change_part, motion_part = (
            part[:sides] * scale
            for part, scale in zip((codes, change, motion), scales, strict=True)
        )
        look_part = weights.appearance_weight * np.asarray(look, float).reshape(sides, n, -1)
        all_parts = [pose_part, change_part, motion_part, look_part]
        vectors, (first, after) = np.concatenate(all_parts, axis=-1)[0], reel.step_ends
        steps = np.linalg.norm(vectors[after] - vectors[first], axis=-1)
        natural_step = max(float(np.median(steps)), 1e-12)
        # A track without postures is compared by its motion alone. The film's pose is free there,
        # so at a jump not only light and skin change visibly, but the pose, too.
        compared, visible = all_parts[:3], [look_part]
        if not has_postures:
            scales, compared, visible = scales[2:], [motion_part], [pose_part, look_part]
        next_row = np.where(reel.has_next_frame, np.arange(n) + 1, -1)
        next_mirror_image = np.where(next_row < 0, -1, next_row + n)
        return cls(
            count=n,
            values=_join_and_flatten(compared) / natural_step,
            seen=_join_and_flatten(visible) / natural_step,
            follows=np.concatenate([next_row, next_mirror_image][:sides]),
            scales=[scale / natural_step for scale in scales],
            span=span,
        )

    def exclude_rows(self, rows: Ints) -> "FilmRows":
        """Return the film's rows, of which some and their mirror images can no longer be shown.

        These keep their numbers, but are infinitely distant, and no row is followed by one of them.
        rows: their numbers in the film. FinloopError if no row remains.
        """
        excluded = np.isin(np.arange(len(self.values)) % self.count, rows)
        if excluded.all():
            raise FinloopError(
                "the film has no frames except those of the requested track",
                "other frames of the film from which to draw it",
                "set retarget.allow_own_frames=true, or take a film with more tracks",
            )
        values = np.where(excluded[:, None], np.inf, self.values)
        follows = np.where(np.isin(self.follows, np.flatnonzero(excluded)), -1, self.follows)
        return replace(self, values=values, follows=follows)

    def query_vectors(self, place: Floats, heading_rad: Floats, codes: Floats | None) -> Floats:
        """Return requested motion as vectors (T, d), to be compared with `values`.

        place (T, 2): of the mass centre, body lengths; heading_rad (T,): not wrapped; codes (T, c):
        pose codes (principal-component scores), None for a track without postures.
        """
        goes_on = np.arange(len(place)) < len(place) - 1
        parts = [measure_motion(place, np.degrees(heading_rad), goes_on, self.span)]
        if codes is not None:
            parts = [codes, change_per_row(codes, goes_on, self.span), *parts]
        scaled = [part * scale for part, scale in zip(parts, self.scales, strict=True)]
        return np.concatenate(scaled, axis=-1)


def _join_and_flatten(parts: list[Floats]) -> Floats:
    """Return s arrays (n, …) joined along the last axis, as a matrix (s n, …)."""
    joined = np.concatenate(parts, axis=-1)
    return joined.reshape(-1, joined.shape[-1])


def find_cheapest_rows(
    rows: FilmRows, requested: Floats, candidates: int, switch: float, delta: int
) -> Ints:
    """Return the film rows (T,) that follow a requested motion at least total cost (Viterbi).

    requested (T, d): vectors of `query_vectors`; candidates: nearest rows tried at a tick, besides
    those that play on; switch: cost of a jump, in natural steps (median steps of the film); delta:
    Δ (time over which motion is measured) in ticks. A mirror image has its row's number + count.
    """
    usable = np.flatnonzero(np.isfinite(rows.values).all(1))
    index = Nearest.from_vectors(rows.values[usable].astype(np.float32))
    nearest = index.search(requested, min(candidates, len(usable)))
    # The beam: the rows that end the cheapest sequences so far, and what these cost. Each tick
    # keeps it, and the index in the last beam of the row from which each row is reached.
    beam, costs = np.zeros(0, np.int64), np.zeros(0)
    beams: list[Ints] = []
    origins: list[Ints] = []
    for tick, wanted in enumerate(requested):
        follows = rows.follows[beam]
        tried = np.union1d(usable[nearest[tick][nearest[tick] >= 0]], follows[follows >= 0])
        cost = np.linalg.norm(rows.values[tried] - wanted, axis=1) / delta  # of being unlike
        origin = np.full(len(tried), -1)
        if tick:
            reach_costs = _costs_of_reaching(rows, tried, beam, costs, switch)
            origin = reach_costs.argmin(0)
            cost += reach_costs[origin, np.arange(len(tried))]
        kept = np.sort(np.argsort(cost, kind="stable")[: _BEAM * candidates])
        beam, costs = tried[kept], cost[kept]
        origins.append(origin[kept])
        beams.append(beam)
    # The cheapest sequence, from the last tick back to the first, as indices in the beams.
    indices = [int(costs.argmin())]
    for origin in origins[:0:-1]:
        indices.append(int(origin[indices[-1]]))
    return np.array([beam[index] for beam, index in zip(beams, indices[::-1], strict=True)])


def _costs_of_reaching(
    rows: FilmRows, tried: Ints, beam: Ints, costs: Floats, switch: float
) -> Floats:
    """Return the costs (b, k) of b sequences, each continued with each of k rows.

    beam (b,): the last rows of the sequences; costs (b,): of these; tried (k,): rows, ascending. A
    jump costs `switch` and its discontinuity from the row that was due; playing on costs nothing.
    """
    follows = rows.follows[beam]
    due = np.where(follows >= 0, follows, beam)
    discontinuity = np.linalg.norm(rows.seen[due][:, None] - rows.seen[tried], axis=-1)
    reach_costs = costs[:, None] + switch + discontinuity
    plays_on = np.flatnonzero(follows >= 0)
    reach_costs[plays_on, np.searchsorted(tried, follows[plays_on])] = costs[plays_on]
    return reach_costs
