"""Parameters of `forecast`: the network, how it learns, and how its forecasts are sampled."""

from dataclasses import dataclass
from typing import ClassVar

from finloop.base.settings import Count, NotNegative, Positive, Seed, Share


@dataclass(frozen=True)
class ForecastSettings:
    """The network of the next state, how it learns, and which rows count as similar."""

    pose_variance_ratio: Share

    hidden_units: Count
    learning_rate: Positive
    epochs: Count
    input_noise_sd: NotNegative
    seed: Seed

    held_out_block_deltas: Positive
    held_out_ratio: Share

    similar_frames: Count
    max_discontinuity: Positive

    lag_deltas: ClassVar[tuple[float, ...]] = (0.0, 0.17, 0.33, 0.67, 1.0)
    """Ages of the states that make the past, in Δ; denser near now, which says most."""
    weight_decay: ClassVar[float] = 0.001  # of AdamW; a tenth of its usual value
    batch_size: ClassVar[int] = 256  # rows a step; a usual value
    patience: ClassVar[int] = 10  # epochs without a smaller held-out error that end the learning
    most_rows: ClassVar[int] = 100_000  # rows of either part; of more a sample, to save time
    past_half_life_deltas: ClassVar[float] = 0.5  # Δ; age at which a state counts half
    max_look_difference: ClassVar[float] = 0.5
    """Deviations in light and skin: the most between similar rows, a jump between which would be
    seen."""
    follow_deltas: ClassVar[float] = 1.25
    """Mean time, in Δ, that a fish follows one row; longer where postures last longer."""
    control_tolerance: ClassVar[float] = 0.1
    """Width of what passes for a control, as a share of the spread over similar rows: a small one
    lets the fish turn as it is steered."""
    # Δ; half-lives of a difference of posture: long, as it shows; of speed: short
    pose_half_life_deltas: ClassVar[float] = 0.5
    motion_half_life_deltas: ClassVar[float] = 0.1

    RENAMED: ClassVar[dict[str, str]] = {
        "share": "pose_variance_ratio",
        "hidden": "hidden_units",
        "noise": "input_noise_sd",
        "block": "held_out_block_deltas",
        "held_out": "held_out_ratio",
        "seen": "max_discontinuity",
        "neighbours": "similar_frames",
        "lags": "lag_deltas",
        "fade": "past_half_life_deltas",
        "look": "max_look_difference",
        "follow": "follow_deltas",
        "obey": "control_tolerance",
        "settle_pose": "pose_half_life_deltas",
        "settle_motion": "motion_half_life_deltas",
    }
