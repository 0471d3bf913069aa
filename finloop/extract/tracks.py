"""Link fish from frame to frame to tracks (fish paper §2.1, several fish at once).

A track is a run of consecutive frames of one isolated fish. It ends where its identity becomes
uncertain: where the fish touches another one or the border, vanishes, or moves farther than a fish
can. Afterwards a new track begins, even if it is the same animal, so two fish are never confused.

A track is *swallowed* if no silhouette is assigned to it and its expected place lies inside the box
of a silhouette that is assigned to another track.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Floats

_GREW = 1.15  # a silhouette that gains or loses part of a neighbour changes by more
_CLEARLY = 1.5  # a long step counts only if any other pairing is this many times as far

Box = tuple[int, int, int, int]  # x0, y0, x1, y1, half-open


@dataclass(frozen=True)
class SilhouettePlace:
    """The position of a silhouette in a frame; only an `isolated` one can join a track.

    x_px, y_px: its centre; box: the pixels it spans. outline: (n, 1, 2) int32 px, only where tracks
    come from a file.
    """

    x_px: float
    y_px: float
    area_px: float
    box: Box
    isolated: bool
    outline: NDArray[np.int32] | None = field(default=None, compare=False)


@dataclass
class _Track:
    """A running track: its number, its last silhouette, and its last step (vx, vy) [px]."""

    number: int
    spot: SilhouettePlace
    vx: float = 0.0
    vy: float = 0.0

    @property
    def next_place(self) -> tuple[float, float]:
        """Return the position x, y [px] expected in the next frame."""
        return self.spot.x_px + self.vx, self.spot.y_px + self.vy


class TrackLinker:
    """Links silhouettes of successive frames to tracks, the nearest ones first.

    gate_px: largest distance of a fish from the place expected from its last two frames. Beyond a
    quarter of it, any other partner of the track or the silhouette must be 1.5 times as far away.
    area_ratio: largest ratio by which a silhouette may grow or shrink from one frame to the next.
    """

    def __init__(self, gate_px: float, area_ratio: float) -> None:
        """Start without tracks."""
        self._gate, self._ratio = gate_px, area_ratio
        self._tracks: list[_Track] = []
        self._before: list[SilhouettePlace] = []  # every spot of the frame before, isolated or not
        self._next = 0

    def end_tracks(self) -> None:
        """End every track, because the film has a cut here."""
        self._tracks, self._before = [], []

    def link_frame(self, silhouettes: list[SilhouettePlace]) -> list[int | None]:
        """Return the track number of each silhouette of the next frame; None without a track.

        None: the silhouette is not isolated, or it has grown and hides a lost track. A silhouette
        begins a new track if it matches no track, or if another silhouette has split off from it.
        """
        owner = self._match_tracks(silhouettes)
        lost_tracks = [track for track in self._tracks if track not in owner.values()]
        numbers: list[int | None] = [None] * len(silhouettes)
        tracks = []
        for i, spot in enumerate(silhouettes):
            if not spot.isolated:
                continue
            track = owner.get(i)
            grown = track is not None and spot.area_px > _GREW * track.spot.area_px
            if grown and _box_contains_any(spot.box, (other.next_place for other in lost_tracks)):
                continue  # it hides a lost track
            if track is not None and self._has_split(track.spot, i, silhouettes, owner):
                track = None
            if track is None:
                track = _Track(self._next, spot)
                self._next += 1
            else:
                track.vx, track.vy = spot.x_px - track.spot.x_px, spot.y_px - track.spot.y_px
                track.spot = spot
            numbers[i] = track.number
            tracks.append(track)
        self._tracks, self._before = tracks, silhouettes
        return numbers

    def _match_tracks(self, silhouettes: list[SilhouettePlace]) -> dict[int, _Track]:
        """Return the running tracks that match silhouettes of a frame, by silhouette number.

        A pair must be within the limits of step and area. It must be near (a quarter of the
        limit), or clearly nearer than any other pair with that track or that silhouette. Of these
        pairs, those with the smallest sum of distances are taken.
        Tracks without a partner, and silhouettes that are not isolated, are left out.
        """
        if not self._tracks or not silhouettes:
            return {}
        expected = np.asarray([track.next_place for track in self._tracks])
        difference = expected[:, None] - np.asarray([(s.x_px, s.y_px) for s in silhouettes])
        distance = np.hypot(difference[..., 0], difference[..., 1])
        unambiguous = distance < self._gate / 4
        unambiguous |= (_CLEARLY * distance < _least_of_others(distance)) & (
            _CLEARLY * distance < _least_of_others(distance.T).T
        )
        ratio = np.log([[s.area_px / t.spot.area_px for s in silhouettes] for t in self._tracks])
        allowed = (distance <= self._gate) & unambiguous & (np.abs(ratio) <= np.log(self._ratio))
        # 1e6 px: pairs that are not allowed come last, and are left out below
        rows, columns = scipy.optimize.linear_sum_assignment(np.where(allowed, distance, 1e6))
        return {
            int(j): self._tracks[i]
            for i, j in zip(rows, columns, strict=True)
            if allowed[i, j] and silhouettes[j].isolated
        }

    def _has_split(
        self, before: SilhouettePlace, number: int, silhouettes: list[SilhouettePlace],
        tracks: dict[int, _Track],
    ) -> bool:  # fmt: skip
        """Return whether a silhouette shrank because it separated from another one.

        before: its place in the frame before; silhouettes: those of this frame, in which it has
        this `number`; tracks: running tracks, by the number of their silhouette in this frame.
        """
        if before.area_px <= _GREW * silhouettes[number].area_px:
            return False
        others = [other for other in self._before if other != before]
        new_places = (
            (s.x_px, s.y_px)
            for i, s in enumerate(silhouettes)
            # a new silhouette, no speck, where no other one was before
            if i != number and i not in tracks and s.area_px * 4 > before.area_px
            and not any(_box_contains_any(b.box, [(s.x_px, s.y_px)]) for b in others)
        )  # fmt: skip
        return _box_contains_any(before.box, new_places)


def _least_of_others(matrix: Floats) -> Floats:
    """Return for each entry of a matrix the least of the other entries in its row."""
    if matrix.shape[1] < 2:
        return np.full_like(matrix, np.inf)
    least, second = np.partition(matrix, 1, axis=1)[:, :2, None].transpose(1, 0, 2)
    return np.where(matrix == least, second, least)


def _box_contains_any(box: Box, places: Iterable[tuple[float, float]]) -> bool:
    """Return whether any of the positions x, y [px] lies in a box."""
    x0, y0, x1, y1 = box
    return any(x0 <= x < x1 and y0 <= y < y1 for x, y in places)
