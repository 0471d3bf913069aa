"""The order of the trials: from the protocol's seed, and the same on any machine.

Every permitted order is equally likely. An order is permitted if each condition that repeats the
motion of another one comes after a trial of that one; in blocks, if each block holds every
condition once, and none comes twice in a row (where there is more than one).

No draw is rejected. The precedences form a forest: trials of one condition in their order, and the
first one of a yoked condition after the first of its source. A forest with n nodes has n! / ∏ s
orders, s: the sizes of all its subtrees (Knuth, TAOCP 3, 5.1.4, ex. 20). So the next trial is one
of those that wait for none, each with a probability in proportion to the size of its subtree.
"""

from bisect import bisect_right
from collections.abc import Iterator
from itertools import accumulate
from typing import NamedTuple

from numpy.random import PCG64

from finloop.stimulus.protocol import Protocol, Trigger, derive_motion_seed

_RAW_VALUES = 2**64
"""How many different numbers the generator gives: 0 … 2^64 − 1."""


class ConditionRepeat(NamedTuple):
    """One showing of a condition: the name of the condition, and its number among them, from 0."""

    condition: str
    repeat: int


class Trial(NamedTuple):
    """One trial of a session: its number, its block and its condition's repeat, each from 1.

    condition: its name; seconds: its duration; seed: of its motion.
    """

    number: int
    block: int
    repeat: int
    condition: str
    seconds: float
    seed: int


def order_trials(protocol: Protocol) -> tuple[Trial, ...]:
    """Return all trials of a protocol, in the order in which they are shown."""
    names, generator = list(protocol.conditions), PCG64(protocol.seed)
    if protocol.order == "given":
        order = names * protocol.repeats
    elif protocol.order == "shuffled":
        predecessors = _find_predecessors(protocol, protocol.repeats)
        order = [trial.condition for trial in _random_order(predecessors, generator)]
    else:
        order = list(_shuffle_blocks(protocol, generator))
    block_size = len(order) if protocol.order == "shuffled" else len(names)
    repeats, trials = dict.fromkeys(names, 0), []
    for index, name in enumerate(order):
        repeats[name] += 1
        trials.append(Trial(
            number=index + 1, block=index // block_size + 1, repeat=repeats[name], condition=name,
            seconds=protocol.conditions[name].seconds,
            seed=derive_motion_seed(protocol, name, repeats[name]),
        ))  # fmt: skip
    return tuple(trials)


def find_source_trial(protocol: Protocol, order: tuple[Trial, ...], trial: Trial) -> Trial | None:
    """Return the trial whose motion a given trial repeats; None if it has its own motion.

    It is the latest trial before it of the condition that its motion names (`again`).
    """
    source = protocol.conditions[trial.condition].motion.again
    earlier = reversed(order[: trial.number - 1])
    return next((candidate for candidate in earlier if candidate.condition == source), None)


def fill_trigger_text(trigger: Trigger, trial: Trial) -> str:
    """Return the text that a trigger sends, with a trial's facts in place of {trial} and others."""
    return trigger.text.format(
        trial=trial.number, condition=trial.condition, block=trial.block, repeat=trial.repeat,
        at=trigger.at,
    )  # fmt: skip


def _random_below(generator: PCG64, limit: int) -> int:
    """Return a random whole number 0 … limit − 1, the same in every version of NumPy."""
    # Draw again above the largest multiple of `limit`, so that all remainders are equally likely.
    while (drawn := int(generator.random_raw())) >= _RAW_VALUES - _RAW_VALUES % limit:
        pass
    return drawn % limit


def _find_predecessors(
    protocol: Protocol, repeats: int
) -> dict[ConditionRepeat, ConditionRepeat | None]:
    """Return for every trial the trial that must come before it; None if it waits for none.

    repeats: how often each condition is shown. A first trial that repeats another condition's
    motion comes after that condition's first; other trials after their condition's previous one.
    """
    predecessors: dict[ConditionRepeat, ConditionRepeat | None] = {}
    for name, condition in protocol.conditions.items():
        source = condition.motion.again
        predecessors[ConditionRepeat(name, 0)] = ConditionRepeat(source, 0) if source else None
        for repeat in range(1, repeats):
            predecessors[ConditionRepeat(name, repeat)] = ConditionRepeat(name, repeat - 1)
    return predecessors


def _random_order(
    predecessors: dict[ConditionRepeat, ConditionRepeat | None], generator: PCG64
) -> list[ConditionRepeat]:
    """Return the trials in random order, each after its predecessor.

    All such orders are equally likely. predecessors: for every trial, the one that comes before it.
    """
    # The trials that wait for each trial, and how many there are in its subtree (itself included).
    children: dict[ConditionRepeat | None, list[ConditionRepeat]] = {}
    for trial, predecessor in predecessors.items():
        children.setdefault(predecessor, []).append(trial)
    parents_first = list(children.get(None, []))
    for trial in parents_first:  # the list grows while it is read
        parents_first += children.get(trial, [])
    tree_sizes: dict[ConditionRepeat, int] = {}
    for trial in reversed(parents_first):
        tree_sizes[trial] = 1 + sum(tree_sizes[child] for child in children.get(trial, []))
    # Draw the next trial with a probability in proportion to the size of its subtree (Knuth).
    candidates, order = list(children.get(None, [])), list[ConditionRepeat]()
    while candidates:
        sums = list(accumulate(tree_sizes[trial] for trial in candidates))
        index = bisect_right(sums, _random_below(generator, sums[-1]))
        order.append(candidates.pop(index))
        candidates += children.get(order[-1], [])
    return order


def _shuffle_blocks(protocol: Protocol, generator: PCG64) -> Iterator[str]:
    """Yield the conditions' names in blocks, each condition once a block, in random order.

    In the first block a condition that repeats another's motion comes after it. A block does not
    begin with the condition that ended the block before, unless there is only one condition.
    """
    predecessors = _find_predecessors(protocol, repeats=1)
    block = [trial.condition for trial in _random_order(predecessors, generator)]
    yield from block
    for _ in range(protocol.repeats - 1):
        remaining, last = list(protocol.conditions), block[-1]
        first_choices = [name for name in remaining if name != last] or remaining
        block = [first_choices[_random_below(generator, len(first_choices))]]
        remaining.remove(block[0])
        while remaining:
            block.append(remaining.pop(_random_below(generator, len(remaining))))
        yield from block
