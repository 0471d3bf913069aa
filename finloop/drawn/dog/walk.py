"""Compute the drawn dog's walk to the right: every limb's true contour in every frame.

It walks as in the curve paper's §4.2, Fig. 9, diagonal limbs together. A foot is on the ground for
half a cycle, in which it moves straight back under the body at a constant speed. Then it swings
forward, slowly at both ends of its range. In subcycles A and B (phases 0…½) the left fore and right
hind limbs swing; the extremes are key frames 1 and 1'. The dog heads for the right of the screen,
so its right limbs are near.

*Body frame*: it moves steadily with the dog; x forward, y down, px; the origin is on the ground
below the middle of the trunk.
"""

from dataclasses import dataclass

import numpy as np

from finloop.base.arrays import Floats, Mask
from finloop.drawn.dog.shape import (
    EAR,
    FAR_OFFSET,
    HEAD,
    LIMBS,
    NECK,
    TAIL,
    TAIL_ROOT,
    limb_outlines,
    points_on_smooth_curve,
)

NAMES = ("fore_left", "fore_right", "hind_left", "hind_right")
FIRST = ("fore_left", "hind_right")  # they swing in A and B, the others in C and D
ROUND = 1.5  # power in the height of a swinging foot: 1 = a corner on top, 2 = a parabola


@dataclass(frozen=True)
class DogFilm:
    """Parameters of the drawn dog's film; lengths are in trunks (hip to shoulder), else in px.

    The default stride, lift and bob are within the limbs' reach.
    """

    frames: int = 72
    frame_rate_hz: float = 24.0
    cycles: float = 3.0  # cycles of the gait in the film, from phase 0, key frame 1
    width_px: int = 480
    height_px: int = 320
    trunk_px: float = 170.0
    # range of a foot under the body; the dog advances by twice that in a cycle
    stride: float = 0.40
    lift: float = 0.08  # height of a foot in mid-swing
    bob: float = 0.008  # amplitude of the body's rise and fall; it is lowest with the limbs apart
    # swing_fore, swing_hind: gait parameters γ of a swinging foot in the two halves of its swing,
    # at most 1 in size: beyond that a foot turns back
    swing_fore: tuple[float, float] = (-0.8, 0.8)
    swing_hind: tuple[float, float] = (-0.6, 0.6)
    pan: float = 0.95  # share of the dog's motion that the camera follows
    noise: float = 2.0  # SD of the camera's noise, grey levels
    seed: int = 1

    @property
    def frequency_hz(self) -> float:
        """Return the number of gait cycles per second."""
        return self.cycles * self.frame_rate_hz / self.frames

    @property
    def body_length_px(self) -> float:
        """Return the standing dog's length from rump to nose, px."""
        return 1.82 * self.trunk_px


def frame_phases(dog: DogFilm) -> Floats:
    """Return the gait phase of each frame, (frames,), in cycles from 0."""
    return np.arange(dog.frames) * dog.cycles / dog.frames


def foot_gammas(dog: DogFilm, name: str) -> tuple[float, float, float, float]:
    """Return the gait parameters γ of a limb's foot in subcycles A, B, C, D.

    name: one of NAMES; γ is 0 while the foot is on the ground.
    """
    swing = dog.swing_fore if name.startswith("fore") else dog.swing_hind
    return (*swing, 0.0, 0.0) if name in FIRST else (0.0, 0.0, *swing)


def is_swinging(name: str, phase: Floats) -> Mask:
    """Return a mask of the phases at which a limb's foot is off the ground.

    name: one of NAMES; phase: in cycles, an array of any shape.
    """
    return np.asarray((np.mod(phase, 1.0) < 0.5) == (name in FIRST))


def half_cycle_progress(dog: DogFilm, name: str, phase: Floats) -> Floats:
    """Return how much of the current swing, or of the time on the ground, a limb has done, 0 to 1.

    Halves begin at phase 0 and ½. name: of the limb, one of NAMES; phase: in cycles, an array of
    any shape. A swing's progress is uneven by the limb's γ (`foot_gammas`).
    """
    # Subcycles are quarters of the cycle; two of them are a swing, two a time on the ground.
    quarter, tau = np.divmod(np.mod(phase, 1.0) * 4, 1.0)
    subcycle = quarter.astype(int) % 4  # a phase just below 0 gives 4
    gamma = np.array(foot_gammas(dog, name))[subcycle]
    return (subcycle % 2 + (1 + gamma) * tau - gamma * tau**2) / 2


