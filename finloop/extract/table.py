"""The table of tracks (its schema), and facts about the tank and its fish."""

from dataclasses import dataclass

from finloop.base.schema import Column, Schema, columns

OUTLINE_POINTS = 128
GIVEN_NAME = "given.parquet"  # exists only where tracks are from a file


@dataclass(frozen=True)
class SceneFacts:
    """Facts about the tank and its fish that later stages use.

    points: the number of points of a backbone. fins: which pixels beyond silhouettes, paler than
    these, the cut-outs show; thin: whether thin parts that are paler belong to silhouettes; limbs:
    whether animals have limbs, which are no part of their backbones.
    Contrast, noise and threshold in grey levels of the difference image.
    """

    polarity: str
    noise_grey: float
    threshold_grey: float
    typical_area_px: float
    typical_length_px: float
    typical_contrast_grey: float
    fins: str
    points: int
    thin: bool = False
    typical_edge_px: float = 0.0
    limbs: bool = False


GIVEN = Schema(
    *columns("int32", "1", "track_id", "frame"),
    Column("animal", "string", "1"),
    *columns("float32", "px", "head_x_px", "head_y_px", "tail_x_px", "tail_y_px", nullable=True),
)
"""What a file of tracks says of every row of the table of tracks: which animal it is, and where its
head and tail are, if it says so."""


def tracks_schema(points: int) -> Schema:
    """Return the schema of the table of tracks: a row per fish per frame.

    points: the number of points of a backbone.
    """
    return Schema(
        *columns("int32", "1", "track_id", "frame"),
        *columns("float64", "px", "x_px", "y_px"),
        Column("area_px", "float32", "px²"),
        Column("contrast", "float32", "grey level"),
        Column("length_px", "float32", "px"),
        *columns("float32", "px", "backbone_x_px", "backbone_y_px", length=points),
        *columns("float32", "px", "half_width_px", length=points),
        *columns("float32", "px", "outline_x_px", "outline_y_px", length=OUTLINE_POINTS),
    )
