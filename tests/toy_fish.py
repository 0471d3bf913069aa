"""A fish drawn from a known backbone and known widths; its left is red, its right blue."""

import cv2
import numpy as np
import pandas as pd

from finloop.base.cutout import Cutout
from finloop.edit.schema import EDIT, WHY
from finloop.tank.body import median_half_widths
from finloop.tank.camera import TankSize
from finloop.tank.fish import FishSurface
from finloop.tank.skin import FishSkins
from finloop.tank.swim import film_body_shapes, poses_in_tank

P, LENGTH = 33, 60.0
S = np.linspace(0, 1, P)
WIDTH = LENGTH * 0.1 * np.sqrt(np.abs(np.sin(np.pi * S**0.7))) * (1.05 - 0.75 * S)
ROOM = TankSize(200, 150, 120, LENGTH)


def mass_centre(alpha):
    """The mass centre (x, y) of a grey picture."""
    y, x = np.mgrid[: alpha.shape[0], : alpha.shape[1]]
    return np.array([(alpha * x).sum(), (alpha * y).sum()]) / alpha.sum()


def rough_picture(rng, height, width, channels):
    """A premultiplied picture that is as rough as can be."""
    alpha = rng.choice([0, 0, 60, 255, 255], (height, width, 1))
    colour = np.rint(rng.random((height, width, channels - 1)) * alpha)
    return np.concatenate([colour, alpha], axis=2).astype(np.uint8)


def line(bend):
    """A backbone (P, 2), head first and to the right, y up, of the same length whatever its bend."""
    angle = bend * S**2
    step = np.stack([-np.cos(angle), np.sin(angle)], -1)[:-1] * LENGTH / (P - 1)
    return np.vstack([[0, 0], np.cumsum(step, axis=0)])


def outline(backbone, width):
    """The polygon (2 P, 2) around it, left side first."""
    ahead = -np.gradient(backbone, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], -1) * width[:, None]
    return np.vstack([backbone + left, (backbone - left)[::-1]])


def polygon_mask(polygon, shape):
    """A mask of a polygon, px of a picture."""
    mask = np.zeros(shape, np.uint8)
    cv2.fillPoly(mask, [np.rint(16 * polygon).astype(np.int32)], 255, cv2.LINE_AA, 4)
    return mask


def toy(bends=(0.9, -0.5), backwards=(False, True)):
    """A film of one picture for every bend: tracks, features, cut-outs; some backbones tail first."""
    rows, heads, cutouts = [], [], []
    for frame, (bend, back) in enumerate(zip(bends, backwards, strict=True)):
        local = line(bend)
        down = local * (1, -1) + (70.0 + 5 * frame, 40.0)
        mask = polygon_mask(outline(down, WIDTH), (90, 120))
        mass = mass_centre(mask.astype(float))
        left = polygon_mask(np.vstack([outline(down, WIDTH)[P:], down]), (90, 120)) > 0  # y is down
        colours = np.where(left[..., None], [200, 30, 30], [30, 30, 200]) * (
            mask[..., None] / 255.0
        )
        cutouts.append(
            Cutout(3, frame, 11, 7, np.dstack([np.rint(colours), mask]).astype(np.uint8))
        )
        spine = down[::-1] if back else down
        rows.append({
            "track_id": 3, "frame": frame, "x_px": mass[0] + 11, "y_px": mass[1] + 7,
            "backbone_x_px": (spine[:, 0] + 11).astype(np.float32),
            "backbone_y_px": (spine[:, 1] + 7).astype(np.float32),
            "half_width_px": (WIDTH[::-1] if back else WIDTH).astype(np.float32),
        })  # fmt: skip
        heads.append({
            "head_x_px": down[0, 0] + 11, "head_y_px": down[0, 1] + 7, "heading_deg": 0.0,
        })  # fmt: skip
    return pd.DataFrame(rows), pd.DataFrame(heads), cutouts


SPRITE = pd.DataFrame({
    "row": [0, 1], "track_id": 3, "frame": [0, 1], "heading_deg": [10.0, -25.0], "mirrored": [False, True],
    "orientations": 24,
})  # fmt: skip


def edit_list(n, **columns):
    """An edit list of n ticks on the film's own pictures, every column as given."""
    none = pd.array([pd.NA] * n, "Int32")
    usual = {
        "fish": 0, "tick": np.arange(n), "time_s": np.arange(n) / 25, "kind": "frame", "source": 0,
        "orientation": none.astype("Int8"), "rotation_deg": 0.0, "scale": 1.0, "x_px": 90.0,
        "y_px": 75.0, "mirrored": False, "partner_kind": None, "partner": none,
        "partner_orientation": none.astype("Int8"), "partner_rotation_deg": np.nan,
        "partner_scale": np.nan, "partner_mirrored": False, "weight": 0.0, "pose": None,
        "heading_deg": 0.0, "speed": 1.0, "motion_area": np.nan, "mode": "network",
        "state": "straight", "goal": "", "aim_x_px": 0.0, "aim_y_px": 0.0,
    }  # fmt: skip
    return pd.DataFrame(usual | dict.fromkeys(WHY) | columns, index=range(n))[EDIT.names]


def fish_of(edit):
    tracks, heads, cutouts = toy()
    film = film_body_shapes(tracks, heads)
    typical = median_half_widths(film.half_width, film.backbone)
    pose = poses_in_tank(edit, film, SPRITE)
    skins = FishSkins(film, typical, tracks[["x_px", "y_px"]].to_numpy(), cutouts.__getitem__)
    place = np.c_[pose.centre, np.full(len(edit), 40.0)]
    return FishSurface(pose, place, skins, typical, LENGTH)


def fish_mask(fish, tick, shape):
    """What a fish covers, seen from above."""
    mask = np.zeros(shape, np.uint8)
    at = (fish.surface_and_skin_at(tick)[0][..., :2] * (1, -1)).astype(np.float32)
    for pair in zip(at[:-1], at[1:], strict=True):
        hull = cv2.convexHull(np.concatenate(pair))
        cv2.fillConvexPoly(mask, np.rint(16 * hull).astype(np.int32), 255, cv2.LINE_AA, 4)
    return mask > 127


def overlap(a, b):
    return (a & b).sum() / (a | b).sum()
