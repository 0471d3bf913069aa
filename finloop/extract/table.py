"""The schema of the table of tracks, and facts about the tank and its fish."""

from dataclasses import dataclass

from finloop.base.schema import Column, Schema

OUTLINE_POINTS = 128


@dataclass(frozen=True)
class SceneFacts:
    """Facts about the tank and its fish, for later stages.

    points: of a backbone. Contrast, noise and threshold in grey levels of the difference image.
    """

    polarity: str
    noise_grey: float
    threshold_grey: float
    typical_area_px: float
    typical_length_px: float
    typical_contrast_grey: float
    points: int


def tracks_schema(points: int) -> Schema:
    """The table of tracks: a row per fish per frame, beside the cut-out of the same number."""

    def line(name: str) -> Column:
        return Column(name, "float32", "px", length=points)

    def ring(name: str) -> Column:
        return Column(name, "float32", "px", length=OUTLINE_POINTS)

    return Schema(
        (
            Column("track_id", "int32", "1"),
            Column("frame", "int32", "1"),
            Column("x_px", "float64", "px"),
            Column("y_px", "float64", "px"),
            Column("area_px", "float32", "px²"),
            Column("contrast", "float32", "grey level"),
            Column("length_px", "float32", "px"),
            line("backbone_x_px"),
            line("backbone_y_px"),
            line("half_width_px"),
            ring("outline_x_px"),
            ring("outline_y_px"),
        )
    )
