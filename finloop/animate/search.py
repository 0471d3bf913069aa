"""The film as something to swim by: forward along its tracks, across at its loops (Figs. 8, 10).

Whoever swims by the film is at a row of the feature table, drawn `rot` degrees anticlockwise of how
it was filmed. Playing forward moves it as the fish of the film moved, turned by that. At the end of
a loop another row may be shown instead. In pose BODY the heading goes on across a jump, so `rot`
changes; in pose FILM `rot` stays as it is.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numba import njit
from numpy.typing import NDArray

from finloop.animate.arena import inside
from finloop.animate.kinematics import bearing, touches, wrap
from finloop.distance.picture import BODY, typical_length
from finloop.loops.graph import LoopGraph

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Film:
    """Arrays (n,) over the rows of the feature table, and the loops.

    dx, dy: px to the next row at the drawn size, as filmed; heading in degrees; speed in body
    lengths/s; more: whether there is a next row to play; area: relative motion area; scale: drawn
    size / filmed size. end: number of the loop end at a
    row, −1 for none; start, to, seam: what may be shown instead of end k, rows
    `to[start[k]:start[k + 1]]`, and their distances in median steps of the film. endless: whether
    playing on from a row need never stop; body: whether jumps keep the heading, else the rotation.
    """

    dx: Floats
    dy: Floats
    heading: Floats
    speed: Floats
    more: NDArray[np.bool_]
    area: Floats
    scale: Floats
    end: NDArray[np.int32]
    start: NDArray[np.int32]
    to: NDArray[np.int32]
    seam: Floats
    endless: NDArray[np.bool_]
    body: bool

    @property
    def last(self) -> int:
        """The last row."""
        return len(self.more) - 1


def film(
    features: pd.DataFrame, graph: LoopGraph, step: float, pose: str, rate_hz: float, delta: int,
    barred: NDArray[np.bool_],
) -> Film:  # fmt: skip
    """Arrange a feature table and its loops.

    step: the median distance of successive frames; barred (n,): rows that must not be shown.
    """
    n = len(features)
    length = typical_length(features)
    scale = features["body_length_px"].median() / length.to_numpy(float)
    place = features[["x_px", "y_px"]].to_numpy(float) * scale[:, None]
    track = features["track_id"].to_numpy()
    more = np.append(track[1:] == track[:-1], False) & ~barred & ~np.append(barred[1:], True)
    moved = np.zeros((n, 2))
    moved[:-1] = np.diff(place, axis=0)
    moved[~more] = 0.0
    end = np.full(n, -1, np.int32)
    end[graph.ends] = np.arange(len(graph.ends))
    to = graph.ends[graph.to]
    kept = ~barred[to]
    source = np.repeat(np.arange(len(graph.ends)), np.diff(graph.start))
    start = np.searchsorted(source[kept], np.arange(len(graph.ends) + 1)).astype(np.int32)
    to = to[kept].astype(np.int32)
    return Film(
        moved[:, 0], moved[:, 1],
        features["heading_deg"].to_numpy(float),
        _speed(place, track, delta) * rate_hz / float(features["body_length_px"].median()),
        more,
        features["motion_area_rel"].to_numpy(float),
        scale,
        end, start, to,
        graph.distance[kept].astype(float) / step,
        _endless(more, end, start, to),
        pose == BODY,
    )  # fmt: skip


def _speed(place: Floats, track: NDArray[np.int32], delta: int) -> Floats:
    """px per tick over Δ, centred where the track allows it."""
    first = np.searchsorted(track, track, "left")
    last = np.searchsorted(track, track, "right") - 1
    here = np.arange(len(track))
    a, b = np.maximum(here - delta // 2, first), np.minimum(here + delta - delta // 2, last)
    return np.hypot(*(place[b] - place[a]).T) / np.maximum(b - a, 1)


@njit(cache=True)
def _endless(more, end, start, to):  # type: ignore[no-untyped-def]
    """Rows from which one can play for ever: all but those that only lead to ends of tracks.

    Rows without a way on are struck off, again and again, until nothing changes. Without barred
    rows `loops.graph.goes_on` says the same.
    """
    n = more.size
    live = np.ones(n, np.bool_)
    changed = True
    while changed:
        changed = False
        for row in range(n - 1, -1, -1):
            if not live[row]:
                continue
            goes = more[row] and live[row + 1]
            k = end[row]
            if not goes and k >= 0:
                for e in range(start[k], start[k + 1]):
                    # What is shown instead must itself be played on, or two ends swap for ever.
                    if more[to[e]] and live[to[e] + 1]:
                        goes = True
                        break
            if not goes:
                live[row] = False
                changed = True
    return live


@njit(cache=True, nogil=True)
def moved(dx: float, dy: float, rot: float):  # type: ignore[no-untyped-def]
    """A displacement on the screen (y down), turned anticlockwise as seen."""
    angle = np.radians(rot)
    cos, sin = np.cos(angle), np.sin(angle)
    return dx * cos + dy * sin, dy * cos - dx * sin


@njit(cache=True, nogil=True)
def leg(  # type: ignore[no-untyped-def]
    dx, dy, heading, more, end, live, legal, x, y, rot, row, stride, most, at, radius, head,
):  # fmt: skip
    """Play forward from a row to the first loop end after `stride` ticks, at most `most` ticks.

    `live`: rows that may be played.

    Returns
    -------
    x, y, row, ticks played, whether the point `at` is touched at the last one; row −1 where the
    way leaves the legal part of the tank, or the track ends before a loop end.
    """
    cos, sin = np.cos(np.radians(rot)), np.sin(np.radians(rot))
    for t in range(1, most + 1):
        if not more[row]:
            # The last picture of a track may still be exchanged for another.
            return x, y, (row if end[row] >= 0 and t > 1 else -1), t - 1, False
        x, y = x + dx[row] * cos + dy[row] * sin, y + dy[row] * cos - dx[row] * sin
        row += 1
        if not inside(legal, x, y):
            return x, y, -1, t, False
        goes_on = more[row] and live[row + 1]  # who has arrived must go on
        if goes_on and touches(x, y, heading[row] + rot, head, at, radius):
            return x, y, row, t, True
        if t >= stride and end[row] >= 0:
            return x, y, row, t, False
    return x, y, row, most, False


@njit(cache=True, nogil=True)
def remaining(x, y, heading, at, pace, turning):  # type: ignore[no-untyped-def]
    """About how many ticks it is to a point: way / pace [px/tick] + turn / turning [°/tick]."""
    far = np.hypot(at[0] - x, at[1] - y)
    error = abs(wrap(bearing(x, y, at[0], at[1]) - heading))
    return far / pace + error / turning


@njit(cache=True, nogil=True)
def look(  # type: ignore[no-untyped-def]
    dx, dy, heading, speed, more, end, start, to, seam, live, body, shown,
    legal, x, y, rots, rows, costs, sinces, now, at, radius, head, pace, turning,
    horizon, stride, stay, width, w_seam, w_speed, w_again, memory,
):  # fmt: skip
    """What becomes of each of some rows (k,) that could be shown now: a beam search over loops.

    Each is drawn at x, y, turned by its `rots`, costs `costs` ticks to begin with, and is `sinces`
    ticks after a jump. From there the film is played, and at loop ends both kept to and left, as
    far as `horizon` ticks. A way costs its ticks, what its jumps cost, and what remains to the
    point `at`. After every leg the `width` best ways go on.

    shown (n,): the tick at which a row was last on screen; `live`: rows that may be played.

    Returns
    -------
    value (k,): cost of the best way, in ticks, infinite where all leave the tank or end; far (k,):
    px to the point after it, 0 if it is touched; error (k,): of the heading there, degrees; ticks
    (k,): that it takes, or stays in the tank; over (k,): whether it was given up for better ones.
    """
    count = rows.size
    value = np.full(count, np.inf)
    far, error = np.full(count, np.inf), np.full(count, 180.0)
    ticks = np.zeros(count)
    over = np.zeros(count, np.bool_)
    room = width * 16 + count
    state = np.empty((room, 5))  # x, y, rot, cost, f
    place = np.empty((room, 4), np.int64)  # row, first, ticks, since the last jump
    found, layout = np.empty_like(state), np.empty_like(place)
    n = 0
    for c in range(count):
        if live[rows[c]] and inside(legal, x, y):
            state[n] = x, y, rots[c], costs[c], 0.0
            place[n, 0], place[n, 1], place[n, 2], place[n, 3] = rows[c], c, 0, sinces[c]
            n += 1
    while n:
        m = 0
        for s in range(n):
            sx, sy, rot, cost, _ = state[s]
            row, first, t, since = place[s]
            sx, sy, row, played, touched = leg(
                dx, dy, heading, more, end, live, legal, sx, sy, rot, row, stride,
                max(horizon - t, 1), at, radius, head,
            )  # fmt: skip
            t, since = t + played, since + played
            if value[first] == np.inf:
                ticks[first] = max(ticks[first], t)
            if row < 0 or not live[row]:
                continue
            if touched or t >= horizon:
                rest = 0.0
                if not touched:
                    rest = remaining(sx, sy, heading[row] + rot, at, pace, turning)
                if t + cost + rest < value[first]:
                    value[first] = t + cost + rest
                    ticks[first] = t
                    far[first] = 0.0 if touched else np.hypot(at[0] - sx, at[1] - sy)
                    error[first] = (
                        0.0
                        if touched
                        else abs(wrap(bearing(sx, sy, at[0], at[1]) - heading[row] - rot))
                    )
                continue
            f = t + remaining(sx, sy, heading[row] + rot, at, pace, turning)
            if more[row] and live[row + 1] and m < room:
                found[m] = sx, sy, rot, cost, f + cost
                layout[m, 0], layout[m, 1], layout[m, 2], layout[m, 3] = row, first, t, since
                m += 1
            if since < stay:
                continue
            k = end[row]
            for e in range(start[k], start[k + 1]):
                other = to[e]
                if m == room:
                    break
                if not (more[other] and live[other + 1]):
                    continue
                price = cost + jump_cost(
                    seam[e], speed[other] - speed[row], now + t - shown[other],
                    w_seam, w_speed, w_again, memory,
                )  # fmt: skip
                turned = wrap(heading[row] + rot - heading[other]) if body else rot
                found[m] = sx, sy, turned, price, f + price
                layout[m, 0], layout[m, 1], layout[m, 2], layout[m, 3] = other, first, t, 0
                m += 1
        n = min(m, width)
        order = np.argsort(found[:m, 4], kind="mergesort")
        for s in range(m):
            if s < n:
                state[s], place[s] = found[order[s]], layout[order[s]]
            else:
                over[layout[order[s], 1]] = True
    return value, far, error, ticks, over & (value == np.inf)


@njit(cache=True, nogil=True)
def jump_cost(seam, faster, ago, w_seam, w_speed, w_again, memory):  # type: ignore[no-untyped-def]
    """Ticks that a jump is worth avoiding: its seam, its change of speed, what was just seen."""
    return w_seam * seam + w_speed * abs(faster) + w_again * max(0.0, 1.0 - ago / memory)
