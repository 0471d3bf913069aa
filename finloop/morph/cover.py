"""Keep the pieces of a cut shape apart while they move, and find those that cover each other.

Each piece moves without folds, but alone. So a piece that would cover others of its shape steps
aside: it is shifted in one direction, by as much as it needs, and comes back. Shapes that are
no pieces of one shape are layers, and may pass over each other, as a drawing's layers do.
"""

from collections.abc import Iterator, Mapping, Sequence

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Points
from finloop.morph.simple import smooth_in_time

Masks = NDArray[np.uint8]

RASTER_PX, SHIFT_RASTER_PX = 256, 192
"""Side of the masks on which areas are compared, and of those on which shifts are sought."""
LEAST, ROUNDING_PX = 0.02, 4
"""Share of the smaller piece that must be covered, beyond what is so in both drawings, and how many
pixels: the seam, along which pieces overlap, changes its length on the way, and corners are rounded
to whole pixels."""
STRICT = 0.002  # the same share, where shifts are sought
DIRECTIONS = 32  # in which a piece may step aside
MOST_PIECES = 16  # of a shape that step aside: each looks at all others
MOST_TIMES = 64  # frames, evenly in time, at which a shift is sought
EASE = 2.0  # width in such frames of the Gaussian that rounds the corners of a shift in time
ROUNDS = 30  # of raising a rounded shift until nothing is covered


def find_covered_pieces(
    shapes: Mapping[str, Sequence[Points]], families: Sequence[Sequence[str]]
) -> dict[str, Mask]:
    """Return by id in which frames (f,) a piece and another one of its family cover each other.

    shapes: the closed contours (f, n, 2) of each shape by id. families: ids of the pieces of each
    cut shape. Pieces that never cover another are left out.
    """
    found = dict[str, Mask]()
    for names in families:
        masks, _ = _draw_masks([shapes[name] for name in names], RASTER_PX)
        flat = (frame.reshape(len(names), -1).astype(np.float32) for frame in masks)
        common = np.stack([frame @ frame.T for frame in flat])  # px
        areas = np.diagonal(common, axis1=1, axis2=2)
        least = LEAST * np.minimum(areas[:, :, None], areas[:, None]) + ROUNDING_PX
        overlaps = common > np.maximum(common[0], common[-1]) + least
        overlaps[:, range(len(names)), range(len(names))] = False
        found |= {
            name: frames
            for name, frames in zip(names, overlaps.any(axis=2).T, strict=True)
            if frames.any()
        }
    return found


def find_shifts(pieces: Sequence[Sequence[Points]]) -> list[Points]:
    """Return shifts (f, 2) of each piece that keep pieces apart on the way, as far as possible.

    pieces: the closed contours (f, n, 2) of each. The piece in the middle stays. Each one farther
    out keeps clear of all that are nearer, since it has room outside: in that one of DIRECTIONS
    in which it moves least, by the sum of its squared steps. At both ends shifts are 0, and
    throughout if there are more than MOST_PIECES, or where no direction is free.
    """
    frames = len(pieces[0][0])
    if len(pieces) > MOST_PIECES:
        return [np.zeros((frames, 2)) for _ in pieces]
    times = np.unique(np.round(np.linspace(0, frames - 1, min(frames, MOST_TIMES))).astype(int))
    stacks = [[stack[times] for stack in piece] for piece in pieces]
    drawn, scale = _draw_masks(stacks, SHIFT_RASTER_PX)
    masks = np.stack(list(drawn))
    areas = masks.sum(axis=(2, 3), dtype=np.float64)
    centres = np.stack([np.concatenate(piece, axis=1).mean(axis=1) for piece in stacks], axis=1)
    middle = (areas[:, :, None] * centres).sum(axis=1) / areas.sum(axis=1)[:, None]
    far = np.hypot(*(centres - middle[:, None]).transpose(2, 0, 1)).mean(axis=0)
    order = np.argsort(far, kind="stable")
    shifts, share = [np.zeros((frames, 2)) for _ in pieces], np.linspace(0, 1, len(times))[:, None]
    for rank, number in enumerate(order[1:], start=1):
        others, mask = masks[:, order[:rank]], masks[:, number]
        common = (others & mask[:, None]).sum(axis=(2, 3), dtype=np.float64)
        most = (1 - share) * common[0] + share * common[-1] + STRICT * areas[:, [number]]
        if (common > most).any():
            by = _shift_aside(others, mask, most)
            masks[:, number] = [
                cv2.warpAffine(one, np.column_stack([np.eye(2), shift]), one.shape)
                for one, shift in zip(mask, by, strict=True)
            ]
            shifts[number] = np.stack(
                [np.interp(np.arange(frames), times, values / scale) for values in by.T], axis=1
            )
    return shifts


