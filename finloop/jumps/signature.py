"""The signature of a row: the vector by which jumps are compared, also for its mirror image.

And whether a fish may be mirrored: how much its two sides differ, in look and in motion.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import svds

from finloop.base.arrays import Floats, Ints, Mask, Reals
from finloop.base.axes import to_body_axes
from finloop.base.parallel import Workers, ordered_map
from finloop.base.stretches import spread_rows
from finloop.distance.picture import paired_distances
from finloop.distance.reel import Reel
from finloop.features.current import places_through_water
from finloop.features.table import infer_delta_frames
from finloop.jumps.settings import JumpsSettings
from finloop.pose.film import FilmPoses
from finloop.puppet import Pose, draw_in_pose

_WIDTH = 1.25  # of a picture, in lengths of a straight fish: some margin at both ends
_BATCH = 1000  # pictures at a time, to save memory
_SAMPLE = 600  # most pictures to which the principal components are fitted, to save time
_ROWS = 300  # most pictures that are compared with their mirror images, to save time

Pictures = NDArray[np.uint8]
DrawStraight = Callable[[NDArray[np.intp]], NDArray[np.float32]]
"""Rows (k,) → pictures (k, size, size, c) of the fish in one straight posture: `draw_straight`."""


class RowSource(Protocol):
    """Gives workers access to a film's rows, their postures, and an array for their pictures.

    Each block of rows calls it again. A cluster pickles it, once for all blocks.
    """

    def load_film(self) -> tuple[Reel, FilmPoses]:
        """Return the film's rows and, in the same order, their postures."""

    def picture_array(self) -> Pictures:
        """Return the array, uint8 (n, s, s, c), that holds a picture of each row."""

    def share_pictures(self) -> None:
        """Make the pictures available to other processes, once all are drawn."""


def picture_array_shape(reel: Reel, size_px: int) -> tuple[int, ...]:
    """Return the shape (n, size_px, size_px, c) of the array of all rows' pictures."""
    return len(reel), size_px, size_px, reel.cutouts[0].pixels.shape[2]


@dataclass(frozen=True)
class InMemorySource:
    """A film (reel, poses) and its pictures (drawn) in memory, for workers of this process."""

    reel: Reel
    poses: FilmPoses
    drawn: Pictures

    @classmethod
    def from_reel(cls, reel: Reel, poses: FilmPoses, size_px: int) -> "InMemorySource":
        """Return the source of a film, with an empty array for pictures `size_px` px across."""
        return cls(reel, poses, np.empty(picture_array_shape(reel, size_px), np.uint8))

    def load_film(self) -> tuple[Reel, FilmPoses]:
        """Return the film's rows and, in the same order, their postures."""
        return self.reel, self.poses

    def picture_array(self) -> Pictures:
        """Return the array, uint8 (n, s, s, c), in which the rows' pictures are drawn."""
        return self.drawn

    def share_pictures(self) -> None:
        """Do nothing: the pictures are in memory."""


class SignatureParts(NamedTuple):
    """The numbers by which rows are compared, each (2, n, k): of rows [0], of mirror images [1].

    pose: codes of principal shapes; change: change of these codes per frame; motion: speeds ahead
    and to the left, body lengths a frame, and turning, ° a frame, anticlockwise; look: principal
    components of the pictures drawn with a straight body.
    """

    pose: Floats
    change: Floats
    motion: Floats
    look: Floats


def draw_straight(source: RowSource, size_px: int, rows: NDArray[np.intp]) -> NDArray[np.float32]:
    """Return pictures of the fish of rows (k,), all with one straight body and headed right.

    So only light and skin differ. The pictures (k, size_px, size_px, c) are premultiplied, 0 … 1.
    The body has the film's mean posture; upside down, a picture shows its mirror image.
    """
    reel, poses = source.load_film()
    middle = (size_px - 1) / 2
    x, y, heading, size = map(np.array, (middle, middle, 0.0, size_px / _WIDTH))
    target = Pose(x, y, heading, size, posture=poses.shapes.mean)
    shape = size_px, size_px
    return np.stack([
        draw_in_pose(reel.cutouts[int(row)], poses.pose[row], target, shape, sharp=False)
        for row in rows
    ])  # fmt: skip


