"""Parameters of the stage `bpn`: the network and how it learns (fish paper §3.1, Figs. 6, 15)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]


@dataclass(frozen=True)
class Bpn:
    """See conf/bpn/default.yaml."""

    hidden: Count
    learning_rate: Positive
    momentum: Annotated[float, Field(ge=0, lt=1)]
    epochs: Count
    batch_size: Count
    seed: Annotated[int, Field(ge=0)]
    split: Literal["blocks", "tracks"]
    block_s: Positive
    held_out: Annotated[float, Field(gt=0, lt=1)]
    device: Literal["cpu", "cuda"]


OPTIONS = {"default": Bpn}
