"""Parameters of `bpn`: the network and how it learns (fish paper §3.1, Figs. 6, 15)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.settings import Count, Positive, Seed, Share


@dataclass(frozen=True)
class Settings:
    """The network 4-hidden-2, how it learns, and what it never learns from.

    Attributes
    ----------
    hidden : units, >= 1
        Units between the 4 inputs and the 2 outputs.
    learning_rate : per row, > 0
        A larger `batch_size` wants a smaller one. The paper: 0.5.
    momentum : share of the last change of weight, 0-1
        How far a weight goes on as before. The paper: 0.5.
    epochs : epochs, >= 1
        How often every row is learnt from. The paper: 200.
    batch_size : rows, >= 1
        Rows a step, their gradients summed; 1 is the paper's rule, but slower.
    seed : >= 0
        For the split, the first weights and the order of rows.
    split : blocks or tracks
        What is held out: stretches of time, across all fish, or whole tracks.
    block_s : seconds, > 0
        Length of a stretch of time; it should be well above `features.delta_s`.
    held_out : share of the rows, 0-1
        What the network never learns from, to measure its error there.
    device : cpu or cuda
        Where it learns; cuda is slower for a network of this size.
    """

    hidden: Count
    learning_rate: Positive
    momentum: Annotated[float, Field(ge=0, lt=1)]
    epochs: Count
    batch_size: Count
    seed: Seed
    split: Literal["blocks", "tracks"]
    block_s: Positive
    held_out: Share
    device: Literal["cpu", "cuda"]
