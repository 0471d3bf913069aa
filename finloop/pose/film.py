"""All postures of a film as codes, amounts of its few principal shapes, and back."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Reals
from finloop.base.schema import ANY, Column, Schema, lists_to_points
from finloop.distance.picture import typical_lengths_px
from finloop.features.head import turn_head_first
from finloop.features.memory import measure_memory_frames
from finloop.pose.settings import PoseSettings
from finloop.puppet.pose import Pose, poses_from_features
from finloop.puppet.shapes import PoseShapes
from finloop.puppet.tail import TailParameters, align_body_and_tail, visible_tail_spread

POSES = Schema(
    Column("track_id", "int32", "1"),
    Column("frame", "int32", "1"),
    Column("codes", "float32", "1", length=ANY),
)
"""The codes of every row of the feature table, in its order; as many as there are shapes."""

USED = ("backbone_x_px", "backbone_y_px", "half_width_px")
"""The columns of a table of tracks from which poses are computed."""


@dataclass(frozen=True)
class ShapeFacts:
    """The principal shapes of a film's postures as plain lists, the content of shapes.json.

    mean (d), shapes (c, d), weights (d), variance (c), total_variance, gap: see `PoseShapes`.
    trunk: whether body and tail have backbone points of their own; tail_spread: the number that
    decides it (`puppet.tail.visible_tail_spread`). memory_frames: see `FilmPoses`.
    """

    mean: list[float]
    shapes: list[list[float]]
    weights: list[float]
    variance: list[float]
    total_variance: float
    gap: float
    trunk: bool
    tail_spread: float
    memory_frames: float


@dataclass(frozen=True)
class FilmPoses:
    """The postures of a film's n rows, each as c codes (scores of principal components).

    pose: places, headings, sizes and postures of the rows. codes: (n, c); shapes: turn codes into
    postures and back. trunk, tail_spread: see `ShapeFacts`. memory_frames: the time after which a
    posture is half forgotten (`measure_memory_frames`).
    """

    pose: Pose
    codes: Floats
    shapes: PoseShapes
    trunk: bool
    tail_spread: float
    memory_frames: float

    @cached_property
    def facts(self) -> ShapeFacts:
        """Return the principal shapes as plain lists; with codes, `restore_poses` rebuilds all."""
        shapes = self.shapes
        return ShapeFacts(
            mean=shapes.mean.tolist(), shapes=shapes.shapes.tolist(),
            weights=shapes.weights.tolist(), variance=shapes.variance.tolist(),
            total_variance=shapes.total_variance, gap=shapes.gap, trunk=self.trunk,
            tail_spread=self.tail_spread, memory_frames=self.memory_frames,
        )  # fmt: skip

    def pose_from_codes(self, row: int, codes: Floats) -> Pose:
        """Return the pose of a row with the posture that codes (c,) describe."""
        return replace(self.pose[row], posture=self.shapes.decode(codes))

    def code_table(self, features: pd.DataFrame) -> pd.DataFrame:
        """Return the codes as the table `POSES`; features: the feature table of the same rows."""
        codes = pd.Series(list(self.codes.astype(np.float32)), features.index, dtype=object)
        return features[["track_id", "frame"]].assign(codes=codes)


def compute_film_poses(tracks: pd.DataFrame, features: pd.DataFrame, p: PoseSettings) -> FilmPoses:
    """Return the postures of all rows of a film, each as a few principal components.

    tracks: columns `USED`; features: columns of `FEATURES`, the same rows. FinloopError if the film
    has fewer than two rows.
    """
    lines = turn_head_first(lists_to_points(tracks, "backbone").astype(float), features)
    spread = visible_tail_spread(tracks, lines, p.tail_width_ratio)
    separate = p.separate_tail == "yes" or (p.separate_tail == "auto" and spread > p.tail_spread)
    if separate:
        parameters = TailParameters(p.tail_width_ratio, p.tail_smoothing, p.tail_body, p.tail_whole)
        lines = align_body_and_tail(tracks, lines, parameters)
    pose = poses_from_features(features, lines)
    shapes = PoseShapes.fit(pose.posture, p.explained_variance_ratio, p.max_film_distance_quantile)
    codes = shapes.encode(pose.posture).astype(np.float32).astype(float)  # as files hold them
    memory = measure_memory_frames(codes, features["track_id"].to_numpy())
    return _build_poses(
        features, codes, shapes, trunk=separate, tail_spread=spread, memory_frames=memory
    )


def restore_poses(
    features: pd.DataFrame, codes: Reals, facts: dict[str, Any], posture: Floats | None = None
) -> FilmPoses:
    """Return a film's postures, rebuilt from the codes and shapes that stage `pose` stored.

    features: x_px, y_px, heading_deg, body_length_px, track_id; codes (n, c): scores of principal
    components; facts: the fields of `ShapeFacts`; posture (n, d): the postures of the codes, None
    to compute them. ValueError if their sizes do not match.
    """
    values, stored = codes.astype(float), ShapeFacts(**facts)
    shapes = np.array(stored.shapes)
    if len(values) != len(features) or values.shape[1:] != shapes.shape[:1]:
        raise ValueError(f"{values.shape} codes, {len(features)} rows, {len(shapes)} shapes")
    without_codes = PoseShapes(
        np.array(stored.mean), shapes, weights=np.array(stored.weights),
        variance=np.array(stored.variance), total_variance=stored.total_variance,
        codes=values[:0], gap=stored.gap,
    )  # fmt: skip
    return _build_poses(
        features, values, without_codes, trunk=stored.trunk, tail_spread=stored.tail_spread,
        memory_frames=stored.memory_frames, posture=posture,
    )  # fmt: skip


def _build_poses(
    features: pd.DataFrame, codes: Floats, shapes: PoseShapes, *, trunk: bool, tail_spread: float,
    memory_frames: float, posture: Floats | None = None,
) -> FilmPoses:  # fmt: skip
    """Return a film's postures from their codes (n, c), the scores of principal components.

    posture (n, d): the postures of the codes, None to compute them; the others are fields of
    `FilmPoses`. The shapes get the codes, and those of mirror images.
    """
    whole = replace(shapes, codes=np.concatenate([codes, codes @ shapes.mirror_matrix]))
    pose = Pose(
        features["x_px"].to_numpy(float), features["y_px"].to_numpy(float),
        heading_rad=np.radians(features["heading_deg"].to_numpy(float)),
        size_px=typical_lengths_px(features).to_numpy(float),
        posture=whole.decode(codes) if posture is None else posture,
    )  # fmt: skip
    return FilmPoses(pose, codes, whole, trunk, tail_spread, memory_frames)
