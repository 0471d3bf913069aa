"""Parameters of `animate`: where the fish is sent, and how it gets there (Figs. 16-19)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.settings import NotNegative, Positive, Seed


@dataclass(frozen=True)
class Settings:
    """Where the fish is sent, and how it gets there.

    Attributes
    ----------
    goals : x and y of each, in the unit of `goals_in`
        A, B, C …, reached one after the other; afterwards the fish wanders.
    goals_in : tank or px
        tank: shares of its width and height, from the upper left; px: pixels of the clip.
    goal_radius : body lengths, > 0
        A goal is reached when the head or the centre comes so near.
    seconds : seconds, > 0
        Duration of the animation, in every mode.
    seed : >= 0
        For every choice that is left to chance.
    stay_s : seconds, > 0
        In the film: so long between two jumps.
    fade_s : seconds, >= 0
        Cross-fade at a jump; 0 = a cut.
    trials : animations, >= 0
        Further animations to random goals, for the measures alone.
    """

    goals: list[list[float]]
    goals_in: Literal["tank", "px"]
    goal_radius: Positive
    seconds: Positive
    seed: Seed
    stay_s: Positive
    fade_s: NotNegative
    trials: Annotated[int, Field(ge=0)]
