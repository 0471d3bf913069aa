"""Sample animations of a mode, to be compared with the film."""

from collections.abc import Iterator
from contextlib import suppress
from itertools import count

import numpy as np
import pandas as pd

from finloop.animate.settings import AnimateSettings
from finloop.animate.shoal import NoRoom
from finloop.edit.schema import split_by_fish
from finloop.modes.animator import Animator

_SEEDS = 100  # seeds tried for one animation: in a nearly full tank few have room for all fish


def sample_animations(animator: Animator, seconds: float, p: AnimateSettings) -> pd.DataFrame:
    """Return random animations that last `seconds` s in all, as one edit list of numbered fish.

    The seconds of all fish are summed. Each animation lasts `animate.seconds` at most. Its fish
    swim to random goals, then wander. Seeds whose places leave no room for all fish are skipped;
    NoRoom after 100 of them in a row.
    """
    seeds, parts = count(p.seed + 1), list[pd.DataFrame]()
    seconds_a_fish = seconds / animator.fish_count
    for number in range(int(np.ceil(seconds / p.seconds / animator.fish_count))):
        rest = seconds_a_fish - number * p.seconds
        edit = _sample_with_room(animator, min(p.seconds, rest), seeds)
        for fish_edit in split_by_fish(edit):
            parts.append(fish_edit.assign(fish=len(parts)))
    return pd.concat(parts, ignore_index=True)


def _sample_with_room(animator: Animator, seconds: float, seeds: Iterator[int]) -> pd.DataFrame:
    """Return the edit list of the first seed with room for all fish; NoRoom after 100 seeds."""
    for _ in range(_SEEDS - 1):
        with suppress(NoRoom):
            return animator.sample(next(seeds), seconds)
    return animator.sample(next(seeds), seconds)
