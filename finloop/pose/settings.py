"""Parameters of `pose`: how a film's postures become a few codes."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import NotNegative, Positive, Share


@dataclass(frozen=True)
class PoseSettings:
    """The principal shapes of the postures, and where a body ends and a thin tail begins."""

    share: Share  # of the postures' variance that the principal shapes explain
    # quantile of the distances between nearest postures: the farthest that a pose may be from film
    gap_quantile: Annotated[float, Field(gt=0, le=1)]

    # Whether body and tail have points of their own, for an animal whose tail is hidden at times;
    # auto: if the lengths of tails differ by more than `tail_spread`.
    trunk: Literal["auto", "yes", "no"]
    tail_spread: NotNegative  # lengths of the body, from the 5 % shortest to the 5 % longest tail
    thin: Share  # of the greatest width: the width at which a body ends
    tail_smoothing: Positive  # of such a backbone, standard deviation in half widths of the body
    tail_body: Share  # of its points that the body has; the tail has the others
    tail_whole: Share  # quantile of the tails' lengths that stands for the whole tail
