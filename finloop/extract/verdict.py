"""The verdict on the animals of a film: whether they are large, sharp and clear of the border."""

from collections.abc import Iterator, Mapping

from finloop.base.finding import Finding

# Values from which something is a fault.
SHORT_PX = 35.0  # body length; of 40 px, headings of a drawn carp are off by 1.4°, of 60 by 0.8°
EDGE_PCT = 8.0  # of the body length; sharp films have 1 to 6, small animals more
BORDER_PCT = 10.0


def list_findings(metrics: Mapping[str, float]) -> Iterator[Finding]:
    """Yield the findings on the size, the outlines and the place of the animals.

    metrics: of the stage `extract`, by name.
    """
    length_px, edge_px = metrics["typical_length_px"], metrics["typical_edge_px"]
    is_long = length_px >= SHORT_PX
    yield Finding(
        "size", is_long, f"A typical animal is {length_px:.0f} px long.",
        f"Film nearer, or with more pixels: {SHORT_PX:.0f} px are the least, 60 to 150 are good.",
    )  # fmt: skip
    if is_long:  # of a small animal every outline is wide
        share_pct = 100 * edge_px / length_px
        yield Finding(
            "sharpness", share_pct < EDGE_PCT,
            f"Its outline is {edge_px:.1f} px wide, {share_pct:.1f} % of its length.",
            "Focus by hand; a shutter of 1/250 s or shorter, with more light.",
        )  # fmt: skip
    at_border, isolated = metrics["silhouettes_at_border"], metrics["silhouettes_fish"]
    share_pct = 100 * at_border / max(1, at_border + isolated)
    yield Finding(
        "border", share_pct < BORDER_PCT,
        f"{share_pct:.0f} % of the silhouettes are cut off by the edge of the picture or arena.",
        "Film from farther away, so that the whole tank is seen; or give a larger clip.arena.",
    )  # fmt: skip
