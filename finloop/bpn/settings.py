"""Parameters of `bpn`: the network and how it learns (fish paper §3.1, Figs. 6, 15)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import Count, Positive, Seed, Share


@dataclass(frozen=True)
class BpnSettings:
    """The network 4-hidden-2, how it learns, and what it never learns from."""

    hidden: Count  # units between the 4 inputs and the 2 outputs
    learning_rate: Positive  # per row; the paper: 0.5. A larger `batch_size` wants a smaller one
    # share of the last change of weight that is added to the next; the paper: 0.5
    momentum: Annotated[float, Field(ge=0, lt=1)]
    epochs: Count  # passes over all rows; the paper: 200
    # rows learnt from: the most; a longer film gives a random sample. From 5,000 to 15,000 rows the
    # held-out error of the area falls by 3 %, that of the type from 26 to 24 %
    most_rows: Annotated[int, Field(ge=20)]
    batch_size: Count  # rows a step, their gradients summed; 1 is the paper's rule
    seed: Seed  # for the split, the first weights and the order of rows
    split: Literal["blocks", "tracks"]  # held out: stretches of time of all fish | whole tracks
    # Δ, a stretch of time, well above 1; a short film's are shorter
    block: Positive
    held_out: Share  # share of the rows that is never learnt from, to measure the error there
