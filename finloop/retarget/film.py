"""Let the film's fish swim a recorded track: from its points to an edit list and metrics."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask, Points, Reals
from finloop.base.schema import ANY, Column, Schema, columns
from finloop.distance.reel import Reel
from finloop.edit.bodies import Bodies
from finloop.edit.joins import JoinRules, JoinTimes, resolve_join_rules
from finloop.edit.pictures import Pictures
from finloop.features.table import infer_delta_frames
from finloop.jumps.settings import JumpsSettings as Weights
from finloop.jumps.signature import change_per_row
from finloop.pose.film import FilmPoses
from finloop.puppet import Pose
from finloop.retarget.edit import RowSequence, build_edit_list, shown_pose_codes
from finloop.retarget.motion import RecordedMotion, resample_track
from finloop.retarget.place import find_placement, find_points_outside, track_scale
from finloop.retarget.posture import (
    align_postures,
    backbone_length_share,
    fit_postures,
    places_on_body,
    straight_distance_share,
)
from finloop.retarget.rows import FilmRows, find_cheapest_rows
from finloop.retarget.settings import RetargetSettings
from finloop.retarget.track import Track

_STILL = 0.05  # body lengths in Δ; a point that moves less has no heading

ASKED = Schema(
    Column("tick", "int32", "1"),
    Column("file_s", "float64", "s"),
    *columns("float32", "px", "asked_x_px", "asked_y_px", "drawn_x_px", "drawn_y_px", length=ANY),
    Column("apart", "float32", "body length", nullable=True),
    Column("clamped", "bool", "1"),
    Column("switch", "bool", "1"),
)
"""Every tick as requested and as drawn. file_s: time in the file; asked: points of the track in
this tank; drawn: the backbone; apart: mean distance between both; clamped: the posture was changed
to one that the film shows; switch: another row of the film begins."""


class RetargetData(NamedTuple):
    """All that retargeting needs of the film whose frames are drawn.

    rate_hz: frames per second; arena (h, w): where the fish can be; reel: its rows; poses: their
    postures; look: light and skin of each row, then of each mirror image, as numbers; size: px of
    compared pictures.
    """

    rate_hz: float
    arena: Mask
    reel: Reel
    poses: FilmPoses
    look: Reals
    size: int

    @property
    def bodies(self) -> Bodies:
        """Return the postures of the film's rows, without sprites."""
        return Bodies(self.poses, self.reel.has_next_frame, pd.DataFrame())

    @property
    def pictures(self) -> Pictures:
        """Return the film's pictures, as an edit list (what is drawn at every tick) names them."""
        return Pictures(self.reel, self.size, self.bodies)


class Retargeted(NamedTuple):
    """A retargeted track: edit list (columns of `EDIT`), requested motion, and metrics.

    asked: every tick as requested and as drawn, columns of `ASKED`; numbers: metrics by name.
    """

    edit: pd.DataFrame
    asked: pd.DataFrame
    numbers: dict[str, float]


class JoinParameters(NamedTuple):
    """Parameters of the groups `jumps` and `animate`: how rows are compared and joined.

    weights: of motion and looks, beside the pose; times: of a cross-fade and of inertialization, in
    Δ; join: the kind of transition, a cut, a cross-fade or inertialization.
    """

    weights: Weights
    times: JoinTimes
    join: str


def track_from_film_rows(film: RetargetData, rows: Ints, name: str) -> Track:
    """Return a track to follow, made of rows of the film itself, with their postures.

    rows (t,): rows of the film; name: for messages.
    """
    poses, features = film.poses, film.reel.features
    backbones = poses.pose[rows].backbone_px()
    size_px = float(poses.pose.size_px[rows[0]])
    return Track(
        name=name, rate_hz=film.rate_hz, frame=features["frame"].to_numpy(np.int64)[rows],
        points=backbones, along=np.linspace(0, 1, backbones.shape[1]),
        length_px=size_px * backbone_length_share(poses.shapes), codes=poses.codes[rows], rows=rows,
    )  # fmt: skip


