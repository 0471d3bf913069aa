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
    """Return random animations that last `seconds` s in all, as one edit list, fish numbered on.

    The seconds of all fish are summed. Each animation lasts `animate.seconds` at most. Its fish
    swim to random goals, then wander. Seeds whose places leave no room for all fish are skipped;
    NoRoom after `_SEEDS` of them in a row.
    """
    seeds, parts, fish = count(p.seed + 1), list[pd.DataFrame](), 0
    together = animator.fish
    for number in range(int(np.ceil(seconds / p.seconds / together))):
        rest = seconds / together - number * p.seconds
        for one in split_by_fish(_sample_with_room(animator, min(p.seconds, rest), seeds)):
            parts.append(one.assign(fish=fish))
            fish += 1
    return pd.concat(parts, ignore_index=True)


def _sample_with_room(animator: Animator, seconds: float, seeds: Iterator[int]) -> pd.DataFrame:
    """Return the animation with the first of the seeds that has room for all fish."""
    for _ in range(_SEEDS - 1):
        with suppress(NoRoom):
            return animator.sample(next(seeds), seconds)
    return animator.sample(next(seeds), seconds)
