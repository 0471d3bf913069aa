"""Picture of `pose`: the first principal shapes, drawn on an animal of the film."""

import numpy as np

from finloop.base.cutout import Cutouts
from finloop.extract.matte import drop_residue
from finloop.plots.parts import INK, Picture, composite_on_grey, join_in_rows, write_text
from finloop.pose.film import FilmPoses
from finloop.puppet import draw_in_pose

SHAPES, TIMES = 4, (-2, -1, 0, 1, 2)
_SIZE = 150  # px, width of a tile


def draw_shapes(poses: FilmPoses, cutouts: Cutouts) -> Picture:
    """Return a picture (h, w, 3) of the first principal shapes of the pose, one per row of tiles.

    A row shows one animal in the mean pose and at `TIMES` standard deviations from it. The animal
    is that of the film whose pose is nearest to the mean.
    """
    shapes = poses.shapes
    row = int((poses.codes**2).sum(1).argmin())  # the codes of the mean pose are 0
    cutout = cutouts[row]
    cutout = cutout._replace(pixels=drop_residue(cutout.pixels))
    middle, length = (_SIZE - 1) / 2, _SIZE / 1.5  # the animal spans two thirds of a picture
    tiles = []
    for number in range(min(SHAPES, len(shapes.shapes))):
        share = 100 * shapes.variance_shares[number]
        for times in TIMES:
            codes = np.zeros(len(shapes.shapes))
            codes[number] = times * np.sqrt(shapes.variance[number])
            pose = poses.pose_from_codes(row, codes).move_to(middle, middle, 0, length)
            picture = 255 * draw_in_pose(cutout, poses.pose[row], pose, (_SIZE, _SIZE))
            tile = composite_on_grey(picture[..., :-1], picture[..., -1:] / 255)
            write_text(tile, f"{number + 1}: {share:.1f} %, {times:+d} sd", (4, 12), INK, 0.35)
            tiles.append(tile)
    return np.vstack(join_in_rows(tiles, len(TIMES)))