def retarget_track(
    track: Track, film: RetargetData, p: RetargetSettings, others: JoinParameters
) -> Retargeted:
    """Let the film's fish swim a recorded track; return edit list, requested motion and metrics.

    film: the film whose frames are drawn; p: the group `retarget` of the parameters; others: those
    of other stages. FinloopError if the track is too short, swims tail first, has no body length,
    or does not fit into the tank.
    """
    reel = film.reel
    motion = resample_track(track, film.rate_hz, p)
    placed, scale = _fit_track_to_fish(track, motion, film, p)
    rows = FilmRows.from_reel(reel, film.poses, film.look, others.weights, track.has_postures)
    if track.rows is not None and not p.allow_own_frames:
        rows = rows.exclude_rows(track.rows)
    delta = infer_delta_frames(reel.features)
    rules = resolve_join_rules(others.times, others.join, film.bodies, delta)
    sources, placed = _choose_rows_and_move_into_tank(placed, rows, rules, film, p)
    drawn_scale = (reel.length_px / reel.lengths_px).astype(float)
    edit = build_edit_list(sources, placed.pose, placed.codes, drawn_scale, rules, film.rate_hz)
    asked = _requested_motion_table(motion, placed, sources)
    outside = find_points_outside(placed.pose.backbone_px(), film.arena)
    stays = np.diff(np.concatenate([[0], sources.switch, [len(edit)]])) / film.rate_hz
    return Retargeted(edit, asked, {
        "ticks": len(edit),
        "duration_s": len(edit) / film.rate_hz,
        "scale": scale,
        "way_size": placed.path_scale,
        "with_postures": float(track.has_postures),
        "apart_median_pct": 100 * float(asked["apart"].quantile(0.5)),
        "apart_p95_pct": 100 * float(asked["apart"].quantile(0.95)),
        "clamped_pct": 100 * float(placed.clamped.mean()),
        "outside_ticks": int(outside.any(1).sum()),
        "switches": len(sources.switch),
        "switches_per_s": len(sources.switch) / (len(edit) / film.rate_hz),
        "stay_median_s": float(np.median(stays)),
        "mirrored_pct": 100 * float(sources.mirrored.mean()),
        **motion.numbers,
    })  # fmt: skip


class _PlacedTrack(NamedTuple):
    """A recorded track in this film's tank: points (T, m, 2) px along the body, and poses (T).

    along (m,): where along the body the points are, 0 = head, 1 = tail, NaN = the middle; codes (T,
    c): of the postures; clamped (T,): which of them were changed to ones that the film shows;
    path_scale: size of the path, relative to its size when the track was fitted to the fish.
    """

    points: Points
    along: Floats
    pose: Pose
    codes: Floats
    clamped: Mask
    path_scale: float = 1.0

    @property
    def has_postures(self) -> bool:
        """Return whether the track has enough points to show how the animal is bent."""
        return len(self.along) > 2

    def offsets_into_tank(self, film: RetargetData, p: RetargetSettings) -> tuple[Points, float]:
        """Return the shifts (T, 2) px that move bodies into the tank, and how the path is scaled.

        The path is scaled by a factor of at most 1; the bodies keep their size.
        """
        bodies = self.pose.backbone_px()
        shift, factor = find_placement(bodies, film.arena, film.reel.length_px, p)
        centre = bodies.mean(1)
        return (factor - 1) * (centre - centre.mean(0)) + shift, factor

    def shift(self, offset: Points, factor: float) -> "_PlacedTrack":
        """Return the track shifted by offsets (T, 2) px.

        factor: by which the offsets changed the size of the path; only recorded, in `path_scale`.
        """
        pose, (x, y) = self.pose, offset.T
        return self._replace(
            points=self.points + offset[:, None],
            pose=pose.move_to(pose.x_px + x, pose.y_px + y, pose.heading_rad, pose.size_px),
            path_scale=self.path_scale * factor,
        )


def _fit_track_to_fish(
    track: Track, motion: RecordedMotion, film: RetargetData, p: RetargetSettings
) -> tuple[_PlacedTrack, float]:
    """Return a recorded track scaled to this film's fish, and the scale.

    motion: its points at every tick. The scale is px of this film per px of the track. A track
    without postures gets the mean posture.
    """
    shapes, length_px, along = film.poses.shapes, film.reel.length_px, track.along
    # What `track.length_px` measures, on this film's fish, as a multiple of its typical length.
    length_share = backbone_length_share(shapes)
    if len(along) == 2:  # two points show only the straight distance between them
        length_share = straight_distance_share(shapes, along) / np.ptp(along)
    scale = track_scale(track, length_px * length_share, p)
    points = scale * motion.points
    # With postures: the film's nearest ones. Without: the mean posture, turned as the points show.
    if track.has_postures:
        pose, codes, clamped = fit_postures(points, along, shapes, length_px, motion.codes)
        return _PlacedTrack(points, along, pose, codes, clamped), scale
    postures = np.repeat(shapes.mean[None], len(points), 0)
    heading = None
    if len(along) == 1:  # a point heads where it travels
        delta = infer_delta_frames(film.reel.features)
        span = max(1, round(delta / 4))  # a quarter of Δ, as for the film's rows (`FilmRows`)
        # `_STILL` body lengths in Δ, as px a tick.
        heading = _travel_headings(points[:, 0], span, still_px=_STILL * length_px / delta)
    pose = align_postures(postures, points, along, length_px, heading)
    codes, clamped = np.zeros((len(points), len(shapes.shapes))), np.zeros(len(points), bool)
    return _PlacedTrack(points, along, pose, codes, clamped), scale