def _shift_aside(others: Masks, mask: Masks, most: Floats) -> Points:
    """Return how to shift masks (f, h, h) off others in every frame, (f, 2) px; 0 at both ends.

    others (f, k, h, h): masks that stay. most (f, k): pixels that each may have in common with the
    shifted one.
    """
    side = mask.shape[-1]
    size = 2 * side, 2 * side  # room for every shift
    own = scipy.fft.rfft2(mask.astype(np.float32), size).conj()
    is_covered = np.zeros((len(mask), *size), np.bool_)  # by the shift y, x
    for other, limit in zip(others.swapaxes(0, 1), most.T, strict=True):
        common = scipy.fft.irfft2(own * scipy.fft.rfft2(other.astype(np.float32), size), size)
        is_covered |= common > limit[:, None, None] + 0.5  # but for rounding, whole numbers
    least, best = np.inf, np.zeros((len(mask), 2))
    for angle in 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        direction = np.array([np.cos(angle), np.sin(angle)])
        x, y = np.round(direction[:, None] * np.arange(side)).astype(int)
        distance = _distance_aside(is_covered[:, y, x])
        if distance is not None and (effort := float((np.diff(distance) ** 2).sum())) < least:
            least, best = effort, distance[:, None] * direction
    return best


def _distance_aside(is_covered: Mask) -> Floats | None:
    """Return how far to shift in every frame (f,), in steps; None if no such distance is found.

    is_covered (f, s): whether too much is covered in a frame after so many steps. The distance is
    like a rope over pegs: it rises and falls steadily, with rounded corners.
    """
    frames, steps = is_covered.shape
    free = np.where(is_covered, steps, np.arange(steps))
    free = np.minimum.accumulate(free[:, ::-1], axis=1)[:, ::-1]  # the next free step, if any
    pegs, rows = free[:, 0].astype(np.float64), np.arange(frames)
    for _ in range(ROUNDS):
        distance = smooth_in_time(_rope_over(pegs), EASE)
        distance[[0, -1]] = 0.0
        if distance.max() > steps - 1:
            return None
        nearest = np.round(distance).astype(int)
        lacking = np.where(is_covered[rows, nearest], free[rows, nearest] - distance, 0.0)
        if not lacking.any():
            return distance
        pegs += np.where(lacking != 0, np.maximum(lacking, 1), 0)
    return None


def _rope_over(pegs: Floats) -> Floats:
    """Return the lowest concave curve (f,) that is nowhere below pegs (f,)."""
    corners = [0]
    for k in range(1, len(pegs)):
        while len(corners) > 1:
            i, j = corners[-2:]
            if (pegs[j] - pegs[i]) * (k - i) > (pegs[k] - pegs[i]) * (j - i):
                break
            corners.pop()
        corners.append(k)
    return np.interp(np.arange(len(pegs)), corners, pegs[corners])


def _draw_masks(pieces: Sequence[Sequence[Points]], side_px: int) -> tuple[Iterator[Masks], float]:
    """Return what k pieces cover, masks (k, side_px, side_px) frame by frame, and px per unit.

    pieces: the closed contours (f, n, 2) of each. Every frame is centred, so that a small shape
    that goes far is not small on its masks.
    """
    corners = np.concatenate([stack for stacks in pieces for stack in stacks], axis=1)
    low, high = corners.min(axis=1), corners.max(axis=1)
    scale = (side_px - 1) / (float((high - low).max()) or 1.0)
    shift = (side_px - 1) / 2 - scale * (low + high)[:, None] / 2
    pixels = [[np.round(stack * scale + shift).astype(np.int32) for stack in stacks]
              for stacks in pieces]  # fmt: skip

    def draw_frame(frame: int) -> Masks:
        """Return the masks (k, side_px, side_px) of a frame."""
        masks = np.zeros((len(pieces), side_px, side_px), np.uint8)
        for mask, stacks in zip(masks, pixels, strict=True):
            cv2.fillPoly(mask, [stack[frame] for stack in stacks], 1)
        return masks

    return map(draw_frame, range(len(corners))), scale
