"""Parameters of `pose`: how a film's postures become a few codes."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import Share


@dataclass(frozen=True)
class PoseSettings:
    """The principal shapes of the postures, and where a body ends and a thin tail begins."""

    explained_variance_ratio: Share
    max_film_distance_quantile: Annotated[float, Field(gt=0, le=1)]
    separate_tail: Literal["auto", "yes", "no"]
    tail_width_ratio: Share

    # lengths of the body, from the 5 % shortest to the 5 % longest tail: from there on `auto` gives
    # the tail points of its own, since so short a tail is a hidden one
    tail_spread: ClassVar[float] = 0.4
    # half widths of the body, standard deviation along such a backbone: the steps of pixels are
    # shorter, bends are longer
    tail_smoothing: ClassVar[float] = 0.5
    # share of such a backbone's points that the body has, the tail has the others: both bend finely
    tail_body: ClassVar[float] = 0.625
    tail_whole: ClassVar[float] = 0.95  # quantile of the tails' lengths: few are longer by mistake
    RENAMED: ClassVar = {
        "share": "explained_variance_ratio",
        "gap_quantile": "max_film_distance_quantile",
        "trunk": "separate_tail",
        "thin": "tail_width_ratio",
    }
