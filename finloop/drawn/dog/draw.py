"""Draw the walking dog, and find its limbs in the drawn pictures.

Flat colours on a meadow that passes by. The near limbs are paler than everything else, so that
`limb_masks` can segment them by their colour; the far limbs are partly hidden.
"""

from collections.abc import Iterator

import cv2
import numpy as np

from finloop.base.arrays import Floats, Mask, Picture
from finloop.base.errors import FinloopError
from finloop.drawn.dog.shape import BODY, EAR, EYE, HEAD, NOSE, TAIL
from finloop.drawn.dog.walk import (
    DogFilm,
    camera_offsets_px,
    frame_phases,
    limb_contours_at,
    part_contour,
    spot_position,
    standing_points_px,
)

POINTS = 256
SUBPIXEL = 6  # bits of a pixel's fraction in the fill
BLUR_PX = 0.6
NEAR, FAR, COAT, DARK = (246, 232, 204), (118, 84, 62), (168, 108, 58), (98, 58, 34)
COLLAR, INK, SHADE = (186, 44, 52), (36, 26, 24), (98, 142, 76)
SKY, HILL, MEADOW, TUFT = (164, 204, 232), (128, 176, 136), (118, 164, 88), (84, 132, 66)
COLLAR_CORNERS = np.array([[0.545, -1.115], [0.60, -1.19], [0.845, -1.03], [0.815, -0.955]])
PALETTE = (NEAR, FAR, COAT, DARK, COLLAR, INK, SHADE, SKY, HILL, MEADOW, TUFT)


def dog_frames(dog: DogFilm) -> Iterator[Picture]:
    """Yield the frames of the dog's film, (height, width, 3) RGB, uint8."""
    rng = np.random.default_rng(dog.seed)
    # Tufts on the meadow along the dog's whole track: x [px], y [share of its depth], size [px].
    track_end = dog.width_px + camera_offsets_px(dog)[-1]
    count = int(track_end / 26) + 4  # one for 26 px
    tuft_x, depth = rng.uniform(-40, track_end + 40, count), rng.uniform(0.08, 1, count)
    tufts = np.column_stack([tuft_x, depth, rng.uniform(3, 7, count)])
    tufts = tufts[np.argsort(depth)]  # the farthest first: nearer ones cover them
    # Hills behind it, one for 130 px: x, height [px].
    steps = np.arange(-1, track_end / 130 + 2)
    hill_x = 130 * steps + rng.uniform(-30, 30, len(steps))
    hills = np.column_stack([hill_x, rng.uniform(24, 60, len(steps))])
    for frame in range(dog.frames):
        sharp = _paint_frame(dog, frame, tufts, hills)
        picture = cv2.GaussianBlur(sharp, (0, 0), BLUR_PX).astype(np.float32)
        grain = rng.standard_normal(picture.shape[:2], np.float32) * dog.noise
        yield np.clip(np.rint(picture + grain[..., None]), 0, 255).astype(np.uint8)


def _paint_frame(dog: DogFilm, frame: int, tufts: Floats, hills: Floats) -> Picture:
    """Return a frame without noise: the meadow, the dog's shadow, and its parts, far to near.

    tufts (k, 3), hills (m, 2): as in `_paint_landscape`.
    """
    picture = np.empty((dog.height_px, dog.width_px, 3), np.uint8)
    origin = standing_points_px(dog)[frame]
    horizon = round(origin[1] - 0.42 * dog.trunk_px)
    _paint_landscape(picture, horizon, camera_offsets_px(dog)[frame], tufts, hills)
    phase = float(frame_phases(dog)[frame])
    half_width, half_height = 0.62 * dog.trunk_px, 0.035 * dog.trunk_px
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    _fill_polygon(picture, origin + circle * [half_width, half_height], SHADE)

    def fill_limb(name: str, colour: tuple[int, int, int]) -> None:
        """Paint one limb of the dog into the picture."""
        contour = limb_contours_at(dog, name, np.array(phase), POINTS)
        _fill_polygon(picture, origin + contour, colour)

    fill_limb("fore_left", FAR)
    fill_limb("hind_left", FAR)
    for part, colour in ((TAIL, COAT), (BODY, COAT), (HEAD, COAT), (EAR, DARK)):
        contour = part_contour(dog, phase, part, POINTS)
        _fill_polygon(picture, origin + contour, colour)
        if part == BODY:
            # The collar rises and falls with the body.
            bob = contour[0] - part_contour(dog, 0.0, BODY, POINTS)[0]
            _fill_polygon(picture, origin + dog.trunk_px * COLLAR_CORNERS + bob, COLLAR)
    fill_limb("hind_right", NEAR)
    fill_limb("fore_right", NEAR)
    for place, radius in ((EYE, 0.020), (NOSE, 0.030)):
        centre = origin + spot_position(dog, phase, place)
        _fill_polygon(picture, centre + radius * dog.trunk_px * circle, INK)
    return picture


def _paint_landscape(
    picture: Picture, horizon: int, camera_px: float, tufts: Floats, hills: Floats
) -> None:
    """Paint sky, hills and meadow over a whole picture, in place.

    horizon: its row; camera_px: how far the camera has moved to the right; tufts (k, 3): x px, y as
    a share of the meadow's depth, size px; hills (m, 2): x and height, px.
    """
    picture[:horizon], picture[horizon:] = SKY, MEADOW
    for x, height in hills:
        # Hills are far: they pass by at 0.3 of the meadow's speed.
        centre = (round(x - 0.3 * camera_px), horizon)
        cv2.ellipse(picture, centre, (110, round(height)), 0, 180, 360, HILL, -1, cv2.LINE_AA)
    for x, depth, size in tufts:
        y = horizon + depth * (len(picture) - horizon)
        root = np.array([x - camera_px, y])
        for lean in (-0.6, 0.0, 0.6):
            blade = np.array([[-1.2, 0], [1.2, 0], [lean * size, -size * (0.6 + depth)]])
            _fill_polygon(picture, root + blade, TUFT)


def _fill_polygon(picture: Picture, points: Floats, colour: tuple[int, int, int]) -> None:
    """Fill a polygon (n, 2) px in a picture, in place, with subpixel corners."""
    nodes = np.rint(points * (1 << SUBPIXEL)).astype(np.int32)
    cv2.fillPoly(picture, [nodes], colour, cv2.LINE_AA, SUBPIXEL)


def limb_masks(picture: Picture) -> dict[str, Mask]:
    """Return the masks (h, w) of the two near limbs in a frame of the drawn dog's film, by id.

    The ids are "fore_right" and "hind_right"; the limbs are found by their colour. FinloopError if
    the picture has fewer than two pale regions: it is not a frame of this film.
    """
    palette = np.array(PALETTE, np.float32)  # of all parts of the picture, the near limbs first
    # The squared distance to each colour, less the pixel's own square; whole numbers, so exact.
    distance = (palette**2).sum(axis=1) - 2 * picture.astype(np.float32) @ palette.T
    pale = (distance.argmin(axis=2) == 0).astype(np.uint8)
    count, labels, stats, centres = cv2.connectedComponentsWithStats(pale, connectivity=4)
    if count < 3:  # two limbs and the background, label 0
        raise FinloopError(
            f"a picture with {count - 1} regions in the colour of the near limbs",
            "a frame of the drawn dog, in which both near limbs are seen",
            "take the frames from the film of the drawn dog",
        )
    largest = 1 + np.argsort(-stats[1:count, cv2.CC_STAT_AREA])[:2]
    hind, fore = sorted(largest, key=lambda label: centres[label][0])
    return {"fore_right": labels == fore, "hind_right": labels == hind}
