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
INTERLACED = 0.15  # of `fields.field_order`; film of whole pictures stays below 0.02
CONTRAST_NOISES = 8.0  # with less, the outline follows the noise
LOST_PCT = 10.0  # share of the animals' pixels that are black or white


class Finding(NamedTuple):
    """One finding about a film: whether it is good, what was measured, and what to do.

    word: what it is about, such as `flicker`; text, do: sentences; `do` is empty where all is good.
    """

    word: str
    good: bool
    text: str
    do: str

    @property
    def line(self) -> str:
        """Return the finding as a line for a terminal."""
        return f"{'the film' if self.good else 'THE FILM'}: {self.text} {self.do}".rstrip()

    @property
    def row(self) -> dict[str, str]:
        """Return the finding as a row of a table for people."""
        good = "good" if self.good else "better otherwise"
        return {"what": self.word, "verdict": good, "measured": self.text, "what to do": self.do}


REPAIRS = {
    "deinterlace": (("interlaced",), "The later rows were filled in from their neighbours."),
    "undouble": (("doubled",), "The repeats were left out, and the rest keeps its time."),
    "even_light": (("flicker", "drift"), "Every frame was brought to one light."),
    "steady": (("shake",), "Every frame was moved back."),
}
"""By the repair (`finloop.clip.mend`): the words of the findings, and what was done."""


def findings(
    quality: Quality, filmed: Quality | None = None, mended: Collection[str] = ()
) -> list[Finding]:
    """Return the findings on light, camera, pictures, exposure and contrast of a clip.

    quality: of the clip; filmed: of the film before its repair; mended: the names of the repairs.
    The finding on a repaired fault also says what was measured before.
    """
    remedies = {
        word: text for name in mended for word in REPAIRS[name][0] for text in REPAIRS[name][1:]
    }
    before = {now.word: now for now in _all(filmed)} if filmed and remedies else {}
    return [
        Finding(
            now.word,
            now.good,
            f"{before[now.word].text} {remedies[now.word]} {now.text}",
            now.do,
        )
        if now.word in remedies and not before[now.word].good
        else now
        for now in _all(quality)
    ]


def _all(q: Quality) -> list[Finding]:
    return [*_light(q), _shake(q), _repeats(q), _interlacing(q), *_exposure(q), _contrast(q)]


def _short(value: float) -> str:
    """Format with two digits, or with all digits before the point."""
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def _light(q: Quality) -> Iterator[Finding]:
    hertz = "irregularly" if isnan(q.light_flicker_hz) else f"at {q.light_flicker_hz:.3g} Hz"
    steady = q.light_flicker_pct < FLICKER_PCT
    yield Finding(
        "flicker", steady,
        f"The light flickers by {_short(q.light_flicker_pct)} %" + (", less than is seen."
        if steady else f" {hertz}."),
        "" if steady else "Use lamps on direct current, set exposure and gain by hand, or a "
        "shutter of 1/50 s or 1/100 s (60 Hz mains: 1/60 s, 1/120 s).",
    )  # fmt: skip
    even = q.light_drift_pct < DRIFT_PCT
    yield Finding(
        "drift", even,
        f"Its brightness drifts by {_short(q.light_drift_pct)} %.",
        "" if even else "Set exposure, gain and white balance by hand, keep daylight out, or "
        "leave out the part (clip.start_s, clip.end_s).",
    )  # fmt: skip


def _shake(q: Quality) -> Finding:
    if isnan(q.shake_px):
        return Finding(
            "shake", True,
            "Whether the camera moves cannot be told: the floor has too few marks.",
            "",
        )  # fmt: skip
    still = q.shake_px < SHAKE_PX
    text = f"The camera stands still to {_short(q.shake_px)} px." if still else (
        f"The camera moves by {_short(q.shake_px)} px, at most {_short(q.shake_most_px)} px."
    )  # fmt: skip
    do = (
        ""
        if still
        else "Fix the camera to a stand that touches neither tank nor pump, with its "
        "stabiliser off."
    )
    return Finding("shake", still, text, do)


def _repeats(q: Quality) -> Finding:
    good = not q.doubled_pct >= DOUBLED_PCT
    if good:
        text = "Every frame is a picture of its own."
    elif isnan(q.doubled_rate):
        text = f"{_short(q.doubled_pct)} % of the frames repeat the one before, irregularly."
    else:
        text = (
            f"{_short(q.doubled_pct)} % of the frames repeat the one before: the film was shot at "
            f"{q.doubled_rate:.3g} of its rate."
        )
    do = (
        ""
        if good
        else "Take the camera's own file, not a converted one; more light, so that "
        "it keeps its rate."
    )
    return Finding("doubled", good, text, do)


def _interlacing(q: Quality) -> Finding:
    good = not abs(q.field_order) >= INTERLACED
    which = "upper" if q.field_order > 0 else "lower"
    text = "Pictures are whole, not interlaced." if good else (
        f"The film is interlaced, the {which} rows half a frame before the others."
    )  # fmt: skip
    if isnan(q.field_order):
        text = "Too little moves to tell whether the film is interlaced."
    return Finding("interlaced", good, text, "" if good else "Film progressively (25p, 50p).")


def _exposure(q: Quality) -> Iterator[Finding]:
    for word, share, remedy in (
        ("black", q.animal_black_pct, "more light or a longer exposure"),
        ("white", q.animal_white_pct, "less light or a shorter exposure"),
    ):
        good = share < LOST_PCT
        if not good:
            yield Finding(
                word, good,
                f"{_short(share)} % of what moves is plain {word}: no skin is seen there.",
                f"Give it {remedy}.",
            )  # fmt: skip
    if max(q.animal_black_pct, q.animal_white_pct) < LOST_PCT:
        yield Finding("exposure", True, "What moves is neither plain black nor plain white.", "")


def _contrast(q: Quality) -> Finding:
    if isnan(q.contrast_grey):
        return Finding(
            "contrast", False, "Nothing differs from the still tank.",
            "Film animals that move, before a floor of another brightness.",
        )  # fmt: skip
    times = q.contrast_grey / max(q.noise_grey, 0.1)
    good = times >= CONTRAST_NOISES
    text = (
        f"What moves differs from the tank by {q.contrast_grey:.3g} grey levels, the noise is "
        f"{_short(q.noise_grey)}."
    )
    do = "" if good else "More light, less gain (ISO), a floor of another brightness."
    return Finding("contrast", good, text, do)
