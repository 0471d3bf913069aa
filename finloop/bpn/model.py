"""The motion model of a fish: state and control now, state Δ later (fish paper §3.1-3.2, Fig. 6).

Glossary: Δ the time between two states (the paper: 5 frames at 25 Hz); *state* motion area and
swimming type (Eq. 2); *control* displacement and included angle over the next Δ (Eqs. 1, 3); the
model is Eq. 4: state(t + Δ) = BPN(state(t), control(t)). The module `back_propagation` learns it;
using it needs only numpy.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask, Reals
from finloop.base.errors import FinloopError
from finloop.bpn.settings import BpnSettings
from finloop.features.memory import held_out_block_frames

INPUTS = {
    "motion_area_rel": "1",
    "swimming_type": "1",
    "displacement": "body length",
    "included_angle_deg": "deg",
}
OUTPUTS = {"motion_area_rel": "1", "swimming_type": "1"}
"""Columns of the feature table and their units, in the order of the model's inputs, outputs."""

OUTPUT_LOW, OUTPUT_HIGH = np.array([0.0, -1.0]), np.array([1.0, 1.0])
MARGIN = 0.05  # targets lie in [MARGIN, 1 - MARGIN]: a sigmoid reaches neither 0 nor 1
_TAIL = 0.01  # share of displacements, and of angles, that lie outside the scaled range
_LEAST_TRAIN, _LEAST_HELD_OUT = 20, 5  # rows


@dataclass(frozen=True, eq=False)
class MotionModel:
    """The trained network (Eq. 4) that predicts how a fish is bent and turns, and its scaling.

    It has 4 inputs, one hidden layer and 2 outputs. Hidden and output units are sigmoids.
    """

    delta_s: float  # the time Δ in seconds from the state that goes in to the state that comes out
    margin: float  # output_low is learnt as `margin`, output_high as 1 - `margin`
    # (4,) the inputs that become -1 and 1 before the first layer; others are clipped to them
    input_low: Floats
    input_high: Floats
    output_low: Floats  # (2,) the range of the outputs
    output_high: Floats
    hidden_weights: Floats  # (4, hidden)
    hidden_bias: Floats  # (hidden,)
    output_weights: Floats  # (hidden, 2)
    output_bias: Floats  # (2,)

    def to_values(self) -> dict[str, Any]:
        """Return the model as plain values for JSON; `restore_motion_model` restores it."""
        return _HEADER | {
            name: np.asarray(value, float).tolist() for name, value in vars(self).items()
        }

    def predict(self, inputs: Reals) -> Floats:
        """Return the states (n, 2) predicted for a time Δ after states and controls (n, 4), Eq. 4.

        inputs: columns and units INPUTS; the result: OUTPUTS. Motion area is in 0 … 1, swimming
        type a real number in -1 … 1: `round_swimming_types` rounds it.
        """
        scaled = scale_to_unit(inputs, self.input_low, self.input_high)
        hidden = scipy.special.expit(scaled @ self.hidden_weights + self.hidden_bias)
        raw = scipy.special.expit(hidden @ self.output_weights + self.output_bias)
        share = (raw - self.margin) / (1 - 2 * self.margin)
        span = self.output_high - self.output_low
        return np.clip(self.output_low + share * span, self.output_low, self.output_high)


_HEADER: dict[str, Any] = {
    "format": "finloop motion model 1", "inputs": INPUTS, "outputs": OUTPUTS,
}  # fmt: skip


def restore_motion_model(**content: Any) -> MotionModel:
    """Return the motion model that the values of `MotionModel.to_values` describe.

    KeyError, TypeError or ValueError if a field is missing, of another size or out of range.
    """
    for name, value in _HEADER.items():
        if content[name] != value:
            raise ValueError(f"no motion model: {name} {value!r} is wanted, got {content[name]!r}")
    delta_s, margin = float(content["delta_s"]), float(content["margin"])
    hidden = len(content["hidden_bias"])
    shapes = {
        "input_low": (4,), "input_high": (4,), "output_low": (2,), "output_high": (2,),
        "hidden_weights": (4, hidden), "hidden_bias": (hidden,),
        "output_weights": (hidden, 2), "output_bias": (2,),
    }  # fmt: skip
    arrays = {name: np.array(content[name], float) for name in shapes}
    for name, array in arrays.items():
        if array.shape != shapes[name] or hidden == 0 or not np.isfinite(array).all():
            raise ValueError(f"{name}: {shapes[name]} finite numbers are wanted")
    for side in ("input", "output"):
        if not np.all(arrays[f"{side}_low"] < arrays[f"{side}_high"]):
            raise ValueError(f"{side}_low is not below {side}_high")
    if not (0 <= margin < 0.5 and 0 < delta_s < np.inf):
        raise ValueError("margin or delta_s is out of range")
    return MotionModel(delta_s, margin, **arrays)