def _choose_rows_and_move_into_tank(
    track: _PlacedTrack, rows: FilmRows, rules: JoinRules, film: RetargetData, p: RetargetSettings
) -> tuple[RowSequence, _PlacedTrack]:
    """Return the film rows that show a track best, and the track moved into the tank.

    A track without postures gets those of its rows, so it is moved only after these are chosen. A
    path that has to shrink is slower, so its rows are chosen again.
    """
    if track.has_postures:
        track = track.shift(*track.offsets_into_tank(film, p))
        return _choose_rows(track, rows, film, p), track
    sources, postured = _choose_rows_without_postures(track, rows, rules, film, p)
    offset, factor = postured.offsets_into_tank(film, p)
    if factor < 1:
        track = track.shift(offset, factor)
        sources, postured = _choose_rows_without_postures(track, rows, rules, film, p)
        offset, factor = postured.offsets_into_tank(film, p)
    return sources, postured.shift(offset, factor)


def _choose_rows(
    track: _PlacedTrack, rows: FilmRows, film: RetargetData, p: RetargetSettings
) -> RowSequence:
    """Return the showable film rows that move most like a track, one for each tick."""
    pose = track.pose
    place_bl = np.stack([pose.x_px, pose.y_px], -1) / film.reel.length_px
    codes = track.codes if track.has_postures else None
    requested = rows.query_vectors(place_bl, np.unwrap(pose.heading_rad), codes)
    numbers = find_cheapest_rows(
        rows, requested, p.candidates, p.switch, infer_delta_frames(film.reel.features)
    )
    return RowSequence.from_rows(numbers, rows.follows, len(film.reel))


def _choose_rows_without_postures(
    track: _PlacedTrack, rows: FilmRows, rules: JoinRules, film: RetargetData, p: RetargetSettings
) -> tuple[RowSequence, _PlacedTrack]:
    """Return the film rows that move most like a track, and the track with their postures.

    The rows are those that can be shown and swim most like the track.
    """
    sources = _choose_rows(track, rows, film, p)
    heading = np.unwrap(track.pose.heading_rad)
    codes = shown_pose_codes(sources, rules)
    postures = film.poses.shapes.decode(codes)
    # From two or more points the heading follows; a single one shows none.
    known_heading = heading if len(track.along) == 1 else None
    pose = align_postures(postures, track.points, track.along, film.reel.length_px, known_heading)
    return sources, track._replace(pose=pose, codes=codes)


def _travel_headings(place: Points, span: int, still_px: float) -> Floats:
    """Return the direction of travel (T,), radians, of a point (T, 2) px.

    span: ticks to each side over which it is measured. While the point moves less than `still_px` a
    tick, the heading is interpolated; it is 0 if the point never moves more.
    """
    has_next = np.arange(len(place)) < len(place) - 1
    velocity = change_per_row(place, has_next, span)  # px a tick, y down
    moves = np.flatnonzero(np.hypot(*velocity.T) > still_px)
    if not len(moves):
        return np.zeros(len(place))
    heading = np.unwrap(np.arctan2(-velocity[moves, 1], velocity[moves, 0]))
    return np.interp(np.arange(len(place)), moves, heading)


def _requested_motion_table(
    motion: RecordedMotion, track: _PlacedTrack, sources: RowSequence
) -> pd.DataFrame:
    """Return a table of each tick's motion, as requested and as drawn: columns of `ASKED`.

    `apart` is the mean distance between the track's points and the drawn backbone, in its lengths;
    NaN for a track of a single point, on which the fish is placed exactly.
    """
    points, pose, along = track.points, track.pose, track.along
    backbone = pose.backbone_px()
    apart = np.full(len(points), np.nan)
    if len(along) > 1:
        offset = places_on_body(pose, along) - points
        apart = np.hypot(*np.moveaxis(offset, -1, 0)).mean(1) / pose.steps_px.sum(-1)
    lists = {}
    for name, line in (("asked", points), ("drawn", backbone)):
        for k, axis in enumerate("xy"):
            values = list(line[..., k].astype(np.float32))
            lists[f"{name}_{axis}_px"] = pd.Series(values, dtype=object)
    return pd.DataFrame({
        "tick": np.arange(len(points)),
        "file_s": motion.time_s,
        **lists,
        "apart": apart,
        "clamped": track.clamped,
        "switch": np.isin(np.arange(len(points)), sources.switch),
    }).astype(ASKED.pandas_dtypes)[ASKED.names]  # fmt: skip
