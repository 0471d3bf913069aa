"""Parameters of `forecast`: the network, how it learns, and how its forecasts are sampled."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Positive, Seed, Share


@dataclass(frozen=True)
class ForecastSettings:
    """The network of the next pose and motion, how it learns, and what is sampled beside it."""

    # The state.
    share: Share  # of the variance of the postures' codes that those of a state explain
    # Δ; the ages of the states that make the past, from 0
    lags: Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(min_length=1)]

    # The network and how it learns.
    hidden: Count  # units in each of its two hidden layers
    learning_rate: Positive  # of AdamW
    weight_decay: NotNegative  # of AdamW
    batch_size: Count  # rows a step
    epochs: Count  # at most; learning stops sooner where the held-out error ...
    patience: Count  # ... has not fallen for this number of epochs
    # rows learnt from, and held out: the most; a longer film gives a random sample
    most_rows: Annotated[int, Field(ge=20)]
    # standard deviations by which the past is disturbed while the network learns: it then leads a
    # fish whose state the film does not show back to those that it does
    noise: NotNegative
    seed: Seed  # for the split, the first weights, the order of rows and the noise
    # Δ; stretches of time, of all fish, that are held out together; a short film's are shorter
    block: Positive
    held_out: Share  # share of the rows that is never learnt from

    # The spread: the film's departures from the mean, of rows in similar states.
    neighbours: Count  # rows of other passages, the most similar ones, that a fish may jump to
    fade: Positive  # Δ; the age at which a state counts half in the likeness of two rows
    look: Positive  # deviations in light and skin: the most between similar rows ...
    seen: Positive  # ... and natural steps: the greatest visible distance between them
    # Δ, on average, for which the departures of successive rows are taken; longer in a film whose
    # postures last longer
    follow: Positive
    # of the spread of similar rows' controls: that of the rows taken under a control
    obey: Positive
    # Δ in which the difference from the followed row halves, beside what the network foretells:
    settle_pose: Positive  # of the posture
    settle_motion: Positive  # of forward, sideways and turning speed
