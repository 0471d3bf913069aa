"""Find pieces of a cut shape that cover each other on the way, though they do not in a drawing."""

from collections.abc import Collection, Mapping, Sequence

import cv2
import numpy as np

from finloop.base.arrays import Floats, Mask, Points

RASTER_PX = 256  # side of the masks on which areas are compared
LEAST = 0.02
"""Share of the smaller piece that must be covered, beyond what is so in both drawings: the seam,
along which pieces overlap, changes its length on the way."""


def find_covered_pieces(
    shapes: Mapping[str, Sequence[Points]], cut: Sequence[Collection[str]]
) -> dict[str, Mask]:
    """Return by id in which frames (f,) a piece of a cut shape and another such piece overlap.

    shapes: the closed contours (f, n, 2) of each shape by id. cut: for either drawing the ids of
    the shapes that are pieces there. Pieces that never overlap are left out.
    """
    found = dict[str, Mask]()
    for names in map(sorted, cut):
        if len(names) < 2:
            continue
        common = _common_areas([shapes[name] for name in names])
        areas = np.diagonal(common, axis1=1, axis2=2)
        least = LEAST * np.minimum(areas[:, :, None], areas[:, None])
        overlaps = common > np.maximum(common[0], common[-1]) + least
        overlaps[:, range(len(names)), range(len(names))] = False
        for name, frames in zip(names, overlaps.any(axis=2).T, strict=True):
            if frames.any():
                found[name] = found.get(name, np.zeros_like(frames)) | frames
    return found


def _common_areas(shapes: Sequence[Sequence[Points]]) -> Floats:
    """Return the area that each two of s shapes have in common, (f, s, s), in px of a mask.

    shapes: the closed contours (f, n, 2) of each.
    """
    corners = np.concatenate([stack.reshape(-1, 2) for stacks in shapes for stack in stacks])
    low, size = corners.min(axis=0), float(np.ptp(corners, axis=0).max()) or 1.0
    pixels = [
        [np.round((stack - low) * ((RASTER_PX - 1) / size)).astype(np.int32) for stack in stacks]
        for stacks in shapes
    ]
    common = np.empty((len(shapes[0][0]), len(shapes), len(shapes)))
    for frame, areas in enumerate(common):
        masks = np.zeros((len(shapes), RASTER_PX, RASTER_PX), np.uint8)
        for mask, stacks in zip(masks, pixels, strict=True):
            cv2.fillPoly(mask, [stack[frame] for stack in stacks], 1)
        flat = masks.reshape(len(masks), -1).astype(np.float32)
        areas[:] = flat @ flat.T
    return common
