"""The table of a drawn film's ground truth: a row per fish per frame.

Columns whose names do not explain them: `bend` is the signed area between the midline and its
chord per squared body length; `curvature_deg` the direction of the midline at the head minus that
at the tail, both + for a bend to the left; `mask_area_px` the drawn coverage, body and fins;
`backbone_*_px` the midline from head to tail in equal steps.
"""

from finloop.base.schema import Column, Schema, columns

POINTS = 65  # points of a true midline

TRUTH = Schema(
    *columns("int32", "1", "fish_id", "frame"),
    *columns("float64", "px", "x_px", "y_px", "head_x_px", "head_y_px"),
    *columns("float64", "px", "tail_x_px", "tail_y_px"),
    Column("heading_deg", "float64", "deg"),
    Column("body_length_px", "float64", "px"),
    Column("bend", "float64", "1"),
    Column("curvature_deg", "float64", "deg"),
    Column("swimming_type", "int8", "1"),
    Column("mask_area_px", "float64", "px²"),
    Column("fins_open", "float32", "1"),
    *columns("float32", "px", "backbone_x_px", "backbone_y_px", length=POINTS),
)
