"""The order of the trials: from the protocol's seed, and the same on any machine.

Every permitted order is equally likely. An order is permitted if each condition that repeats the
motion of another one comes after a trial of that one; in blocks, if each block holds every
condition once, and none comes twice in a row (where there is more than one).

No draw is rejected. The precedences form a forest: trials of one condition in their order, and the
first one of a yoked condition after the first of its source. A forest with n nodes has n! / ∏ s
orders, s: the sizes of all its subtrees (Knuth, TAOCP 3, 5.1.4, ex. 20). So the next trial is one
of those that wait for none, each with a probability in proportion to the size of its subtree.
"""

from collections.abc import Iterator
from typing import NamedTuple

from numpy.random import PCG64

from finloop.stimulus.protocol import Protocol, Trigger, derive_motion_seed

Node = tuple[str, int]
"""A condition, and the number of its repeat from 0."""
_WORD = 2**64


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
    names, bits = list(protocol.conditions), PCG64(protocol.seed)
    if protocol.order == "given":
        order = names * protocol.repeats
    elif protocol.order == "shuffled":
        order = [name for name, _ in _draw_order(_predecessors(protocol, protocol.repeats), bits)]
    else:
        order = list(_draw_blocks(protocol, bits))
    size = len(order) if protocol.order == "shuffled" else len(names)
    repeats, listed = dict.fromkeys(names, 0), []
    for number, name in enumerate(order):
        repeats[name] = repeat = repeats[name] + 1
        seconds, seed = (
            protocol.conditions[name].seconds,
            derive_motion_seed(protocol, name, repeat),
        )
        listed.append(Trial(number + 1, number // size + 1, repeat, name, seconds, seed))
    return tuple(listed)


def find_source_trial(protocol: Protocol, order: tuple[Trial, ...], trial: Trial) -> Trial | None:
    """Return the trial whose motion another trial repeats: the latest before it; None if none.

    order: all trials, none of them skipped.
    """
    again = protocol.conditions[trial.condition].motion.again
    before = reversed(order[: trial.number - 1])
    return next((one for one in before if one.condition == again), None)


def fill_trigger_text(trigger: Trigger, trial: Trial) -> str:
    """Return the text that a trigger sends, with facts of a trial in place of {trial} etc."""
    return trigger.text.format(
        trial=trial.number, condition=trial.condition, block=trial.block, repeat=trial.repeat,
        at=trigger.at,
    )  # fmt: skip


def _draw_below(bits: PCG64, most: int) -> int:
    """Draw one of 0 … most − 1, all equally likely; equal in every version of NumPy."""
    while (drawn := int(bits.random_raw())) >= _WORD - _WORD % most:
        pass
    return drawn % most


def _predecessors(protocol: Protocol, repeats: int) -> dict[Node, Node | None]:
    """Return for every trial the trial that must come before it, or None.

    repeats: of each condition.
    """
    before: dict[Node, Node | None] = {}
    for name, condition in protocol.conditions.items():
        again = condition.motion.again
        before[name, 0] = (again, 0) if again else None
        before |= {(name, repeat): (name, repeat - 1) for repeat in range(1, repeats)}
    return before


def _draw_order(before: dict[Node, Node | None], bits: PCG64) -> list[Node]:
    """Draw a random order of trials, each after its predecessor, if it has one.

    before: the predecessor of each trial, or None. All such orders are equally likely.
    """
    after: dict[Node | None, list[Node]] = {}
    for node, parent in before.items():
        after.setdefault(parent, []).append(node)
    down = list(after.get(None, []))
    for node in down:  # which grows: every node comes after its parent
        down += after.get(node, [])
    sizes: dict[Node, int] = {}
    for node in reversed(down):
        sizes[node] = 1 + sum(sizes[one] for one in after.get(node, []))
    free, order = list(after.get(None, [])), list[Node]()
    while free:
        at, chance = 0, _draw_below(bits, sum(sizes[node] for node in free))
        while chance >= sizes[free[at]]:
            chance -= sizes[free[at]]
            at += 1
        order.append(free.pop(at))
        free += after.get(order[-1], [])
    return order


def _draw_blocks(protocol: Protocol, bits: PCG64) -> Iterator[str]:
    """Yield the conditions' names block by block, in random order.

    In the first block a condition that repeats another's motion comes after it.
    """
    block = [name for name, _ in _draw_order(_predecessors(protocol, 1), bits)]
    yield from block
    for _ in range(protocol.repeats - 1):
        rest, last = list(protocol.conditions), block[-1]
        others = [name for name in rest if name != last] or rest
        block = [others[_draw_below(bits, len(others))]]
        rest.remove(block[0])
        while rest:
            block.append(rest.pop(_draw_below(bits, len(rest))))
        yield from block