def scale_to_unit(values: Reals, low: Floats, high: Floats) -> Floats:
    """Return values (n, k), clipped to [low, high] and scaled to [-1, 1]; low, high: (k,)."""
    return 2 * (np.clip(np.asarray(values, float), low, high) - low) / (high - low) - 1


def round_swimming_types(swimming_type: Reals) -> NDArray[np.int8]:
    """Return swimming types (any shape) rounded to -1 right, 0 straight or 1 left."""
    return np.rint(swimming_type).astype(np.int8)


def find_input_range(inputs: Floats) -> tuple[Floats, Floats]:
    """Return the range that the network scales to -1 … 1: lowest and highest inputs, (4,) each.

    inputs (n, 4): columns and units INPUTS. Motion area and swimming type have fixed ranges.
    Displacement and angle take theirs from the rows, without the extreme 1 %, so that a wild frame
    does not squeeze the rest. 0° stays in the middle.
    """
    shortest, farthest = np.quantile(inputs[:, 2], [_TAIL, 1 - _TAIL])
    widest = np.quantile(np.abs(inputs[:, 3]), 1 - _TAIL)
    low, high = np.array([0.0, -1.0, shortest, -widest]), np.array([1.0, 1.0, farthest, widest])
    constant = high - low < 1e-9  # one value in all rows: a range of 1 about it
    return low - 0.5 * constant, high + 0.5 * constant


@dataclass(frozen=True, eq=False)
class LearningRows:
    """Pairs of what the network learns: inputs (n, 4), and outputs (n, 2) a time Δ later.

    Columns and units: INPUTS, OUTPUTS. track_id, frame: (n,) of the inputs; delta_frames: Δ in
    frames.
    """

    inputs: Floats
    outputs: Floats
    track_id: Ints
    frame: Ints
    delta_frames: int


def pair_rows_with_later(features: pd.DataFrame, delta_frames: int) -> LearningRows:
    """Return every row of a feature table, paired with the row of the same fish a time Δ later.

    features: track_id, frame and the columns INPUTS; delta_frames: Δ in frames. A row without a
    later one, or with a missing number, is left out.
    """
    now = features[["track_id", "frame", *INPUTS]]
    later = features[["track_id", "frame", *OUTPUTS]]
    later = later.assign(frame=later["frame"] - delta_frames)
    pairs = now.merge(later, on=["track_id", "frame"], suffixes=("", "_later")).dropna()
    pairs = pairs.sort_values(["track_id", "frame"])
    return LearningRows(
        inputs=pairs[list(INPUTS)].to_numpy(float),
        outputs=pairs[[f"{name}_later" for name in OUTPUTS]].to_numpy(float),
        track_id=pairs["track_id"].to_numpy(np.int64),
        frame=pairs["frame"].to_numpy(np.int64),
        delta_frames=delta_frames,
    )


def split_by_blocks(
    rows: LearningRows, block_frames: int, held_out_share: float, rng: np.random.Generator
) -> tuple[Mask, Mask]:
    """Return which rows to learn from, and which to hold out, by stretches of time: masks (n,).

    block_frames: length of a stretch, which holds all tracks; held_out_share: of the rows, about, 0
    … 1. A row whose window t … t + Δ reaches from one side into the other is in neither.
    FinloopError if blocks are shorter than Δ, or rows too few.
    """
    if block_frames < rows.delta_frames:  # a window would reach over a whole block
        raise FinloopError(
            f"bpn.held_out_block_deltas is {block_frames} frames, and Δ, features.delta_s, "
            f"{rows.delta_frames}",
            "blocks that are at least as long as Δ, better ten times",
            "a larger bpn.held_out_block_deltas",
        )
    first, last = rows.frame // block_frames, (rows.frame + rows.delta_frames) // block_frames
    if len(np.unique(first)) < 2:
        raise FinloopError(
            f"the film has rows to learn from in {len(np.unique(first))} block(s) of "
            f"{block_frames} frames",
            "at least two: one to learn from, one to hold out",
            "a smaller bpn.held_out_block_deltas, or a longer film",
        )
    sample = _sample_groups(first, held_out_share, rng)
    begins_held_out, ends_held_out = np.isin(first, sample), np.isin(last, sample)
    return _require_rows(~begins_held_out & ~ends_held_out, begins_held_out & ends_held_out)


