"""A track swum by the film's fish: from its points to the edit list, and numbers about both."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.animate.bodies import Bodies
from finloop.animate.joins import joins
from finloop.animate.pictures import Pictures
from finloop.animate.settings import Settings as JoinSettings
from finloop.base.arrays import Floats, Ints, Mask, Points, Reals
from finloop.base.schema import ANY, Column, Schema, columns
from finloop.features.table import delta_of
from finloop.jumps.settings import Settings as Weights
from finloop.jumps.signature import slope
from finloop.pose.film import FilmPoses
from finloop.puppet import Pose
from finloop.reel import Reel
from finloop.retarget.edit import Sources, edit_list, film_codes
from finloop.retarget.motion import Motion, motion_of
from finloop.retarget.place import mirrored, moved, outside, scale_of
from finloop.retarget.posture import (
    Asked,
    aligned,
    asked_postures,
    body_share,
    chord_share,
    on_body,
)
from finloop.retarget.rows import FilmRows, cheapest
from finloop.retarget.settings import Settings
from finloop.retarget.track import Track

_STILL = 0.05  # body lengths in Δ; a point that moves less says no heading

ASKED = Schema(
    Column("tick", "int32", "1"),
    Column("file_s", "float64", "s"),
    *columns("float32", "px", "asked_x_px", "asked_y_px", "drawn_x_px", "drawn_y_px", length=ANY),
    Column("apart", "float32", "body length", nullable=True),
    Column("clamped", "bool", "1"),
    Column("switch", "bool", "1"),
)
"""Every tick as asked and as drawn: time in the file, the points of the track in this tank, the
backbone that is drawn, how far its points are from those asked for, on average; whether the posture
had to be changed to one that the film shows, and whether another row of the film begins."""


class Material(NamedTuple):
    """What has been made of the film that is drawn.

    arena (h, w): where the fish can be; look: of the stage `jumps`; size: px of compared pictures.
    """

    rate_hz: float
    arena: Mask
    reel: Reel
    poses: FilmPoses
    look: Reals
    size: int

    @property
    def bodies(self) -> Bodies:
        """The film's postures; there are no sprites."""
        return Bodies(self.poses, self.reel.goes_on, pd.DataFrame())

    @property
    def pictures(self) -> Pictures:
        """The pictures that an edit list names."""
        return Pictures(self.reel, self.size, self.bodies)


class Retargeted(NamedTuple):
    """An edit list (columns of `EDIT`), what was asked for (of `ASKED`), and numbers."""

    edit: pd.DataFrame
    asked: pd.DataFrame
    numbers: dict[str, float]


class Parts(NamedTuple):
    """Parameters of `jumps` and `animate`: what rows are compared in, and how they are joined."""

    weights: Weights
    joins: JoinSettings


def own_track(made: Material, rows: Ints, name: str) -> Track:
    """A track of this film, its postures and all."""
    poses, features = made.poses, made.reel.features
    steps = poses.pose[rows].backbone_px()
    size = float(poses.pose.size_px[rows[0]])
    return Track(
        name, made.rate_hz, features["frame"].to_numpy(np.int64)[rows], steps,
        np.linspace(0, 1, steps.shape[1]), size * body_share(poses.shapes), poses.codes[rows], rows,
    )  # fmt: skip


