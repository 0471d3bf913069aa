"""The clip stage's arithmetic: when a frame is shown, which way is up, where the arena is.

Nothing here opens a file. Frames are (h, w) grey or (h, w, 3) RGB; x runs right, y down, and
the centre of pixel (row 0, column 0) is the point (0, 0). Times are seconds.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TypeVar

import cv2
import numpy as np

from finloop.errors import FinloopError

T = TypeVar("T")

# A pause longer than this, or a clock that runs backwards, is a cut and not a slow frame: it
# starts a new segment instead of a fish that stands still.
CUT_S, CUT_FRAMES = 1.0, 5.0  # whichever is longer
CHROMA_LEVELS = 12.0  # a pixel this far from the film's own tint is coloured
CHROMA_FRACTION = 5e-4  # so many such pixels make a colour film: a goldfish is 3e-3 of 1 megapixel
PLAIN_LEVELS = 8  # a film with less between its darkest and brightest pixel shows nothing
DEEP_PERCENTILES = (0.01, 99.99)  # black and white of a deep film: hot pixels lie outside
KEPT_FRAMES = 32


def frame_rate_of(
    times_s: Sequence[float] | np.ndarray, candidates: Sequence[Fraction]
) -> Fraction:
    """Find the constant rate that a film's time stamps are nearest to.

    Each gap counts as the whole number of frames that it lasts at the median gap, so that
    dropped frames do not slow the rate down; cuts are left out. Of the rates the file states
    (`candidates`) the first is taken that stays within half a frame of this estimate over the whole
    film; stamps are often rounded to milliseconds, and 30000/1001 is a better answer then.

    Parameters
    ----------
    times_s
        When each frame is shown, at least two, ascending.
    candidates
        Rates that the file states.
    """
    gaps = np.diff(np.asarray(times_s, np.float64))
    gaps = gaps[(gaps > 0) & (gaps <= max(CUT_S, CUT_FRAMES * float(np.median(gaps))))]
    if not gaps.size:
        return next((rate for rate in candidates if rate > 0), Fraction(25))
    counts = np.rint(gaps / np.median(gaps))
    estimate = float(counts.sum() / gaps.sum())
    for rate in candidates:
        if rate > 0 and abs(float(rate) / estimate - 1) * counts.sum() < 0.5:
            return rate
    return Fraction(estimate).limit_denominator(1001)


@dataclass
class Timing:
    """What re-timing did; grows while the film runs. `cuts` are the frames that begin a segment."""

    frames: int = 0
    repeated: int = 0
    dropped: int = 0
    cuts: list[int] = field(default_factory=list)


def nearest_in_time(
    stamped: Iterable[tuple[float, T]], frame_rate: Fraction, timing: Timing
) -> Iterator[T]:
    """Give for every tick of a constant rate the item whose time is nearest.

    Ticks start with the first item and again after every cut; a film of constant rate comes
    through item by item, whatever the jitter of its stamps below half a frame.

    Parameters
    ----------
    stamped
        Pairs of time in seconds and item.
    frame_rate
        Of the output.
    timing
        Counts ticks, repeats, drops and cuts as they happen.
    """
    rate = float(frame_rate)
    held: tuple[float, T] | None = None
    start_s = 0.0  # time of tick 0 of this segment
    ticks = 0  # of this segment

    def shown(until: float) -> Iterator[T]:
        """Give the held item for each tick before `until` (in ticks of this segment)."""
        nonlocal ticks
        assert held is not None
        times = max(0, int(np.ceil(until)) - ticks)
        ticks += times
        timing.frames += times
        timing.repeated += max(0, times - 1)
        timing.dropped += times == 0
        for _ in range(times):
            yield held[1]

    for time_s, item in stamped:
        if held is not None:
            if 0 <= time_s - held[0] <= max(CUT_S, CUT_FRAMES / rate):
                yield from shown(((held[0] + time_s) / 2 - start_s) * rate)
            else:
                yield from shown((held[0] - start_s) * rate + 0.5)
                held = None
        if held is None:
            timing.cuts.append(timing.frames)
            start_s, ticks = time_s, 0
        held = time_s, item
    if held is not None:
        yield from shown((held[0] - start_s) * rate + 0.5)


def segments_of(cuts: Sequence[int], frames: int) -> tuple[tuple[int, int], ...]:
    """Turn the frames that begin a segment into half-open ranges."""
    return tuple(zip(cuts, [*cuts[1:], frames], strict=True))


@dataclass(frozen=True)
class Turn:
    """One of the eight ways a picture can lie: (x′, y′) = (a x + c y, b x + d y)."""

    a: int = 1
    b: int = 0
    c: int = 0
    d: int = 1

    @property
    def rotation_deg(self) -> int:
        """Anticlockwise, after the mirror; 0, 90, 180 or 270."""
        return round(np.degrees(np.arctan2(self.c, self.d))) % 360

    @property
    def mirrored(self) -> bool:
        """Whether left and right are swapped before the rotation."""
        return self.a * self.d - self.b * self.c < 0

    def __call__(self, frame: np.ndarray) -> np.ndarray:
        """Lay a picture upright; no pixel is lost or changed."""
        if not self.a:
            return np.ascontiguousarray(frame.swapaxes(0, 1)[:: self.b, :: self.c])
        return np.ascontiguousarray(frame[:: self.d, :: self.a])


UPRIGHT = Turn()


def turn_of(matrix: Sequence[int] | np.ndarray) -> tuple[Turn, bool]:
    """Read a film's display matrix (nine numbers, row by row; x′ = a x + c y, y′ = b x + d y).

    Returns
    -------
    The nearest of the eight ways to lie, and whether it is that one exactly.
    """
    a, b, _, c, d = (float(value) for value in matrix[:5])
    upright = abs(a) + abs(d) >= abs(b) + abs(c)
    exact = max(abs(b), abs(c)) == 0 if upright else max(abs(a), abs(d)) == 0
    if upright:
        return Turn(a=_sign(a), d=_sign(d)), exact
    return Turn(a=0, b=_sign(b), c=_sign(c), d=0), exact


def _sign(value: float) -> int:
    return -1 if value < 0 else 1


def rectangle_arena(
    width: int, height: int, left_px: float, top_px: float, width_px: float, height_px: float
) -> np.ndarray:
    """Mask, (height, width) bool, of the pixels whose centres lie in a rectangle.

    The left and top edges belong to it, the right and bottom ones do not: 10 px wide from 0
    is the columns 0 … 9.

    Raises
    ------
    FinloopError
        If no pixel of the picture lies in it.
    """
    x, y = np.arange(width), np.arange(height)[:, None]
    mask = (x >= left_px) & (x < left_px + width_px) & (y >= top_px) & (y < top_px + height_px)
    what = (
        f"rectangle of {width_px:g}×{height_px:g} px with its corner at ({left_px:g}, {top_px:g})"
    )
    return _not_empty(mask, what)


def circle_arena(width: int, height: int, x_px: float, y_px: float, radius_px: float) -> np.ndarray:
    """Mask, (height, width) bool, of the pixels whose centres lie in or on a circle.

    Raises
    ------
    FinloopError
        If no pixel of the picture lies in it.
    """
    x, y = np.arange(width), np.arange(height)[:, None]
    mask = (x - x_px) ** 2 + (y - y_px) ** 2 <= radius_px**2
    return _not_empty(mask, f"circle of radius {radius_px:g} px about ({x_px:g}, {y_px:g})")


def _not_empty(mask: np.ndarray, what: str) -> np.ndarray:
    if not mask.any():
        height, width = mask.shape
        raise FinloopError(
            came=f"the arena lies outside the picture: a {what}",
            wanted=f"an arena that covers part of the picture, x 0 … {width - 1}, "
            f"y 0 … {height - 1} (x right, y down, in the upright picture)",
            do="correct clip.arena",
        )
    return mask


def chroma_fraction(frames: Iterable[np.ndarray]) -> float:
    """Give the part of all pixels that differ clearly in colour from their frame's own tint.

    `frames` are RGB. An even tint, as of an infrared camera, is not colour.
    """
    parts = []
    for frame in frames:
        chroma = cv2.cvtColor(frame, cv2.COLOR_RGB2YCrCb)[..., 1:].astype(np.float32)
        chroma -= np.median(chroma, axis=(0, 1))
        parts.append(float((np.hypot(chroma[..., 0], chroma[..., 1]) > CHROMA_LEVELS).mean()))
    return float(np.mean(parts)) if parts else 0.0


def deep_levels(frames: Iterable[np.ndarray]) -> tuple[float, float]:
    """Find the levels of a deep film (over 8 bits) that are to become 0 and 255.

    Robust percentiles over all pixels of the sampled `frames`: cameras rarely fill their 16 bits,
    and a few hot pixels must not decide.
    """
    lows, highs = zip(*(np.percentile(f, DEEP_PERCENTILES) for f in frames), strict=True)
    low, high = float(min(lows)), float(max(highs))
    return low, max(high, low + 1)


def stretched(frame: np.ndarray, low: float, high: float) -> np.ndarray:
    """Map `low` … `high` to 0 … 255, rounded; what lies outside becomes 0 or 255."""
    scaled = (frame.astype(np.float32) - low) * (255 / (high - low))
    return np.clip(np.rint(scaled), 0, 255).astype(np.uint8)


# Y of the limited ("studio") range: 16 is black and 235 white (BT.601).
FULL_FROM_LIMITED = np.clip(np.rint((np.arange(256) - 16) * (255 / 219)), 0, 255).astype(np.uint8)


@dataclass
class Tally:
    """Light and samples of a clip, gathered frame by frame in bounded memory."""

    frames: int = 0
    brightness_sum: float = 0.0
    darkest: int = 255
    brightest: int = 0
    kept: dict[int, np.ndarray] = field(default_factory=dict)
    _stride: int = 1

    def add(self, frame: np.ndarray) -> None:
        """Take one frame into account; at most `KEPT_FRAMES` spread-out copies are kept."""
        self.brightness_sum += float(np.mean(cv2.mean(frame)[: 3 if frame.ndim == 3 else 1]))
        low, high, *_ = cv2.minMaxLoc(frame.reshape(frame.shape[0], -1))
        self.darkest, self.brightest = min(self.darkest, int(low)), max(self.brightest, int(high))
        if self.frames % self._stride == 0:
            self.kept[self.frames] = frame.copy()
            if len(self.kept) > KEPT_FRAMES:
                self._stride *= 2
                self.kept = {i: kept for i, kept in self.kept.items() if i % self._stride == 0}
        self.frames += 1

    @property
    def brightness_mean(self) -> float:
        """Mean grey level of all pixels of all frames, 0 … 255."""
        return self.brightness_sum / max(self.frames, 1)

    @property
    def plain(self) -> bool:
        """Whether nothing is to be seen: all pixels of all frames are of about one level."""
        return self.brightest - self.darkest < PLAIN_LEVELS


def psnr_db(pairs: Iterable[tuple[np.ndarray, np.ndarray]]) -> float:
    """Peak signal-to-noise ratio over all pairs, 10 log₁₀(255² / mean squared difference).

    Infinite where nothing differs.
    """
    squares = pixels = 0.0
    for a, b in pairs:
        squares += float(np.square(cv2.absdiff(a, b).astype(np.float32)).sum(dtype=np.float64))
        pixels += a.size
    return 10 * np.log10(255**2 * pixels / squares) if squares else float("inf")