def split_by_tracks(
    rows: LearningRows, held_out_share: float, rng: np.random.Generator
) -> tuple[Mask, Mask]:
    """Return which rows to learn from, and which to hold out, by whole tracks: masks (n,).

    held_out_share: of the rows, about, 0 … 1. FinloopError if there are too few tracks or rows.
    """
    tracks = len(np.unique(rows.track_id))
    if tracks < 2:
        raise FinloopError(
            f"the film has {tracks} track(s) to learn from",
            "at least two for bpn.held_out_by=tracks: one to learn from, one to hold out",
            "bpn.held_out_by=blocks, which splits by time",
        )
    held_out = np.isin(rows.track_id, _sample_groups(rows.track_id, held_out_share, rng))
    return _require_rows(~held_out, held_out)


def split_rows(rows: LearningRows, split_by: str, settings: BpnSettings) -> tuple[Mask, Mask]:
    """Return which rows to learn from, and which to hold out: two masks (n,).

    split_by: "blocks" of time or whole "tracks". At most `settings.most_rows` are learnt from: a
    random sample in a long film. FinloopError if the film is too short.
    """
    share = settings.held_out_ratio
    rng = np.random.default_rng((settings.seed, 0))  # 0: the first of two series; training has 1
    if split_by == "tracks":
        train, held_out = split_by_tracks(rows, share, rng)
    else:
        # The least block holds enough rows of one track, and the rows a time Δ after them.
        block_frames = held_out_block_frames(
            settings.held_out_block_deltas,
            share,
            rows.delta_frames,
            rows.frame,
            least_frames=rows.delta_frames + _LEAST_HELD_OUT,
        )
        train, held_out = split_by_blocks(rows, block_frames, share, rng)
    train_rows = np.flatnonzero(train)
    if (surplus := len(train_rows) - settings.most_rows) > 0:
        train[rng.choice(train_rows, surplus, replace=False)] = False
    return train, held_out


def split_rows_if_possible(rows: LearningRows, settings: BpnSettings) -> tuple[Mask, Mask]:
    """Return which rows to learn from, and which to hold out; none of too short a film.

    All rows of a very short film are learnt from, and none is held out. FinloopError if there are
    no rows, or if the user's settings prevent the division: whole tracks, or blocks shorter than Δ.
    """
    try:
        return split_rows(rows, settings.held_out_by, settings)
    except FinloopError:
        by_user = settings.held_out_by == "tracks" or settings.held_out_block_deltas < 1
        if by_user or not len(rows.inputs):
            raise
    all_rows = np.ones(len(rows.inputs), bool)
    return all_rows, ~all_rows


def _sample_groups(group: Ints, share: float, rng: np.random.Generator) -> list[int]:
    """Return random groups with about a share of the rows: one at least, and not all if several.

    group (n,): number of each row's group; share: 0 … 1.
    """
    groups, counts = np.unique(group, return_counts=True)
    sample: list[int] = []
    missing_rows = share * len(group)
    for number in rng.permutation(len(groups)):
        brings_nearer = abs(missing_rows - counts[number]) < missing_rows
        if brings_nearer and len(sample) < len(groups) - 1:
            sample.append(int(groups[number]))
            missing_rows -= counts[number]
    return sample or [int(groups[counts.argmin()])]


def _require_rows(train: Mask, held_out: Mask) -> tuple[Mask, Mask]:
    """Return both masks (n,) as they are; FinloopError if either has too few rows."""
    if train.sum() < _LEAST_TRAIN or held_out.sum() < _LEAST_HELD_OUT:
        raise FinloopError(
            f"{train.sum()} rows to learn from and {held_out.sum()} held out",
            f"at least {_LEAST_TRAIN} and {_LEAST_HELD_OUT}: frames t whose fish is still tracked "
            "at t + Δ, on the same side of the split",
            "a longer film with longer tracks; another bpn.held_out_ratio; with "
            "bpn.held_out_by=blocks another bpn.held_out_block_deltas, well above features.delta_s",
        )
    return train, held_out
