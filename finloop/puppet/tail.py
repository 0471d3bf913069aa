"""Make backbones of animals with a fat body and a thin tail, such as mice, comparable.

Such a tail is visible only in some frames, and the backbone of a fat body is drawn towards it. So
the backbone is smoothed as far as the body is wide, and divided where the body ends: the body has
the same number of steps in every frame, and the tail steps of the same length.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Points, Reals
from finloop.base.schema import lists_to_array, lists_to_points
from finloop.extract.backbone import resample_line


class TailParameters(NamedTuple):
    """How the end of the body is found, and how body and tail are made comparable.

    thin: the body ends where its width falls to this share of its largest. smoothing: of the
    backbone, a standard deviation in half widths of the body. body: the share of the backbone's
    points that lie on the body. whole: quantile of the tails' lengths that counts as the whole
    tail.
    """

    thin: float
    smoothing: float
    body: float
    whole: float


def visible_tail_spread(tracks: pd.DataFrame, backbones: Reals, thin: float) -> float:
    """Return how much the visible tail varies in length, from 5 to 95 % of rows, in body lengths.

    The unit is the median length of the body without the tail. tracks: half_width_px and backbone
    of k rows; backbones: (k, n, 2) px, head first; thin: the body ends where its width falls to
    this share of its largest.
    """
    end = _find_body_ends(_half_widths_head_first(tracks, backbones), thin)
    step, last = _mean_step_lengths(backbones.astype(float)), backbones.shape[1] - 1
    low, high = np.quantile((last - end) * step, (0.05, 0.95))
    return float((high - low) / max(np.median(end * step), 1e-9))


def align_body_and_tail(
    tracks: pd.DataFrame, backbones: Reals, parameters: TailParameters
) -> Points:
    """Return backbones (k, n, 2) px on which point i is the same place of the animal in all rows.

    The first points, from the head, divide the body, the others the whole tail; where no tail is
    visible, the line continues straight. tracks: backbone_x_px, backbone_y_px, half_width_px of k
    rows; backbones: (k, n, 2), head first, from `features.table.measure_features`.
    """
    widths = _half_widths_head_first(tracks, backbones)
    smooth = np.stack([
        _smooth_line(line, width, parameters.smoothing)
        for line, width in zip(backbones.astype(float), widths, strict=True)
    ])  # fmt: skip
    count = smooth.shape[1]
    body_steps = max(1, round(parameters.body * (count - 1)))
    step_px, body_end = _mean_step_lengths(smooth), _find_body_ends(widths, parameters.thin)
    visible_tail_px = (count - 1 - body_end) * step_px
    # The whole tail, in steps of each row: a quantile of the lengths that are visible in the film.
    tail_steps = np.quantile(visible_tail_px, parameters.whole) / step_px
    tail_shares = np.arange(count - body_steps) / max(count - 1 - body_steps, 1)
    on_body = body_end[:, None] * np.linspace(0, 1, body_steps + 1)[:-1]
    on_tail = body_end[:, None] + tail_steps[:, None] * tail_shares
    places = np.concatenate([on_body, on_tail], 1)  # in steps from the head, also beyond n - 1
    point_before = np.minimum(places.astype(int), count - 2)[..., None]
    start, stop = (np.take_along_axis(smooth, point_before + k, 1) for k in (0, 1))
    return start + (places[..., None] - point_before) * (stop - start)


def _mean_step_lengths(lines: Floats) -> Floats:
    """Return the mean length (k,) [px] of a step of each backbone (k, n, 2)."""
    return np.hypot(*np.diff(lines, axis=1).transpose(2, 0, 1)).mean(1)


def _half_widths_head_first(tracks: pd.DataFrame, backbones: Reals) -> Floats:
    """Return the half widths (k, n) [px] along backbones (k, n, 2) px that begin at the head.

    tracks: half_width_px and backbone of the k rows, in either direction.
    """
    width = lists_to_array(tracks["half_width_px"]).astype(float)
    first = lists_to_points(tracks, "backbone")[:, 0]
    to_head, to_tail = (np.abs(first - backbones[:, end]).sum(1) for end in (0, -1))
    return np.where((to_head <= to_tail)[:, None], width, width[:, ::-1])


def _find_body_ends(widths: Floats, thin: float) -> Floats:
    """Return where on backbones bodies end, (k,), counted in points from the head.

    widths (k, n): along the backbones, px. Ends lie between points, by linear interpolation.
    """
    points, rows = np.arange(widths.shape[1]), np.arange(len(widths))
    limit = thin * widths.max(1)
    is_tail = (widths < limit[:, None]) & (points > widths.argmax(1)[:, None])
    has_tail = is_tail.any(1)
    first = np.where(has_tail, is_tail.argmax(1), points[-1])  # the first point of the tail
    width_before, width_after = widths[rows, first - 1], widths[rows, first]
    drop = np.maximum(width_before - width_after, 1e-9)
    share = np.where(has_tail, np.clip((width_before - limit) / drop, 0, 1), 1)
    return first - 1 + share


def _smooth_line(line: Floats, width: Floats, smoothing: float) -> Floats:
    """Return a backbone (n, 2) without bends that are shorter than the body is wide.

    width (n,): half widths, px; smoothing: standard deviation, in half widths. The line is mirrored
    beyond its ends, which stay, and divided evenly afterwards.
    """
    count = len(line)
    step = max(np.hypot(*np.diff(line, axis=0).T).mean(), 1e-6)
    known_width = width.copy()
    known_width[[0, -1]] = width[[1, -2]]  # the tips have no width
    sd_points = np.clip(smoothing * known_width / step, 1e-3, count / 4)
    extended = np.concatenate([2 * line[0] - line[:0:-1], line, 2 * line[-1] - line[-2::-1]])
    places = np.arange(len(extended)) - (count - 1)
    weight = np.exp(-0.5 * ((places - np.arange(count)[:, None]) / sd_points[:, None]) ** 2)
    return resample_line(weight / weight.sum(1, keepdims=True) @ extended, count)
