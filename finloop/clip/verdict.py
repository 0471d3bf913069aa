"""The verdict on a film in plain sentences: its strong points, and what to film differently."""

from collections.abc import Collection, Iterator
from math import isnan

from finloop.base.finding import Finding
from finloop.clip.check import Quality

# Values from which something is a fault.
FLICKER_PCT = 1.0  # root mean square; the eye sees less than one per cent at 10 Hz
DRIFT_PCT = 10.0  # one gain a frame corrects that without losing black and white
SHAKE_PX = 0.25  # root mean square; an edge of 40 grey levels then changes by ten
DOUBLED_PCT = 2.0
INTERLACED = 0.15  # of `check.measure_field_order`; film of whole pictures stays below 0.02
CONTRAST_NOISES = 8.0  # with less, the outline follows the noise
LOST_PCT = 10.0  # share of the animals' pixels that are black or white
QUANTISER = 40.0  # of H.264; above it backbones of a drawn carp are off by twice as much and more


REPAIRS = {
    "deinterlace": (["interlaced"], "The later rows were filled in from their neighbours."),
    "undouble": (["doubled"], "The repeats were left out, and the rest keeps its time."),
    "even_light": (["flicker", "drift"], "Every frame was brought to one light."),
    "steady": (["shake"], "Every frame was moved back."),
}
"""By the repair (`finloop.clip.rewrite`): the words of the findings, and what was done."""


_REFUSED = "A repair was tried, made the film no better, and was left out."


def list_findings(
    quality: Quality, filmed: Quality | None = None, mended: Collection[str] = (),
    refused: Collection[str] = (),
) -> list[Finding]:  # fmt: skip
    """Return the verdict on a clip: findings on light, camera, pictures, contrast and coding.

    filmed: quality of the film before its repair; mended: the names of the repairs; refused: those
    that made the film no better. The finding on a repaired fault also says what was measured
    before.
    """
    # Words of findings: those of refused repairs, and for the others a sentence on what was done.
    refused_words = {word for name in refused for word in REPAIRS[name][0]}
    remedies = {word: REPAIRS[name][1] for name in mended for word in REPAIRS[name][0]}
    before = (
        {finding.word: finding for finding in _judge_all(filmed)} if filmed and remedies else {}
    )
    findings = []
    for finding in _judge_all(quality):
        if finding.word in remedies and not before[finding.word].good:
            text = f"{before[finding.word].text} {remedies[finding.word]} {finding.text}"
            finding = finding._replace(text=text)
        if finding.word in refused_words and not finding.good:
            finding = finding._replace(text=f"{finding.text} {_REFUSED}")
        findings.append(finding)
    return findings


def judge_completeness(frames_missing: int) -> Finding:
    """Return the finding on the frames that a film promises but that cannot be read."""
    if not frames_missing:
        return Finding("missing", True, "All of its frames can be read.")
    return Finding(
        "missing", False,
        f"Frames that are missing or damaged: {frames_missing}. Tracks end there, or the film ends "
        "early.",
        "Copy the film again, or record it with a faster disk.",
    )  # fmt: skip


def _judge_all(quality: Quality) -> Iterator[Finding]:
    """Yield all findings on a film of this quality."""
    yield from _judge_light(quality)
    yield _judge_shake(quality)
    yield from _judge_pictures(quality)
    yield from _judge_exposure(quality)
    yield _judge_contrast(quality)
    if not isnan(quality.coding_quantiser):
        yield Finding(
            "coding", quality.coding_quantiser < QUANTISER,
            f"Its pictures are coded with a quantiser of {quality.coding_quantiser:.0f} "
            "(0 is without loss, 51 is worst).",
            "Take the camera's own file, not one from a messenger; set a higher bit rate.",
        )  # fmt: skip