def _appearance_components(
    draw_rows_straight: DrawStraight, rows: int, most_components: int, workers: Workers
) -> Floats:
    """Return how each row looks, as c principal components of its straightened picture.

    The result is (2, rows, c): of the pictures [0], and of their mirror images [1].
    draw_rows_straight: draws rows by number; rows: how many the film has; c is `most_components`,
    or less in a tiny film.
    """
    sample = draw_rows_straight(spread_rows(np.arange(rows), _SAMPLE))
    both = np.concatenate([sample, sample[:, ::-1]]).reshape(2 * len(sample), -1)
    mean = both.mean(0)
    most_components = min(most_components, min(both.shape) - 1)
    # `svds` gives the least important axis first.
    axes = svds((both - mean).astype(float), most_components, random_state=0)[2][::-1].T
    batches = ordered_map(
        partial(_project_on_axes, draw_rows_straight, mean, axes),
        split_into_blocks(rows, _BATCH),
        workers,
    )
    return np.concatenate(list(batches), axis=1).astype(float)


def _project_on_axes(
    draw_rows_straight: DrawStraight, mean: Reals, axes: Floats, rows: Ints
) -> Floats:
    """Return the components (2, k, c) of straightened pictures of rows (k,) and of mirror images.

    mean (pixels,): subtracted first; axes (pixels, c): onto which the pictures are projected.
    """
    pictures = draw_rows_straight(rows)
    sides = (pictures, pictures[:, ::-1])
    return np.stack([(side.reshape(len(pictures), -1) - mean) @ axes for side in sides])


def split_into_blocks(rows: int, most_rows: int) -> list[Ints]:
    """Return the row numbers 0 … rows − 1 in blocks of at most `most_rows` successive rows."""
    return np.split(np.arange(rows), range(most_rows, rows, most_rows))


def compute_signature_parts(
    source: RowSource, settings: JumpsSettings, workers: Workers
) -> SignatureParts:
    """Return the numbers by which rows, and their mirror images, are compared.

    They are about pose, its change, motion and look. Change and motion are measured over a quarter
    of Δ to each side.
    """
    reel, poses = source.load_film()
    span = max(1, round(infer_delta_frames(reel.features) / 4))
    pose = np.stack([poses.codes, poses.codes @ poses.shapes.mirror_matrix])
    change = np.stack([change_per_row(codes, reel.has_next_frame, span) for codes in pose])
    straight = partial(draw_straight, source, settings.look_px)
    look = _appearance_components(straight, len(reel), settings.look_numbers, workers)
    return SignatureParts(pose, change, measure_film_motion(reel, span), look)


def compute_signatures(
    row_parts: SignatureParts, step_ends: tuple[Ints, Ints], settings: JumpsSettings
) -> Floats:
    """Return the signature vectors (2, n, d) of rows [0] and mirror images [1].

    Their distances say how unlike rows are. A vector has all parts side by side, each standardized
    and times its weight in `settings`. Its unit is the natural step, the median distance from row
    to row a step later. step_ends: rows (k,), and the rows (k,) a step later.
    """
    weighted = [
        standardize_part(row_parts.pose) * settings.pose_weight,
        standardize_part(row_parts.change) * settings.change,
        standardize_part(row_parts.motion, each=True) * settings.motion_weight,
        standardize_part(row_parts.look) * settings.appearance_weight,
    ]
    values, (first, after) = np.concatenate(weighted, axis=-1), step_ends
    natural_step = np.median(np.linalg.norm(values[0, after] - values[0, first], axis=-1))
    return values / max(float(natural_step), 1e-12)


def standardize_part(part: Floats, each: bool = False) -> Floats:
    """Return numbers (2, n, k) centred and scaled so that the variances of all k sum to 1.

    each: whether all k numbers get the same variance; else one factor scales them all.
    """
    return (part - part.mean((0, 1))) / part_divisors(part, each)


def part_divisors(part: Floats, each: bool = False) -> Floats:
    """Return the divisors (k,) by which `standardize_part` scales the k numbers of (2, n, k).

    part (2, n, k): those numbers. Without `each` all divisors are the root of the summed variances;
    with it each is its number's standard deviation times √k.
    """
    variance = ((part - part.mean((0, 1))) ** 2).mean((0, 1))
    squared_divisor = variance * len(variance) if each else np.full_like(variance, variance.sum())
    return np.sqrt(np.maximum(squared_divisor, 1e-24))


