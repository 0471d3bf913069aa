"""Rows from which a fish that swims as is foretold need never stop.

A graph of rows: a fish at row r goes on with row r + 1, or goes over to a similar row s and shows
s + 1. Of a film of hours it has some ten million edges, so that they are read where they lie.
"""

import numpy as np

from finloop.base.arrays import Ints, Mask
from finloop.base.kernel import kernel, leaf_kernel
from finloop.forecast.sampling import Sampler, Similar


def endless(sampler: Sampler, more: Mask, rests: Mask) -> Sampler:
    """A sampler of those rows of `animate.Film` from which a fish can swim for ever.

    more: which of them the film goes on from; rests: at which of the film's own it rests. Without
    the film's mirror images, where it has none, and without rows that must not be shown. Of the
    rest: the largest set of rows that lead to each other, and all that lead there; not those that
    only lead to an end of the film, or round and round in a few frames. So the last row of a
    stretch, which cannot be followed, has neighbours.
    """
    n, m = len(more), len(sampler.usable)
    shown = np.zeros(m + 1, bool)
    shown[:n] = sampler.usable[:n] & more[:m]
    part = parts(shown, sampler.start, sampler.to)
    order = np.argsort(part, kind="stable")
    leads = np.append(leading(shown, sampler.start, sampler.to, (part, order)), False) & shown
    usable = leads[:-1] & leads[1:]
    start, to = kept(leads, usable, sampler.start, sampler.to)
    still = np.resize(rests, m)  # those of mirror images follow
    return sampler._replace(usable=usable, start=start, to=to, rests=still)


def kept(leads: Mask, usable: Mask, start: Ints, to: Similar) -> tuple[Ints, Similar]:
    """The graph of the edges from rows that lead on, `leads`, to usable rows."""
    count = np.zeros(len(start), np.int64)
    _kept(leads, usable, (start, to), count[1:], to[:0])
    count = np.cumsum(count)
    made = np.empty(count[-1], to.dtype)
    _kept(leads, usable, (start, to), np.empty(len(usable), np.int64), made)
    return count, made


@kernel
def _kept(leads, usable, graph, count, made):  # type: ignore[no-untyped-def]
    """The edges that are kept: how many of each row into `count`, their ends into `made`.

    As far as `made` has room.
    """
    start, to = graph
    many = 0
    for row in range(len(usable)):
        before = many
        if leads[row]:
            for e in range(start[row], start[row + 1]):
                if usable[to[e]]:
                    if many < len(made):
                        made[many] = to[e]
                    many += 1
        count[row] = many - before


@leaf_kernel
def _next(shown, row, edge, start, to):  # type: ignore[no-untyped-def]
    """Where an edge leads, −1 if it must not be taken; the one before `start` is to play on."""
    after = row + 1 if edge < start[row] else np.int64(to[edge]) + 1
    return after if shown[row] and shown[after - 1] and shown[after] else -1


@kernel
def parts(shown, start, to):  # type: ignore[no-untyped-def]
    """The number of the strongly connected part (m,) of every row (Tarjan 1972).

    A part has a higher number than those that it leads to.
    """
    m = len(start) - 1
    order, low, part = np.full(m, -1), np.zeros(m, np.int64), np.full(m, -1)
    edge, calls, stack = np.zeros(m, np.int64), np.empty(m, np.int64), np.empty(m, np.int64)
    visited = depth = waiting = count = 0
    for root in range(m):
        if order[root] >= 0:
            continue
        calls[0], depth = root, 1
        while depth > 0:
            row = calls[depth - 1]
            if order[row] < 0:
                order[row] = low[row] = visited
                edge[row] = start[row] - 1
                stack[waiting] = row
                visited, waiting = visited + 1, waiting + 1
            if edge[row] < start[row + 1]:
                after = _next(shown, row, edge[row], start, to)
                if after >= 0 and order[after] < 0:
                    calls[depth] = after
                    depth += 1
                    continue  # the edge is looked at again when all from there is known
                if after >= 0 and part[after] < 0:
                    low[row] = min(low[row], low[after])
                edge[row] += 1
                continue
            depth -= 1
            if low[row] == order[row]:
                while part[row] < 0:
                    waiting -= 1
                    part[stack[waiting]] = count
                count += 1
    return part


@kernel
def leading(shown, start, to, numbered):  # type: ignore[no-untyped-def]
    """Which rows (m,) lead to the largest part, its own rows too.

    numbered: the part of each row, and the rows in the order of their parts.
    """
    part, order = numbered
    m = len(part)
    size = np.zeros(m, np.int64)
    for row in range(m):
        size[part[row]] += 1
    leads = np.zeros(m, np.bool_)
    leads[size.argmax()] = True
    for row in order:
        for edge in range(start[row] - 1, start[row + 1]):
            if leads[part[row]]:
                break
            after = _next(shown, row, edge, start, to)
            leads[part[row]] = after >= 0 and leads[part[after]]
    return leads[part]
