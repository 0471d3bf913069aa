"""The tables of jumps, and of how rows look."""

from dataclasses import dataclass

from finloop.base.schema import ANY, Column, Schema, columns


@dataclass(frozen=True)
class VisibleFacts:
    """The unit `natural` of a `VisibleDistance`, stored beside its pictures and postures."""

    natural: float


JUMPS = Schema(
    *columns("int32", "row", "row", "to"),
    Column("mirrored", "bool", "1"),
    Column("seam", "float32", "natural step"),
)
"""Instead of `row` the film can show the row `to`, mirrored or not, and play on from there. `seam`
is the cost of the jump in natural steps: the sum of the distance of the two signatures and of the
square of the visible distance in one pose. A mirrored `row` has the same jumps, with `mirrored`
inverted."""

LOOK = Schema(Column("look", "float32", "1", length=ANY))
"""Light and skin of the n rows of a film, then of their n mirror images if the fish may be
mirrored. As in `signature.SignatureParts`, but together with the deviation 1."""
