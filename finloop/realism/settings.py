"""Parameters of `realism`: how much is compared, in which windows, by which classifier."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Positive, Seed


@dataclass(frozen=True)
class RealismSettings:
    """How an animation is compared with its film."""

    # s, of animation in each mode, and of film at most; its tracks stay whole
    seconds: Positive
    window: Positive  # Δ, length of a window, the input of the classifier
    stride: Positive  # Δ, from the beginning of a window to that of the next one
    step: Positive  # Δ, over which the channels of a window are means; at least a frame
    # blocks of time; each is tested by a classifier that has learnt from the others
    blocks: Annotated[int, Field(ge=2)]
    # Δ of film before and after a block that its classifier does not learn from
    gap: NotNegative
    cluster: Positive  # Δ; windows that begin within it are one observation of the interval
    rounds: Count  # trees of the classifier
    leaves: Annotated[int, Field(ge=2)]  # of a tree, at most
    leaf_windows: Count  # windows in a leaf, at least
    bins: Annotated[int, Field(ge=2, le=255)]  # of the values of a channel, in the classifier
    examples: Annotated[int, Field(ge=0)]  # windows on the contact sheet, of each mode
    slower: Annotated[int, Field(ge=1)]  # times that the film of them is slowed down
    seed: Seed  # for the choice of tracks and for the classifier
