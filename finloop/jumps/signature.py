"""The signature of a row: the vector by which jumps are compared, also for its mirror image."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import svds

from finloop.base.arrays import Floats, Ints, Mask, Reals
from finloop.base.axes import to_body_axes
from finloop.base.parallel import Workers, ordered_map
from finloop.base.stretches import spread_rows
from finloop.distance.reel import Reel
from finloop.features.current import through_water
from finloop.features.table import delta_of
from finloop.jumps.settings import JumpsSettings
from finloop.jumps.source import RowSource
from finloop.puppet import Pose, draw

_SPAN = 1.25  # lengths of a straight fish across a picture
_LOT = 1000  # pictures at a time
_SAMPLE = 600  # most pictures to which the principal components are fitted


class SignatureParts(NamedTuple):
    """The parts by which rows are compared, each (2, n, k): of rows [0], of mirror images [1].

    pose: codes of principal shapes; change: of these codes, per frame; motion: speeds ahead and to
    the left, body lengths a frame, and turning, ° a frame, anticlockwise; look: principal
    components of the pictures drawn straight.
    """

    pose: Floats
    change: Floats
    motion: Floats
    look: Floats


@dataclass(frozen=True)
class StraightPictures:
    """Draws rows in one straight posture, headed right: pictures differ in light and skin only.

    The posture is the film's mean posture, which is its own mirror image. size: px across a
    picture.
    """

    source: RowSource
    size: int

    def __call__(self, rows: NDArray[np.intp]) -> NDArray[np.float32]:
        """Draw pictures (k, size, size, c) of rows (k,), premultiplied, 0 … 1.

        Turned upside down they are the mirror images.
        """
        reel, poses = self.source.film()
        middle = (self.size - 1) / 2
        place = (np.array(number) for number in (middle, middle, 0.0, self.size / _SPAN))
        target, size = Pose(*place, poses.shapes.mean), (self.size, self.size)
        return np.stack([
            draw(reel.film[int(row)], poses.pose[row], target, size, sharp=False) for row in rows
        ])  # fmt: skip


def _components(straight: StraightPictures, n: int, count: int, workers: Workers) -> Floats:
    """Return principal components (2, n, count) of straight pictures and their mirror images."""
    sample = straight(spread_rows(np.arange(n), _SAMPLE))
    both = np.concatenate([sample, sample[:, ::-1]]).reshape(2 * len(sample), -1)
    mean = both.mean(0)
    count = min(count, min(both.shape) - 1)
    axes = svds((both - mean).astype(float), count, random_state=0)[2][::-1].T
    lots = ordered_map(partial(_along, straight, mean, axes), blocks(n, _LOT), workers)
    return np.concatenate(list(lots), axis=1).astype(float)


def _along(straight: StraightPictures, mean: Reals, axes: Floats, rows: Ints) -> Floats:
    """Project straight pictures of rows (k,) and their mirror images on axes, (2, k, count)."""
    lot = straight(rows)
    sides = (lot, lot[:, ::-1])
    return np.stack([(side.reshape(len(lot), -1) - mean) @ axes for side in sides])


def blocks(n: int, most: int) -> list[Ints]:
    """Split the row numbers 0 … n − 1 into blocks of at most `most` successive rows."""
    return np.split(np.arange(n), range(most, n, most))


def signature_parts(source: RowSource, settings: JumpsSettings, workers: Workers) -> SignatureParts:
    """Compute the signature parts pose, change, motion, look of all rows and mirror images."""
    reel, poses = source.film()
    span = max(1, round(delta_of(reel.features) / 4))
    pose = np.stack([poses.codes, poses.codes @ poses.shapes.mirror])
    change = np.stack([change_per_row(codes, reel.goes_on, span) for codes in pose])
    straight = StraightPictures(source, settings.look_px)
    look = _components(straight, len(reel), settings.look_numbers, workers)
    return SignatureParts(pose, change, film_motion(reel, span), look)


def signatures(
    row_parts: SignatureParts, ends: tuple[Ints, Ints], settings: JumpsSettings
) -> Floats:
    """Return the signatures (2, n, d), in natural steps, of rows [0] and mirror images [1].

    A signature has all parts side by side, each standardized and times its weight in `settings`.
    ends: rows (k,), and rows (k,) a step later; their median distance is the natural step.
    """
    weights = (
        settings.pose_weight, settings.change, settings.motion_weight, settings.appearance_weight,
    )  # fmt: skip
    sides = [standardize(part, name == "motion") * weight for (name, part), weight in
             zip(row_parts._asdict().items(), weights, strict=True)]  # fmt: skip
    values = np.concatenate(sides, axis=-1)
    step = np.median(np.linalg.norm(values[0, ends[1]] - values[0, ends[0]], axis=-1))
    return values / max(float(step), 1e-12)


def standardize(part: Floats, each: bool = False) -> Floats:
    """Return a part (2, n, k) about its mean, scaled: the variances of its k numbers sum to 1.

    each: whether all k numbers get the same variance; else one factor scales them all.
    """
    return (part - part.mean((0, 1))) / deviation(part, each)


def deviation(part: Floats, each: bool = False) -> Floats:
    """Return the divisors (k,) that `standardize` applies to the k numbers of a part (2, n, k).

    Without `each` it is the root of the summed variances; with it a number's deviation times √k.
    """
    square = ((part - part.mean((0, 1))) ** 2).mean((0, 1))
    total = square * len(square) if each else np.full_like(square, square.sum())
    return np.sqrt(np.maximum(total, 1e-24))


def change_per_row(values: Floats, goes_on: Mask, span: int) -> Floats:
    """Return the change (n, k) per row of values (n, k), from `span` rows before to `span` after.

    goes_on (n,): whether the next row is of the same track. Near a track's end the span is shorter,
    on one side only at the end itself.
    """
    last = np.flatnonzero(~goes_on)
    rows = np.arange(len(values))
    end = last[np.searchsorted(last, rows)]
    begin = np.concatenate([[0], last[:-1] + 1])[np.searchsorted(last, rows)]
    a, b = np.maximum(rows - span, begin), np.minimum(rows + span, end)
    return (values[b] - values[a]) / np.maximum(b - a, 1)[:, None]


def film_motion(reel: Reel, span: int) -> Floats:
    """Return the speeds (2, n, 3) of rows [0] and mirror images [1]: ahead, left, turning.

    Body lengths a frame through the water, and ° a frame, anticlockwise; averaged over ± span rows.
    """
    features = reel.features
    place = through_water(features) / reel.lengths_px[:, None]
    speed = motion(place, features["heading_deg"].to_numpy(float), reel.goes_on, span)
    return np.stack([speed, speed * (1, -1, -1)])


def motion(place: Floats, heading_deg: Floats, goes_on: Mask, span: int) -> Floats:
    """Return the speeds (n, 3): ahead and to the left [body lengths a row], turning [° a row].

    place (n, 2): x, y in body lengths; heading_deg (n,): anticlockwise; goes_on, span: see
    `change_per_row`.
    """
    unwrapped = np.concatenate([
        np.unwrap(track, period=360)
        for track in np.split(heading_deg, np.flatnonzero(~goes_on)[:-1] + 1)
    ])  # fmt: skip
    velocity = change_per_row(np.column_stack([place, unwrapped]), goes_on, span)
    return np.column_stack([to_body_axes(velocity[:, :2], np.radians(heading_deg)), velocity[:, 2]])