def change_per_row(values: Floats, goes_on: Mask, span_rows: int) -> Floats:
    """Return the change (n, k) per row of values (n, k), averaged over some rows around each.

    goes_on (n,): whether the next row is of the same track; span_rows: rows to each side, fewer
    near a track's end.
    """
    rows, last_rows = np.arange(len(values)), np.flatnonzero(~goes_on)  # the last: of the tracks
    first_rows = np.append(0, last_rows[:-1] + 1)
    track = np.searchsorted(last_rows, rows)  # number of each row's track
    before = np.maximum(rows - span_rows, first_rows[track])
    after = np.minimum(rows + span_rows, last_rows[track])
    return (values[after] - values[before]) / np.maximum(after - before, 1)[:, None]


def measure_film_motion(reel: Reel, span_rows: int) -> Floats:
    """Return the speeds (2, n, 3) of rows [0] and mirror images [1]: ahead, left, turning.

    The units are body lengths a frame through the water, and ° a frame, anticlockwise; the speeds
    are averaged over ± `span_rows`.
    """
    features = reel.features
    place = places_through_water(features) / reel.lengths_px[:, None]
    speed = measure_motion(
        place, features["heading_deg"].to_numpy(float), reel.has_next_frame, span_rows
    )
    return np.stack([speed, speed * (1, -1, -1)])


def measure_motion(place: Floats, heading_deg: Floats, goes_on: Mask, span_rows: int) -> Floats:
    """Return the speeds (n, 3): ahead and to the left [body lengths a row], turning [° a row].

    place (n, 2): x, y in body lengths; heading_deg (n,): anticlockwise; goes_on (n,): whether the
    next row is of the same track, False in the last row; span_rows: rows to each side over which a
    speed is averaged.
    """
    unwrapped = np.concatenate([
        np.unwrap(track, period=360)
        for track in np.split(heading_deg, np.flatnonzero(~goes_on)[:-1] + 1)
    ])  # fmt: skip
    velocity = change_per_row(np.column_stack([place, unwrapped]), goes_on, span_rows)
    return np.column_stack([to_body_axes(velocity[:, :2], np.radians(heading_deg)), velocity[:, 2]])


# --- may the fish be mirrored?


def measure_side_difference(draw_rows_straight: DrawStraight, track: Ints, seed: int = 0) -> float:
    """Return how much a fish differs from its mirror image, relative to how its pictures vary.

    1 or less: the sides are alike. All pictures are drawn in one posture; distances are Euclidean
    (Eq. 5), and medians over rows spread over the film. The pictures vary by the distance of two
    random rows of a track. track (n,): ascending ids; seed: of the random rows.
    """
    n = len(track)
    rng = np.random.default_rng(seed)
    rows = spread_rows(np.arange(n), _ROWS)
    first_rows = np.searchsorted(track, track[rows])
    end_rows = np.searchsorted(track, track[rows], "right")
    drawn = draw_rows_straight(rows)
    other_moments = draw_rows_straight(rng.integers(first_rows, end_rows))
    mirror_distance, usual_distance = (
        float(np.median(paired_distances(drawn, against)))
        for against in (drawn[:, ::-1], other_moments)
    )
    return mirror_distance / max(usual_distance, 1e-12)


def measure_handedness(parts: SignatureParts, block_rows: int) -> float:
    """Return how much more a fish bends, drifts or turns to one side than to the other, 0 … 1.

    0: both sides alike, as far as the film can show; 1: only one side. For each of bend, drift and
    turn, the ratio (|mean| − 2 standard errors) / root mean square is computed, at least 0; the
    largest of the three counts. The error is that of means over blocks of `block_rows` rows, since
    a circling fish repeats itself. A single block gives 0.
    """
    largest = 0.0
    for filmed, mirrored in (parts.pose, parts.motion[..., 1:2], parts.motion[..., 2:]):
        one_sided = (filmed - mirrored) / 2  # what a mirror image inverts
        blocks = np.array_split(one_sided, max(1, len(one_sided) // block_rows))
        if len(blocks) == 1:
            break
        means = np.stack([block.mean(0) for block in blocks])
        error = float(means.var(0, ddof=1).sum() / len(means)) ** 0.5
        mean = max(float(np.linalg.norm(one_sided.mean(0))) - 2 * error, 0.0)
        square = float((one_sided**2).mean(0).sum())
        largest = max(largest, mean / max(square, 1e-24) ** 0.5)
    return largest
