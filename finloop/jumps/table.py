"""The tables of jumps, and of how rows look."""

from finloop.base.schema import ANY, Column, Schema, columns

JUMPS = Schema(
    *columns("int32", "row", "row", "to"),
    Column("mirrored", "bool", "1"),
    Column("seam", "float32", "natural step"),
)
"""In place of `row` the film can show the row `to`, mirrored or not, and go on from there. `seam`
says how far the two are from each other, in median steps from row to row: the larger of how far
they are in what they are compared by, and of the square of how far to the eye, drawn in one pose. A
mirrored `row` can be replaced in the same way: then what is mirrored is not, and the other way
round."""

LOOK = Schema(Column("look", "float32", "1", length=ANY))
"""Light and skin of the n rows of a film, and then of their n mirror images; without these where
the fish is not to be mirrored. As in `signature.Parts`, together of the deviation 1."""