def _format_number(value: float) -> str:
    """Format a number with two significant digits below 10, else as a whole number."""
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _judge_light(quality: Quality) -> Iterator[Finding]:
    """Yield the findings on the flicker and the drift of the light."""
    if isnan(quality.light_flicker_pct):
        text = "Whether the light changes cannot be told: the floor is plain black or white."
        yield Finding("flicker", True, text)
        return
    flicker = f"The light flickers by {_format_number(quality.light_flicker_pct)} %"
    if quality.light_flicker_pct < FLICKER_PCT:
        yield Finding("flicker", True, f"{flicker}, less than is seen.")
    else:
        is_irregular = isnan(quality.light_flicker_hz)
        rhythm = "irregularly" if is_irregular else f"at {quality.light_flicker_hz:.3g} Hz"
        yield Finding(
            "flicker", False, f"{flicker} {rhythm}.",
            "Use lamps on direct current, set exposure and gain by hand, or a shutter of 1/50 s or "
            "1/100 s (60 Hz mains: 1/60 s, 1/120 s).",
        )  # fmt: skip
    yield Finding(
        "drift", quality.light_drift_pct < DRIFT_PCT,
        f"Its brightness drifts by {_format_number(quality.light_drift_pct)} %.",
        "Set exposure, gain and white balance by hand, keep daylight out, or leave out the part "
        "(clip.start_s, clip.end_s).",
    )  # fmt: skip


def _judge_shake(quality: Quality) -> Finding:
    """Return the finding on the shake of the camera."""
    if isnan(quality.shake_px):
        text = "Whether the camera moves cannot be told: the floor has too few marks."
        return Finding("shake", True, text)
    if quality.shake_px < SHAKE_PX:
        return Finding(
            "shake", True, f"The camera stands still to {_format_number(quality.shake_px)} px."
        )
    return Finding(
        "shake", False,
        f"The camera moves by {_format_number(quality.shake_px)} px, "
        f"at most {_format_number(quality.shake_most_px)} px.",
        "Fix the camera to a stand that touches neither tank nor pump, with its stabiliser off.",
    )  # fmt: skip


def _judge_pictures(quality: Quality) -> Iterator[Finding]:
    """Yield the findings on doubled pictures and on interlaced fields."""
    if not quality.doubled_pct >= DOUBLED_PCT:
        yield Finding("doubled", True, "Every frame is a picture of its own.")
    else:
        text = f"{_format_number(quality.doubled_pct)} % of the frames repeat the one before"
        rate = f"the film was shot at {quality.doubled_rate:.3g} of its rate"
        yield Finding(
            "doubled", False,
            f"{text}, irregularly." if isnan(quality.doubled_rate) else f"{text}: {rate}.",
            "Take the camera's own file, not a converted one; more light, so that it keeps its "
            "rate.",
        )  # fmt: skip
    if isnan(quality.field_order):
        text = "Too little moves to tell whether the film is interlaced."
    elif abs(quality.field_order) < INTERLACED:
        text = "Pictures are whole, not interlaced."
    else:
        rows = "upper" if quality.field_order > 0 else "lower"
        text = f"The film is interlaced, the {rows} rows half a frame before the others."
    good = not abs(quality.field_order) >= INTERLACED  # NaN, unknown, is good
    yield Finding("interlaced", good, text, "Film progressively (25p, 50p).")


def _judge_exposure(quality: Quality) -> Iterator[Finding]:
    """Yield the findings on animals that are overexposed or underexposed."""
    for word, share, remedy in (
        ("black", quality.animal_black_pct, "more light or a longer exposure"),
        ("white", quality.animal_white_pct, "less light or a shorter exposure"),
    ):
        if not share < LOST_PCT:
            text = (
                f"{_format_number(share)} % of what moves is plain {word}: no skin is seen there."
            )
            yield Finding(word, False, text, f"Give it {remedy}.")
    if max(quality.animal_black_pct, quality.animal_white_pct) < LOST_PCT:
        yield Finding("exposure", True, "What moves is neither plain black nor plain white.")


def _judge_contrast(quality: Quality) -> Finding:
    """Return the finding on the contrast of the animals against the noise."""
    if isnan(quality.contrast_grey):
        do = "Film animals that move, before a floor of another brightness."
        return Finding("contrast", False, "Nothing differs from the empty tank.", do)
    return Finding(
        "contrast", quality.contrast_grey / max(quality.noise_grey, 0.1) >= CONTRAST_NOISES,
        f"What moves differs from the tank by {quality.contrast_grey:.3g} grey levels, the noise "
        f"is {_format_number(quality.noise_grey)}.",
        "More light, less gain (ISO), a floor of another brightness.",
    )  # fmt: skip