def retargeted(track: Track, made: Material, p: Settings, others: Parts) -> Retargeted:
    """A track, swum by the film's fish.

    FinloopError if it is too short, swims tail first, says no size, or does not fit into the tank.
    """
    reel, delta = made.reel, delta_of(made.reel.features)
    motion = motion_of(track, made.rate_hz, p)
    points, start, scale, size = _laid(track, motion, made, p)
    rows = FilmRows.of(reel, made.poses, made.look, others.weights, track.bent)
    if track.rows is not None and not p.own_frames:
        rows = rows.without(track.rows)
    place = np.stack([start.pose.x_px, start.pose.y_px], -1) / reel.length_px
    codes = start.codes if track.bent else None
    heading = np.unwrap(start.pose.heading_rad)
    numbers = cheapest(rows, rows.asked(place, heading, codes), p.candidates, p.switch, delta)
    sources = Sources.of(numbers, rows.follows, len(reel))
    pictures = made.pictures
    how = joins(others.joins, pictures.bodies, delta, pictures.helps)
    pose = start.pose
    if codes is None:
        codes = film_codes(sources, np.degrees(heading), how)
        one = heading if len(track.at) == 1 else None
        pose = aligned(made.poses.shapes.decode(codes), points, track.at, reel.length_px, one)
    drawn_scale = (reel.length_px / reel.lengths_px).astype(float)
    edit = edit_list(sources, pose, codes, drawn_scale, how, made.rate_hz)
    table = _table(motion, points, pose, track.at, start.clamped, sources)
    stay = np.diff(np.concatenate([[0], sources.switch, [len(edit)]])) / made.rate_hz
    return Retargeted(edit, table, {
        "ticks": len(edit),
        "duration_s": len(edit) / made.rate_hz,
        "scale": scale,
        "way_size": size,
        "with_postures": float(track.bent),
        **{f"apart_{name}_pct": 100 * float(table["apart"].quantile(q))
           for name, q in (("median", 0.5), ("p95", 0.95))},
        "clamped_pct": 100 * float(start.clamped.mean()),
        "outside_ticks": int(outside(pose.backbone_px(), made.arena).any(1).sum()),
        "switches": len(sources.switch),
        "switches_per_s": len(sources.switch) / (len(edit) / made.rate_hz),
        "stay_median_s": float(np.median(stay)),
        "mirrored_pct": 100 * float(sources.mirrored.mean()),
        **motion.numbers,
    })  # fmt: skip


def _laid(
    track: Track, motion: Motion, made: Material, p: Settings
) -> tuple[Points, Asked, float, float]:
    """The points (T, m, 2) in this tank, the postures there, the scale, how large the way is.

    A track without postures has the mean one.
    """
    shapes, length_px, at = made.poses.shapes, made.reel.length_px, track.at
    share = body_share(shapes) if len(at) != 2 else chord_share(shapes, at) / np.ptp(at)
    scale = scale_of(track, length_px * share, p)
    points, codes = scale * motion.points, motion.codes
    if p.mirrored:
        points = mirrored(points, made.arena.shape[1])
        codes = None if codes is None else codes @ shapes.mirror
    if track.bent:
        asked = asked_postures(points, at, shapes, length_px, codes)
    else:
        mean = np.repeat(shapes.mean[None], len(points), 0)
        heading = None
        if len(at) == 1:
            still = _STILL * length_px / delta_of(made.reel.features)
            heading = _way_rad(points[:, 0], max(1, round(delta_of(made.reel.features) / 4)), still)
        none = np.zeros((len(points), len(shapes.shapes)))
        asked = Asked(
            aligned(mean, points, at, length_px, heading), none, np.zeros(len(points), bool)
        )
    bodies = asked.pose.backbone_px()
    shift, size = moved(bodies, made.arena, length_px, p)
    centre = bodies.mean(1)
    off = (size - 1) * (centre - centre.mean(0)) + shift
    pose = asked.pose
    pose = pose.at(pose.x_px + off[:, 0], pose.y_px + off[:, 1], pose.heading_rad, pose.size_px)
    return points + off[:, None], asked._replace(pose=pose), scale, size


def _way_rad(place: Points, span: int, still_px: float) -> Floats:
    """The heading (T,) of a point (T, 2) px: where it goes, or would while it hardly moves."""
    speed = slope(place, np.arange(len(place)) < len(place) - 1, span)
    moves = np.flatnonzero(np.hypot(*speed.T) > still_px)
    if not len(moves):
        return np.zeros(len(place))
    heading = np.unwrap(np.arctan2(-speed[moves, 1], speed[moves, 0]))
    return np.interp(np.arange(len(place)), moves, heading)


def _table(
    motion: Motion, points: Points, pose: Pose, at: Floats, clamped: Mask, sources: Sources
) -> pd.DataFrame:
    """Columns of `ASKED`."""
    backbone = pose.backbone_px()
    apart = np.full(len(points), np.nan)
    if len(at) > 1:
        off = np.hypot(*np.moveaxis(on_body(pose, at) - points, -1, 0)).mean(1)
        apart = off / pose.steps_px.sum(-1)
    lists = {
        f"{name}_{axis}_px": pd.Series(list(line[..., k].astype(np.float32)), dtype=object)
        for name, line in (("asked", points), ("drawn", backbone))
        for k, axis in enumerate("xy")
    }
    return pd.DataFrame({
        "tick": np.arange(len(points)),
        "file_s": motion.time_s,
        **lists,
        "apart": apart,
        "clamped": clamped,
        "switch": np.isin(np.arange(len(points)), sources.switch),
    }).astype(ASKED.kinds)[ASKED.names]  # fmt: skip
