"""Picture of `pose`: the first principal shapes, drawn on an animal of the film."""

import numpy as np

from finloop.base.cutout import Cutouts
from finloop.plots.parts import Picture, in_rows, on_grey, write
from finloop.pose.film import FilmPoses
from finloop.puppet import draw_in_pose

_INK = (150, 30, 30)
SHAPES, TIMES = 4, (-2, -1, 0, 1, 2)


def draw_shapes(poses: FilmPoses, film: Cutouts, size: int = 150) -> Picture:
    """Draw the first principal shapes of the posture, a row each, as (h, w, 3).

    A row shows one animal at the mean posture and at `TIMES` standard deviations from it. The
    animal is the row whose posture is nearest to the mean. size: px of a picture.
    """
    shapes = poses.shapes
    row = int((poses.codes**2).sum(1).argmin())
    middle, length = (size - 1) / 2, size / 1.5
    tiles = []
    for number in range(min(SHAPES, len(shapes.shapes))):
        share = 100 * shapes.variance_shares[number]
        for times in TIMES:
            codes = np.zeros(len(shapes.shapes))
            codes[number] = times * np.sqrt(shapes.variance[number])
            pose = poses.pose_from_codes(row, codes).move_to(middle, middle, 0, length)
            picture = 255 * draw_in_pose(film[row], poses.pose[row], pose, (size, size))
            tile = on_grey(picture[..., :-1], picture[..., -1:] / 255)
            write(tile, f"{number + 1}: {share:.1f} %, {times:+d} sd", (4, 12), _INK, 0.35)
            tiles.append(tile)
    return np.vstack(in_rows(tiles, len(TIMES)))
