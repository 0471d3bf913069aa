"""Judge the heads and headings of the animals, and the frames in a tail beat."""

from collections.abc import Iterator, Mapping
from math import isnan, nan

from finloop.base.finding import Finding

# Values from which something is a fault.
FEW_AHEAD_PCT = 50.0  # of moving animals; of fewer, heads and tails may be exchanged
# Measured: zebrafish 1.6, mouse 0.8, carp, trout, sunfish, flies 0; a dog and a person from the
# side 9.8, a drawn insect with legs so thick that backbones run into them 10 to 66.
JUMPS_PCT = 5.0
FEW_FRAMES = 5.0  # frames of a beat; no rhythm is found in fewer


def list_findings(metrics: Mapping[str, float]) -> Iterator[Finding]:
    """Yield findings, good or doubtful, on heads, headings and frames in a tail beat.

    metrics: of the stage `features`, by name; NaN where nothing is known, and so no finding.
    """
    ahead_pct = metrics.get("headed_along_travel_pct", nan)
    if not isnan(ahead_pct):
        yield Finding(
            "head", ahead_pct >= FEW_AHEAD_PCT,
            f"{ahead_pct:.0f} % of the moving animals go where the head points.",
            "Heads may be tails: say which end is the head (features.head).",
        )  # fmt: skip
    jumps_pct = metrics["heading_jumps_pct"]
    if not isnan(jumps_pct):
        yield Finding(
            "heading", jumps_pct < JUMPS_PCT,
            f"The heading turns by more than 45° in {jumps_pct:.1f} % of the steps from frame to "
            "frame.",
            "Film one kind of animal from above, nearer or at a higher rate: backbones may run "
            "into limbs or other things.",
        )  # fmt: skip
    frames = metrics["frames_per_beat"]
    if not isnan(frames):
        yield Finding(
            "rate", frames >= FEW_FRAMES,
            f"From frame to frame the body bends as with {frames:.3g} frames in a beat.",
            "Film at a higher rate: 8 frames or more in a tail beat; sharper and nearer.",
        )  # fmt: skip
