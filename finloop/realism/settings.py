"""Parameters of `realism`: how much is compared, in which windows, by which classifier."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from finloop.base.settings import Count, Positive, Seed


@dataclass(frozen=True)
class RealismSettings:
    """Parameters of the stage `realism`: how an animation is compared with its film."""

    seconds: Positive
    window_deltas: Positive
    cross_validation_folds: Annotated[int, Field(ge=2)]
    classifier_trees: Count
    examples: Annotated[int, Field(ge=0)]
    seed: Seed

    windows_per_length: ClassVar[int] = 4  # that begin within the length of one
    windows_per_cluster: ClassVar[int] = 5  # windows in whose time all count as one observation
    step: ClassVar[float] = 0.2  # Δ; channels are means over it, of a frame at least
    leaves: ClassVar[int] = 8  # of a tree, at most; small trees do not learn single windows
    leaf_windows: ClassVar[int] = 10  # in a leaf, at least; a leaf of fewer is chance
    bins: ClassVar[int] = 32  # quantiles of a channel; a few hundred windows fill these
    picture_share: ClassVar[float] = 0.3  # of the channels of pictures that a branch may use
    slower: ClassVar[int] = 4  # times; so the film of examples can be followed by eye
    RENAMED: ClassVar = {
        **dict.fromkeys(("window", "stride", "gap", "cluster"), "window_deltas"),
        "blocks": "cross_validation_folds",
        "rounds": "classifier_trees",
    }