def foot_displacements(dog: DogFilm, name: str, phase: Floats) -> Floats:
    """Return a foot's displacement (…, 2) from rest at phases (…), in trunks; y is down.

    name: of the limb, one of NAMES. The displacement is relative to the body, which moves on
    steadily. A swinging foot follows a rounded triangle.
    """
    progress, swings = half_cycle_progress(dog, name, phase), is_swinging(name, phase)
    x = dog.stride * np.where(swings, progress - 0.5, 0.5 - progress)
    y = np.where(swings, -dog.lift * (1 - np.abs(2 * progress - 1) ** ROUND), 0.0)
    return np.stack([x, y], axis=-1)


def body_displacements(dog: DogFilm, phase: Floats) -> Floats:
    """Return the body's displacement (…, 2) from its mean at phases (…), in trunks; y is down."""
    return np.stack([np.zeros_like(phase), dog.bob * np.cos(4 * np.pi * phase)], axis=-1)


def limb_contours_at(dog: DogFilm, name: str, phase: Floats, n: int) -> Floats:
    """Return contours (…, n, 2) of a limb at phases (…), relative to the body, px, clockwise.

    name: one of NAMES. Point i is a fixed point of the skin; at rest the points have equal arc
    lengths.
    """
    offset = np.array(FAR_OFFSET if name.endswith("left") else (0.0, 0.0))
    foot, top = foot_displacements(dog, name, phase), body_displacements(dog, phase)
    shape = LIMBS[name[:4]]  # by "fore" or "hind"
    return dog.trunk_px * (limb_outlines(shape, foot, top, n) + offset)


def part_contour(
    dog: DogFilm, phase: float, nodes: tuple[tuple[float, float], ...], n: int
) -> Floats:
    """Return the contour (n, 2) px of BODY, HEAD, EAR or TAIL (`nodes`), relative to the body.

    phase: of the gait, in cycles; n: points of the contour.
    """
    points = _rotate_part(nodes, points_on_smooth_curve(nodes, n), phase)
    return dog.trunk_px * (points + body_displacements(dog, np.array(phase)))


def spot_position(dog: DogFilm, phase: float, place: tuple[float, float]) -> Floats:
    """Return the position (2,) px of EYE or NOSE (`place`) at a phase, relative to the body."""
    turned = _rotate_part(HEAD, np.array(place), phase)
    return dog.trunk_px * (turned + body_displacements(dog, np.array(phase)))


def _rotate_part(nodes: tuple[tuple[float, float], ...], points: Floats, phase: float) -> Floats:
    """Return points (n, 2) of a part of the dog, in trunks, turned as it is at a phase.

    nodes: the part. HEAD and EAR turn about the neck, TAIL about its root, BODY stays; phase: of
    the gait, in cycles. Angles are radians, chosen by eye: the head nods twice a cycle, the tail
    wags once.
    """
    if nodes in (HEAD, EAR):
        root, angle = NECK, 0.035 * np.cos(4 * np.pi * phase - 0.8)
    elif nodes == TAIL:
        root, angle = TAIL_ROOT, 0.16 * np.sin(2 * np.pi * phase)
    else:
        return points
    turned = (points - root) @ [1, 1j] * np.exp(1j * angle)
    result = np.array(root) + np.stack([turned.real, turned.imag], axis=-1)
    if nodes == EAR:  # it lags behind the head, most at its lower end
        low = np.clip(points[:, 1] + 1.36, 0, None)  # from its root, 1.36 above the ground
        result[:, 0] += 0.12 * np.sin(4 * np.pi * phase - 1.6) * low
    return result


def standing_points_px(dog: DogFilm) -> Floats:
    """Return where the dog stands in each picture, (frames, 2) px: the ground below its trunk.

    It is the origin of the body frame, see the top of this file.
    """
    # The camera follows only a share of the dog's motion, `pan`; the rest is seen in the picture.
    travel = 2 * dog.stride * dog.trunk_px * frame_phases(dog) * (1 - dog.pan)
    middle = 0.47 * dog.width_px - travel[-1] / 2
    return np.column_stack([middle + travel, np.full(dog.frames, 0.86 * dog.height_px)])


def camera_offsets_px(dog: DogFilm) -> Floats:
    """Return how far the camera has moved to the right in each frame, (frames,) px."""
    return 2 * dog.stride * dog.trunk_px * frame_phases(dog) * dog.pan


def true_limb_contours(dog: DogFilm, n: int) -> dict[str, Floats]:
    """Return the true contours (frames, n, 2) px of all limbs by id, relative to the body."""
    return {name: limb_contours_at(dog, name, frame_phases(dog), n) for name in NAMES}
