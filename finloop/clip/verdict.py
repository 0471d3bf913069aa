"""The verdict on a film in plain sentences: its strong points, and what to film differently."""

from collections.abc import Collection, Iterator
from math import isnan
from typing import NamedTuple

from finloop.clip.check import Quality

# Values from which something is a fault.
FLICKER_PCT = 1.0  # root mean square; the eye sees less than one per cent at 10 Hz
DRIFT_PCT = 10.0  # one gain a frame corrects that without losing black and white
SHAKE_PX = 0.25  # root mean square; an edge of 40 grey levels then changes by ten
DOUBLED_PCT = 2.0
INTERLACED = 0.15  # of `check.field_order`; film of whole pictures stays below 0.02
CONTRAST_NOISES = 8.0  # with less, the outline follows the noise
LOST_PCT = 10.0  # share of the animals' pixels that are black or white


class Finding(NamedTuple):
    """One finding about a film: whether it is good, what was measured, and else what to do."""

    word: str  # what it is about, such as `flicker`
    good: bool
    text: str  # a sentence
    remedy: str = ""  # a sentence, said only where the film is not good

    @property
    def line(self) -> str:
        """Return the finding as a line for a terminal."""
        return f"the film: {self.text}" if self.good else f"THE FILM: {self.text} {self.remedy}"

    @property
    def row(self) -> dict[str, str]:
        """Return the finding as a row of a table for people."""
        verdict, do = ("good", "") if self.good else ("better otherwise", self.remedy)
        return {"what": self.word, "verdict": verdict, "measured": self.text, "what to do": do}


REPAIRS = {
    "deinterlace": (["interlaced"], "The later rows were filled in from their neighbours."),
    "undouble": (["doubled"], "The repeats were left out, and the rest keeps its time."),
    "even_light": (["flicker", "drift"], "Every frame was brought to one light."),
    "steady": (["shake"], "Every frame was moved back."),
}
"""By the repair (`finloop.clip.rewrite`): the words of the findings, and what was done."""


def findings(
    quality: Quality, filmed: Quality | None = None, mended: Collection[str] = ()
) -> list[Finding]:
    """Return the findings on light, camera, pictures, exposure and contrast of a clip.

    filmed: quality of the film before its repair; mended: the names of the repairs. The finding on
    a repaired fault also says what was measured before.
    """
    remedies = {word: REPAIRS[name][1] for name in mended for word in REPAIRS[name][0]}
    before = {finding.word: finding for finding in _judge(filmed)} if filmed and remedies else {}
    found = []
    for finding in _judge(quality):
        if finding.word in remedies and not before[finding.word].good:
            told = f"{before[finding.word].text} {remedies[finding.word]} {finding.text}"
            finding = finding._replace(text=told)
        found.append(finding)
    return found


def _judge(q: Quality) -> Iterator[Finding]:
    yield from _judge_light(q)
    yield _judge_shake(q)
    yield from _judge_pictures(q)
    yield from _judge_exposure(q)
    yield _judge_contrast(q)


def _short(value: float) -> str:
    """Format with two digits, or with all digits before the point."""
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _judge_light(q: Quality) -> Iterator[Finding]:
    flicker = f"The light flickers by {_short(q.light_flicker_pct)} %"
    if q.light_flicker_pct < FLICKER_PCT:
        yield Finding("flicker", True, f"{flicker}, less than is seen.")
    else:
        hertz = "irregularly" if isnan(q.light_flicker_hz) else f"at {q.light_flicker_hz:.3g} Hz"
        yield Finding(
            "flicker", False, f"{flicker} {hertz}.",
            "Use lamps on direct current, set exposure and gain by hand, or a shutter of 1/50 s or "
            "1/100 s (60 Hz mains: 1/60 s, 1/120 s).",
        )  # fmt: skip
    yield Finding(
        "drift", q.light_drift_pct < DRIFT_PCT,
        f"Its brightness drifts by {_short(q.light_drift_pct)} %.",
        "Set exposure, gain and white balance by hand, keep daylight out, or leave out the part "
        "(clip.start_s, clip.end_s).",
    )  # fmt: skip


def _judge_shake(q: Quality) -> Finding:
    if isnan(q.shake_px):
        text = "Whether the camera moves cannot be told: the floor has too few marks."
        return Finding("shake", True, text)
    if q.shake_px < SHAKE_PX:
        return Finding("shake", True, f"The camera stands still to {_short(q.shake_px)} px.")
    return Finding(
        "shake", False,
        f"The camera moves by {_short(q.shake_px)} px, at most {_short(q.shake_most_px)} px.",
        "Fix the camera to a stand that touches neither tank nor pump, with its stabiliser off.",
    )  # fmt: skip


def _judge_pictures(q: Quality) -> Iterator[Finding]:
    if not q.doubled_pct >= DOUBLED_PCT:
        yield Finding("doubled", True, "Every frame is a picture of its own.")
    else:
        text = f"{_short(q.doubled_pct)} % of the frames repeat the one before"
        rate = f"the film was shot at {q.doubled_rate:.3g} of its rate"
        yield Finding(
            "doubled", False,
            f"{text}, irregularly." if isnan(q.doubled_rate) else f"{text}: {rate}.",
            "Take the camera's own file, not a converted one; more light, so that it keeps its "
            "rate.",
        )  # fmt: skip
    if isnan(q.field_order):
        text = "Too little moves to tell whether the film is interlaced."
    elif abs(q.field_order) < INTERLACED:
        text = "Pictures are whole, not interlaced."
    else:
        rows = "upper" if q.field_order > 0 else "lower"
        text = f"The film is interlaced, the {rows} rows half a frame before the others."
    good = not abs(q.field_order) >= INTERLACED
    yield Finding("interlaced", good, text, "Film progressively (25p, 50p).")


def _judge_exposure(q: Quality) -> Iterator[Finding]:
    for word, share, remedy in (
        ("black", q.animal_black_pct, "more light or a longer exposure"),
        ("white", q.animal_white_pct, "less light or a shorter exposure"),
    ):
        if not share < LOST_PCT:
            text = f"{_short(share)} % of what moves is plain {word}: no skin is seen there."
            yield Finding(word, False, text, f"Give it {remedy}.")
    if max(q.animal_black_pct, q.animal_white_pct) < LOST_PCT:
        yield Finding("exposure", True, "What moves is neither plain black nor plain white.")


def _judge_contrast(q: Quality) -> Finding:
    if isnan(q.contrast_grey):
        do = "Film animals that move, before a floor of another brightness."
        return Finding("contrast", False, "Nothing differs from the still tank.", do)
    return Finding(
        "contrast", q.contrast_grey / max(q.noise_grey, 0.1) >= CONTRAST_NOISES,
        f"What moves differs from the tank by {q.contrast_grey:.3g} grey levels, the noise is "
        f"{_short(q.noise_grey)}.",
        "More light, less gain (ISO), a floor of another brightness.",
    )  # fmt: skip
