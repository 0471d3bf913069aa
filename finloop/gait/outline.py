"""Find the outlines of a swimming fish in the frame of its body, and its tail beat (§4.2).

The body frame moves with the fish: x ahead, y to its right (down on the screen when the fish heads
for screen right), in body lengths. It follows place and direction, smoothed over a beat. So travel
is removed, but everything that repeats with the beat remains, such as the yaw of the head and the
wave of the body. Key frames are mirrored in the axis y = 0.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.base.schema import lists_to_points
from finloop.curve.contour import Curve, area_centroids, orient_clockwise, resample_curve
from finloop.features.head import turn_head_first
from finloop.gait.period import Period, find_period, period_from_phase, remove_beat, set_phase_zero

POINTS = 128
STRAIGHT = 0.03
"""Body lengths: a fish turns if its outline without the beat has more asymmetry than this."""

TAIL = 1 / 16  # share of the contour on either side of the tail end that shows the beat


@dataclass(frozen=True)
class TrackContours:
    """A fish's outlines (frames, n, 2) in body lengths, relative to its body, and its tail beat.

    Point 0 is the snout, n / 2 the tail end; clockwise on screen. Phase 0 is where the tail is
    farthest to the left. Without a beat, every frame is aligned by its own pose. length_px: body
    length.
    """

    points: Floats
    period: Period
    length_px: float


def track_outlines(track: pd.DataFrame, features: pd.DataFrame) -> tuple[Floats, Floats]:
    """Return a track's outlines (frames, m, 2) and backbones (frames, k, 2), head first, in px.

    track, features: rows of both tables for the same frames; `features` tell where the head is.
    Outlines keep their first point and direction. FinloopError if the frames differ.
    """
    outline, backbone = (lists_to_points(track, name) for name in ("outline", "backbone"))
    if len(track) != len(features) or (track["frame"].values != features["frame"].values).any():
        raise FinloopError(
            f"{len(track)} frames of a track and {len(features)} of its features do not match",
            "the same frames in both",
            "remake both: dvc repro features",
        )
    return outline.astype(float), turn_head_first(backbone, features)


def swim_contours(
    outline_px: Floats, backbone_px: Floats, frame_rate_hz: float, n: int = POINTS
) -> TrackContours:
    """Return a fish's tail beat, and its contours in body lengths, relative to its body.

    outline_px (frames, m, 2) of consecutive frames, in either direction; backbone_px (frames, k,
    2) head first; n: points of a contour, even. Contours are placed by the fish's place and
    direction without the beat. If it does not swim straight with a steady beat, `period.why` says
    why, and each contour is placed by the pose in its own frame.
    """
    points = contours_from_snout(outline_px, backbone_px[:, 0], n)
    length = float(np.median(np.hypot(*np.diff(backbone_px, axis=1).transpose(2, 0, 1)).sum(1)))
    centre, angle = body_centres_and_directions(points, backbone_px)
    by_pose = move_to_body_frame(points, centre, angle) / length
    beat = _find_tail_beat(by_pose, frame_rate_hz)
    if not beat.cycles:
        return TrackContours(by_pose, beat, length)
    smooth_body = remove_beat(np.column_stack([centre, angle]), beat.phase)
    contours = move_to_body_frame(points, smooth_body[:, :2], smooth_body[:, 2]) / length
    # A frame can be steady only if the body is straight there once the beat is removed.
    coordinates = contours.reshape(len(contours), -1)
    without_beat = remove_beat(coordinates, beat.phase).reshape(contours.shape)
    straight = contour_asymmetry(without_beat) <= STRAIGHT
    steady = period_from_phase(coordinates, beat.phase, beat.steady & straight, frame_rate_hz)
    if not steady.cycles:
        why = f"it turns: where it is straight, {steady.why}"
        return TrackContours(by_pose, replace(steady, why=why), length)
    phased = set_phase_zero(steady, -tail_sideways_positions(contours))
    return TrackContours(contours, phased, length)


def _find_tail_beat(contours: Floats, frame_rate_hz: float) -> Period:
    """Return the tail beat in contours (frames, n, 2); phase 0 has the tail farthest to the left.

    Contours are relative to the body, x ahead, y to the right, and begin at the snout.
    """
    # The mean of two points equally far from the snout lies on the midline: a tail beat moves it;
    # fins that spread on both sides do not.
    n, y = contours.shape[1], contours[..., 1]
    midline_y = (y + y[:, -np.arange(n)])[:, : n // 2 + 1] / 2  # (frames, n / 2 + 1)
    return find_period(midline_y, frame_rate_hz, -tail_sideways_positions(contours))


def join_steady_frames(swims: Sequence[TrackContours]) -> tuple[Floats, Floats]:
    """Return the contours (f, n, 2) and phases (f,) of all tracks' frames with a steady tail beat.

    Phases are in cycles and ascend through all runs of steady frames: each run begins a new whole
    cycle. FinloopError if no track is periodic; the message counts the reasons.
    """
    points, phase = list[Floats](), list[Floats]()
    next_cycle = 0.0
    for swim in swims:
        if swim.period.why:
            continue
        steady_rows = np.flatnonzero(swim.period.steady)
        for run in np.split(steady_rows, np.flatnonzero(np.diff(steady_rows) > 1) + 1):
            run_phase = swim.period.phase[run]
            points.append(swim.points[run])
            phase.append(run_phase - np.floor(run_phase[0]) + next_cycle)
            next_cycle = np.floor(phase[-1][-1]) + 1
    if not points:
        why = Counter(re.sub(r"[\d.]+ cycles", "… cycles", swim.period.why) for swim in swims)
        raise FinloopError(
            "no track has a steady tail beat: "
            + "; ".join(
                f"{count} of {len(swims)}: {reason}" for reason, count in why.most_common()
            ),
            "a fish that swims straight and beats its tail evenly for two beats or more",
            "use film of steady swimming, at ten frames a beat or more",
        )
    return np.concatenate(points), np.concatenate(phase)


def contours_from_snout(outline_px: Floats, snout_px: Floats, n: int) -> Floats:
    """Return outlines (frames, m, 2) as n points, clockwise from the snout: (frames, n, 2) px.

    snout_px (frames, 2): point 0 is the point of the outline nearest to it. Points lie at equal
    distances along the outline.
    """
    contours = np.empty((len(outline_px), n, 2))
    for outline, snout, contour in zip(outline_px, snout_px, contours, strict=True):
        corners = orient_clockwise(Curve(outline, closed=True)).points
        edges = np.roll(corners, -1, axis=0) - corners  # each from its corner to the next
        square = np.maximum((edges**2).sum(axis=1), 1e-12)  # never divide by 0
        share = np.clip(((snout - corners) * edges).sum(axis=1) / square, 0, 1)
        nearest_on_edge = corners + share[:, None] * edges  # each edge's point nearest to the snout
        edge = int(((nearest_on_edge - snout) ** 2).sum(axis=1).argmin())
        next_corners = np.roll(corners, -edge - 1, axis=0)
        ring = Curve(np.concatenate([nearest_on_edge[[edge]], next_corners]), closed=True)
        contour[:] = resample_curve(ring, n).points
    return contours


def body_centres_and_directions(points: Floats, backbone: Floats) -> tuple[Floats, Floats]:
    """Return mass centres (frames, 2) of contours, and directions [rad] (frames,) of backbones.

    points (frames, n, 2): contours; backbone (frames, k, 2), head first. A direction is that of the
    straight line nearest to the backbone, towards the head: radians from x towards y, unwrapped.
    """
    centred = backbone - backbone.mean(axis=1, keepdims=True)
    xx, yy = (centred**2).sum(axis=1).T
    xy = centred.prod(axis=2).sum(axis=1)
    angle = np.arctan2(2 * xy, xx - yy) / 2  # of the longer principal axis
    ahead = backbone[:, 0] - backbone[:, -1]
    points_to_tail = ahead[:, 0] * np.cos(angle) + ahead[:, 1] * np.sin(angle) < 0
    return area_centroids(points), np.unwrap(angle + np.pi * points_to_tail)


def move_to_body_frame(points: Floats, centre: Floats, angle: Floats) -> Floats:
    """Return contours (frames, n, 2) in the frame of the body: it lies at 0 and heads for +x.

    centre (frames, 2): place of the body; angle (frames,): its direction, radians from x towards y.
    """
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    return (points - centre[:, None]) @ turn


def contour_asymmetry(points: Floats) -> Floats:
    """Return how far (frames,) contours differ from their mirror images in the body's axis.

    The result (frames,) is half the RMS distance between points and their images, in their unit.
    Contours are relative to the body and begin at the snout.
    """
    image = points[:, -np.arange(points.shape[1])] * [1, -1]
    return np.sqrt(((points - image) ** 2).sum(axis=2).mean(axis=1)) / 2


def tail_sideways_positions(points: Floats) -> Floats:
    """Return how far the tail end is to the right of the body's axis, (frames,).

    Outlines are relative to the body, x ahead, y to the right, and begin at the snout; the unit is
    theirs. Averaged are the tail end and, on either side of it, a share TAIL of the points.
    """
    n = points.shape[1]
    reach = max(1, round(TAIL * n))
    return points[:, n // 2 - reach : n // 2 + reach + 1, 1].mean(axis=1)
