"""A gait drives drawings: poses, symmetry, correspondence, feet on the ground."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from finloop.base.drawing import Drawing
from finloop.base.errors import FinloopError
from finloop.base.style import Gradient, Paint, Stop, mix_colours
from finloop.curve.contour import Curve, resample_curve
from finloop.drawn.dog.walk import DogFilm, frame_phases, true_limb_contours
from finloop.gait.fit import GaitContours, fit_gait
from finloop.gait.ground import foot_displacement, measure_ground, plant_feet, support_frames
from finloop.gait.model import Gait, contours_at_phases, mirror_contours
from finloop.gait.tool import load_gait
from finloop.gait.transfer import (
    animate_drawing,
    match_key_poses,
    mirrored_point_orders,
    pool_gammas,
    renumber_curve,
    repeat_cycle,
)
from finloop.io.svg import load_svg

FIRST, LATER = ((0.0, 0.5),), ((0.5, 1.0),)
WALK = Gait(
    "walk",
    "swap",
    1.0,
    {
        "fore_left": {"A": (-1.0,), "B": (1.0,)},
        "hind_right": {"A": (-1.0,), "B": (1.0,)},
        "*": {"A": (0.0,), "B": (0.0,)},
    },
    support={"fore_right": FIRST, "hind_left": FIRST, "fore_left": LATER, "hind_right": LATER},
)
SWIM = Gait("swim", "mirror", 2.0, {"*": {"A": (-0.5,), "B": (0.5,)}})
BOOT = np.array([[0, 0], [9, 0], [8, 30], [20, 34], [20, 40], [0, 40]], float)


def poses(name: str) -> tuple[Drawing, Drawing]:
    one, two = (load_svg(Path(ROOT / f"data/drawings/{name}_{key}.svg")) for key in (1, 2))
    return one, two


def legs(**where: tuple[float, float]) -> Drawing:
    """Boots at places of a picture of 100 by 60."""
    return Drawing({name: Curve(BOOT + at, True) for name, at in where.items()}, 100, 60)


def rotate(points: np.ndarray, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, s], [-s, c]])


# --- shipped drawings


@pytest.mark.parametrize(("name", "gait"), [("dog", WALK), ("fish", SWIM)])
def test_shipped_drawings_go_without_folds_or_jumps(name, gait):
    done = animate_drawing(poses(name), gait, 16, 64)
    assert not any(count.any() for count in done.morph.folds.values())
    assert done.outside == {}
    for stack in done.morph.layers.values():
        step = np.abs(np.roll(stack, -1, axis=0) - stack).max(axis=(1, 2))
        assert step[-1] <= 1.5 * step[:-1].max() + 0.01


def test_the_dog_stands_on_its_feet():
    uneven = replace(WALK, gamma={"*": {"A": (-1.0,), "B": (1.0,)}})
    done = animate_drawing(poses("dog"), uneven, 16, 64)
    assert max(done.after.slide.values()) < 1e-4 < 0.03 < max(done.before.slide.values())
    one, two = poses("dog")  # the second pose may have another size
    large = Drawing({n: Curve(3 * c.points, c.closed) for n, c in two.curves.items()}, 1620, 1140)
    found, wanted = (animate_drawing((one, key), WALK, 4, 32).morph.layers for key in (large, two))
    assert found["tail"] == pytest.approx(wanted["tail"], abs=0.02)
    done = animate_drawing(poses("dog"), WALK, 16, 64)
    assert max(done.after.slide.values()) < 1e-4 < max(done.before.slide.values()) < 0.005
    width = np.ptp(np.concatenate([c.points for c in poses("dog")[0].curves.values()])[:, 0])
    assert done.after.speed * 16 * width == pytest.approx(-168, rel=0.01)  # two steps as drawn


def test_few_control_points_keep_the_ground():
    whole, few = (animate_drawing(poses("dog"), WALK, 8, 64, control) for control in (None, 4))
    assert max(few.after.slide.values()) < 1e-4
    far = np.abs(few.morph.layers["head"] - whole.morph.layers["head"]).max()
    assert far > 2


# --- four key poses


def gallop_poses(name: str) -> list[Drawing]:
    return [load_svg(ROOT / f"data/drawings/{name}_gallop_{key}.svg") for key in (1, 2, 3, 4)]


@pytest.mark.parametrize("name", ["dog", "cat"])
def test_shipped_drawings_gallop_without_folds_and_stand_where_they_are_drawn(name):
    gait, poses = load_gait(ROOT / "data/gaits/horse_gallop.json"), gallop_poses(name)
    done = animate_drawing(poses, gait, 16, 64)
    assert done.morph.count_fold_frames() == {} == done.outside
    assert max(done.after.slide.values()) < 0.012 < 0.1 < max(done.before.slide.values())
    assert done.morph.tau.tolist() == (np.arange(16) / 16).tolist()
    for key, pose in enumerate(poses):
        body = done.morph.layers["body"][4 * key]
        drawn = resample_curve(pose.curves["body"], 512).points
        nearest = np.linalg.norm(body[:, None] - drawn, axis=-1).min(axis=1)
        assert nearest.max() < 1  # px, of 600
    for limb, spans in gait.support.items():
        low = done.morph.layers[limb][..., 1].max(axis=1)
        stands = support_frames(spans, 16)[0] % 16
        lowest = max(pose.curves[limb].points[:, 1].max() for pose in poses)
        assert low[stands] == pytest.approx(lowest, abs=2)


def test_a_leg_that_turns_far_over_four_poses_is_not_taken_upside_down():
    """Both ends are alike; the first and the third pose are turned by 105° from each other."""
    rod = np.array([[0, 0], [9, 0], [8, 40], [1, 40]], float)
    angles = (55, 10, -50, -20)
    poses = [Drawing({"leg": Curve(rotate(rod, a) + [50, 5], True)}, 120, 60) for a in angles]
    keys = match_key_poses(poses, "none", 32)
    for key, degrees in zip(keys, angles, strict=True):
        turned = rotate(keys[0]["leg"] - [50, 5], degrees - angles[0]) + [50, 5]
        assert key["leg"] == pytest.approx(turned, abs=1)


def test_four_poses_have_four_paints():
    inks = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (9, 9, 9)]
    still = {"fore_left": Curve(BOOT + [30, 5], True)}
    poses = [Drawing(still, 100, 60, {"fore_left": Paint(ink, None, 1, 1, 1)}) for ink in inks]
    gait = Gait("x", "none", 1.0, {"*": dict.fromkeys("ABCD", (0.0,))})
    paints = animate_drawing(poses, gait, 8, 32).morph.styles["fore_left"]
    assert [paint.fill for paint in paints[::2]] == inks
    assert paints[7].fill == mix_colours(inks[3], inks[0], 0.5)


# --- keys and symmetry


def test_swap_passes_the_keys_of_left_and_right():
    one, two = poses("dog")
    layers = animate_drawing((one, two), replace(WALK, support={}), 8, 64).morph.layers
    for name, other in (("fore_left", "fore_right"), ("hind_right", "hind_left"), ("body", "body")):
        assert np.abs(layers[name][4] - layers[other][0]).max() < 0.02
        assert np.abs(layers[name][6] - layers[other][2]).max() < 0.02
    keys = match_key_poses((one, two), "swap", 64)
    assert np.abs(layers["fore_left"][[0, 2]] - [key["fore_left"] for key in keys]).max() < 0.01


def test_mirror_passes_reflected_keys():
    layers = animate_drawing(poses("fish"), SWIM, 12, 64).morph.layers
    for name, other in (("tail", "tail"), ("eye_left", "eye_right"), ("mouth", "mouth")):
        here, there = layers[name][:6], layers[other][6:] * [1, -1] + [0, 300]
        near = np.abs(here[:, :, None] - there[:, None]).max(axis=-1).min(axis=2)
        assert near.max() < 0.02


def test_swing_follows_its_clock():
    one = legs(fore_left=(10, 5), fore_right=(50, 5))
    two = legs(fore_left=(30, 5), fore_right=(30, 5))
    layers = animate_drawing((one, two), replace(WALK, support={}), 16, 32).morph.layers
    x = layers["fore_left"][:, :, 0].mean(axis=1) - BOOT[:, 0].mean()
    tau = np.arange(4) / 4
    x -= x[0] - 10
    assert x[:4] == pytest.approx(30 - 20 * (1 - tau**2), abs=0.01)
    assert x[4:8] == pytest.approx(50 - 20 * (1 - tau) ** 2, abs=0.01)
    assert x[8:12] == pytest.approx(50 - 20 * tau, abs=0.01)  # the right one's A, not eased


def test_ids_that_a_gait_does_not_name_go_by_the_mean():
    bare = replace(WALK, gamma={"fore_left": {"A": (-1.0, -0.5), "B": (1.0,)}})
    assert pool_gammas(bare).gamma == bare.gamma | {"*": {"A": (-0.75,), "B": (1.0,)}}
    assert pool_gammas(WALK) == WALK


def test_gamma_per_coefficient_moves_a_drawing_of_any_number_of_points_by_its_mean():
    """The mean is by energy: (3² · 0.5 + 4² · −0.5) / 5²."""
    gammas, motion = ((0.5,), (-0.5,)), ((0.6,), (0.8,))
    each = dict.fromkeys("AB", gammas), dict.fromkeys("AB", motion)
    gait = Gait("x", "mirror", 1.0, {"tail": each[0]}, motion={"tail": each[1]})
    pooled = pool_gammas(gait).gamma
    assert pooled["tail"] == pooled["*"] == dict.fromkeys("AB", (pytest.approx(-0.14),))
    one = replace(gait, gamma={"*": dict.fromkeys("AB", (-0.14,))}, motion={})
    for points in (32, 64):
        found, wanted = (animate_drawing(poses("fish"), g, 8, points).morph for g in (gait, one))
        for name, stack in wanted.layers.items():
            np.testing.assert_allclose(found.layers[name], stack, atol=0.02)


def test_gamma_of_one_dog_moves_another_dog_best_as_one_for_the_limb():
    """γ per coordinate belongs to the contour that was filmed: elsewhere it is worse than none."""

    def film(dog: DogFilm, start: int) -> GaitContours:
        contours = true_limb_contours(dog, 32).items()
        rolled = {name: np.roll(points, start, axis=1) for name, points in contours}
        return GaitContours(rolled, frame_phases(dog), dog.body_length_px, "swap")

    one, other = film(DogFilm(), 0), film(DogFilm(stride=0.3, lift=0.05), 7)
    keys = [{name: points[k] for name, points in other.contours.items()} for k in (0, 6)]

    def error(gait: Gait) -> float:
        """Of subcycle A of the other dog, RMS, px."""
        found = contours_at_phases(keys, gait, other.phase[:6])
        off = [points - other.contours[name][:6] for name, points in found.items()]
        return float(np.sqrt(np.mean(np.square(off))))

    limb, coordinate = (
        fit_gait(one, "x", 1.0, sharing=sharing)[0] for sharing in ("limb", "coordinate")
    )
    linear = error(Gait("x", "swap", 1.0, {}))
    assert error(limb) < 0.7 * linear < linear < error(coordinate)
    assert error(pool_gammas(coordinate)) == pytest.approx(error(limb), rel=1e-3)


def test_a_far_limb_that_stands_higher_stays_there():
    one = legs(fore_left=(10, 5), fore_right=(50, 12))
    two = legs(fore_left=(30, 1), fore_right=(30, 12))
    done = animate_drawing((one, two), WALK, 16, 64)
    low = {name: stack[..., 1].max(axis=1) for name, stack in done.morph.layers.items()}
    assert low["fore_left"].max() == pytest.approx(45, abs=0.02)
    assert low["fore_right"] == pytest.approx(
        low["fore_left"][(np.arange(16) + 8) % 16] + 7, abs=0.02
    )


def test_what_leaves_the_picture_is_counted():
    one = legs(fore_left=(-5, 5), fore_right=(50, 5))
    done = animate_drawing((one, legs(fore_left=(20, 5), fore_right=(20, 5))), WALK, 8, 32)
    assert set(done.outside) == {"fore_left", "fore_right"}
    assert done.outside["fore_left"] == done.outside["fore_right"]  # each is there in its turn


def test_exchanged_sides_are_told():
    one = legs(fore_left=(10, 5), fore_right=(50, 5))
    well = legs(fore_left=(30, 1), fore_right=(30, 5))
    assert animate_drawing((one, well), WALK, 8, 32).lifted == ()
    wrong = legs(fore_left=(30, 5), fore_right=(30, 1))
    assert animate_drawing((one, wrong), WALK, 8, 32).lifted == ("fore_right",)
    assert animate_drawing(poses("dog"), WALK, 8, 32).lifted == ()
    far = legs(fore_left=(10, 5), fore_right=(50, 1))  # a far limb stands higher
    near = legs(fore_left=(30, 4), fore_right=(30, 1))
    assert animate_drawing((far, near), WALK, 8, 32).lifted == ()


def test_cycles_in_a_row():
    done = animate_drawing(poses("fish"), SWIM, 6, 32).morph
    three = repeat_cycle(done, 3)
    assert len(three.tau) == 18
    assert (three.layers["tail"][12:] == done.layers["tail"]).all()
    assert done.tau[0] == 0 and done.tau[3] == 1 and done.tau[-1] < done.tau.max()


# --- limbs of several contours

SHIN = np.array([[0, 0], [10, 0], [11, 15], [9, 30], [0, 30]], float)
PAW = np.array([[0, 30], [9, 30], [20, 34], [20, 40], [0, 40]], float)  # has an edge of the shin


def bend(points: np.ndarray, degrees: float, at: tuple[float, float]) -> np.ndarray:
    """Bend a leg the more the lower it is, and hang it at a place."""
    angle = np.radians(degrees) * (0.4 + points[:, 1] / 40)
    x, y = points.T
    turned = [x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)]
    return np.stack(turned, axis=1) + at


def grouped_legs(degrees: float, *, ids: tuple[str, ...] = ("shin", "paw")) -> Drawing:
    """Draw two legs, each a group of a shin and a paw; the right one swings the other way."""
    curves, groups = dict[str, Curve](), dict[str, tuple[str, ...]]()
    for side, sign, x in (("left", 1, 30), ("right", -1, 70)):
        for part, outline in zip(ids, (SHIN, PAW), strict=True):
            dense = resample_curve(Curve(outline, True), 400).points
            name = f"{part}_{side}" if part in ("shin", "paw") else f"{part}{side[0]}"
            curves[name] = Curve(bend(dense, sign * degrees, (x, 5)), True)
            groups[name] = ("part", f"fore_{side}", "dog")
    return Drawing(curves, 100, 60, groups=groups)


def seam_gaps(layers: dict[str, np.ndarray], shin: str, paw: str, frames: int) -> np.ndarray:
    """Return how far a paw is off its shin in every frame, px, along the edge that both share."""
    gaps = []
    for frame in range(frames):
        dense = resample_curve(Curve(layers[shin][frame], True), 4000).points
        apart = np.linalg.norm(layers[paw][frame][:, None] - dense, axis=-1).min(axis=1)
        gaps.append(apart)
    return np.array(gaps)


@pytest.mark.parametrize("ids", [("shin", "paw"), ("x", "y")])
def test_a_paw_stays_at_its_leg_and_the_leg_on_its_paw(ids):
    uneven = {"A": (-0.8, 0.6, -0.4, 0.5), "B": (0.9, -0.5, 0.3, 0.2)}  # γ for each scale
    gait = replace(WALK, gamma={"fore_left": uneven, "fore_right": uneven})
    one, two = grouped_legs(18, ids=ids), grouped_legs(-25, ids=ids)
    done = animate_drawing((one, two), gait, 16, 128)
    layers = done.morph.layers
    assert list(layers) == list(one.curves)
    for shin, paw in zip(list(layers)[::2], list(layers)[1::2], strict=True):
        gaps = seam_gaps(layers, shin, paw, 16)
        on_seam = (gaps[[0, 4, 8, 12]] < 0.05).all(axis=0)  # in the key frames
        assert 8 < on_seam.sum() < 40
        assert gaps[:, on_seam].max() < 0.1
    assert set(done.after.slide) == {"fore_left", "fore_right"}
    assert max(done.after.slide.values()) < min(done.before.slide.values()) / 10
    lowest = max(layers[name][[0, 8], :, 1].max() for name in layers)
    assert lowest == max(layers[name][..., 1].max() for name in list(layers)[1::2])
    half = np.arange(8)
    for left, right in zip(list(layers)[:2], list(layers)[2:], strict=True):
        there = layers[right][half + 8] - layers[right][8] + layers[left][0]
        assert np.abs(layers[left][half] - there).max() < 0.02


def test_contours_without_a_carrier_keep_their_shape():
    """A patch that floats beside its leg moves as one piece."""
    one, two = (grouped_legs(degrees) for degrees in (18, -25))
    far = replace(WALK, support={})
    for drawing, degrees in ((one, 18), (two, -25)):
        for side, sign, x in (("left", 1, 30), ("right", -1, 70)):
            t = 2 * np.pi * np.arange(60) / 60
            place = bend(np.array([[5.0, 20.0]]), sign * degrees, (x, 5)) + [14, 0]
            patch = place + 2 * np.stack([np.cos(t), np.sin(t)], axis=1)
            drawing.curves[f"patch_{side}"] = Curve(patch, True)
            drawing.groups[f"patch_{side}"] = (f"fore_{side}", "dog")
    patch = animate_drawing((one, two), far, 16, 64).morph.layers["patch_left"]
    radius = np.linalg.norm(patch - patch.mean(axis=1, keepdims=True), axis=-1)
    assert radius == pytest.approx(np.full(radius.shape, 2), abs=0.15)


def test_the_contours_of_one_path_are_one_limb():
    one, two = (
        Drawing(
            {**drawing.curves, "fore_left#2": Curve(drawing.curves["fore_left"].points[::-1] * 1.0, True)},
            100, 60,
        )
        for drawing in (legs(fore_left=(10, 5)), legs(fore_left=(30, 5)))
    )  # fmt: skip
    layers = animate_drawing((one, two), WALK, 16, 32).morph.layers
    middles = [layers[name].mean(axis=1) for name in ("fore_left", "fore_left#2")]
    assert middles[0] == pytest.approx(middles[1], abs=0.1)


def test_left_and_right_limbs_have_the_same_contours():
    one = grouped_legs(18, ids=("x", "y"))
    for part in (one.curves, one.groups):
        del part["yr"]
    with pytest.raises(FinloopError, match="'fore_left' has 2 contours, 'fore_right' 1"):
        animate_drawing((one, one), WALK, 8, 32)


def test_a_gradient_turns_with_its_limb_and_colours_follow_the_keys():
    red, blue = (255, 0, 0), (0, 0, 255)
    gradient = Gradient("linear", (Stop(0, red, 1), Stop(1, blue, 1)), (10, 0, 0, 40, 0, 0))
    keys = []
    for degrees, stroke in ((0, red), (20, blue)):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        fill = replace(gradient, matrix=(10 * c, 10 * s, -40 * s, 40 * c, 30, 5))
        paint = Paint(fill, stroke, 1, 1, 2)
        curve = Curve(rotate(BOOT, degrees) + [30, 5], True)
        keys.append(Drawing({"fore_left": curve}, 100, 60, {"fore_left": paint}))
    done = animate_drawing(keys, replace(WALK, support={}), 8, 64).morph
    paints = done.styles["fore_left"]
    assert [paint.stroke for paint in paints[::2]] == [red, blue, red, blue]
    assert paints[1].stroke == mix_colours(red, blue, 0.5)
    for k in (0, 2, 4, 6):
        wanted = keys[k % 4 // 2].styles["fore_left"].fill.matrix
        assert paints[k].fill.matrix == pytest.approx(wanted, abs=0.3)


# --- correspondence


@pytest.mark.parametrize("degrees", [0, 35, -60])
def test_a_turned_contour_is_numbered_alike(degrees):
    model = renumber_curve(np.zeros((64, 2)), Curve(BOOT, True))
    other = rotate(np.roll(BOOT, 2, axis=0) * 1.2, degrees) + [300, -20]
    found = renumber_curve(model, Curve(other[::-1], True))
    assert found == pytest.approx(rotate(model * 1.2, degrees) + [300, -20], abs=0.5)


def test_a_contour_may_start_between_the_points_of_another():
    model = renumber_curve(np.zeros((64, 2)), Curve(BOOT, True))
    dense = resample_curve(Curve(model, True), 64 * 8).points
    found = renumber_curve(model, Curve(np.roll(dense, -4, axis=0), True))
    assert np.abs(found - model).mean() < 0.15  # half a step is 0.9


def test_left_and_right_limbs_are_numbered_alike():
    left = Curve(rotate(BOOT, 20), True)
    right = Curve(np.roll(rotate(BOOT, -15), 3, axis=0)[::-1] + [50, 0], True)
    pair = Drawing({"fore_left": left, "fore_right": right}, 100, 60)
    first, second = match_key_poses((pair, pair), "swap", 64)
    assert rotate(first["fore_right"] - [50, 0], 35) == pytest.approx(first["fore_left"], abs=0.7)
    assert second == {name: pytest.approx(points) for name, points in first.items()}


def test_a_round_eye_does_not_turn():
    t = 2 * np.pi * np.arange(40) / 40
    eye = np.stack([np.cos(t), np.sin(t)], axis=1)
    model = renumber_curve(np.zeros((32, 2)), Curve(eye, True))
    assert np.abs(renumber_curve(model, Curve(np.roll(eye, 7, axis=0), True)) - model).max() < 0.1


def test_an_open_contour_may_be_drawn_from_either_end():
    line = np.array([[0, 0], [10, 3], [30, 0]], float)
    model = renumber_curve(np.zeros((16, 2)), Curve(line, False))
    other = renumber_curve(model, Curve(rotate(line[::-1], 40), False))
    assert other == pytest.approx(rotate(model, 40))


def test_mirror_orders_find_the_other_side_of_a_turned_tail():
    """A fork lies along the axis, turned by 30° to one side, then to the other."""
    fork = np.array([[0, 5], [-40, 14], [-30, 0], [-40, -14], [0, -5]], float)
    key = renumber_curve(np.zeros((64, 2)), Curve(fork, True))
    one, two = rotate(key, 30), rotate(key, -20)
    order = mirrored_point_orders({"tail": one}, {"tail": two}, {"tail": True})["tail"]
    assert mirror_contours(one, 0.0, order) == pytest.approx(rotate(key, -30), abs=1.5)


# --- the ground


def boot_cycle(slip: float, sink: float) -> np.ndarray:
    """A boot (16, 6, 2) whose foot goes back by 2 a frame for half a cycle, and slips and sinks."""
    k = np.arange(17)
    x = np.where(k <= 8, -2.0 * k + slip * np.sin(np.pi * k / 8), -16 + 2.0 * (k - 8))
    y = np.where(k <= 8, sink * np.sin(np.pi * k / 8), -5 * np.sin(np.pi * (k - 8) / 8))
    return (BOOT + np.stack([x, y], axis=1)[:, None])[:16]


def test_supports_are_whole_frames_with_both_ends():
    assert [run.tolist() for run in support_frames(((0.0, 0.5), (0.75, 1.25)), 8)] == [
        [0, 1, 2, 3, 4], [6, 7, 8, 9, 10],
    ]  # fmt: skip
    assert support_frames(((0.3, 0.31),), 8) == []


def test_a_foot_drawn_with_an_open_line_counts_too():
    """Its upper part becomes shorter, so the points run along the line."""
    drawn = [BOOT[1:5] + [[1.5 * k, 2 * k * (i == 0)] for i in range(4)] for k in range(5)]
    legs = np.stack([resample_curve(Curve(points, False), 64).points for points in drawn])
    assert foot_displacement(legs)[-1] == pytest.approx(6, abs=0.3)


def test_a_foot_that_rolls_does_not_slide():
    """The toe stays where it is, the heel rises."""
    boot = resample_curve(Curve(BOOT, True), 256).points
    toe = boot[np.argmax(boot @ [1, 1])]
    rolls = np.stack([rotate(boot - toe, degrees) for degrees in np.linspace(0, 20, 9)])
    assert abs(foot_displacement(rolls)[-1]) < 1 < abs(np.ptp(rolls[..., 0].mean(axis=1)))


def test_a_good_foot_is_left_alone():
    stack = boot_cycle(0, 0)
    found = measure_ground({"foot": stack}, {"foot": FIRST})
    assert found.speed == pytest.approx(-2)
    assert found.slide["foot"] == pytest.approx(0, abs=1e-9)
    assert plant_feet({"foot": stack}, {"foot": FIRST})["foot"] == pytest.approx(stack)
    assert plant_feet({"tail": stack}, {"foot": FIRST})["tail"] is stack
    assert measure_ground({"tail": stack}, {"foot": FIRST}) == (0.0, {})


def test_a_bad_foot_is_mended_and_its_hip_is_not_moved():
    stack, good = boot_cycle(3, 2), boot_cycle(0, 0) + [1, 0]
    limbs, support = {"foot": stack, "good": good}, {"foot": FIRST, "good": FIRST}
    before = measure_ground(limbs, support)
    done = plant_feet(limbs, support)
    assert before.slide["foot"] > 2.5
    foot = done["foot"]
    # Measured apart from `measure_ground`: the heel, which is the last point, in the frames on the ground.
    assert np.diff(foot[:9, -1, 0]) == pytest.approx(before.speed, abs=1e-9)
    assert foot[:9, :, 1].max(axis=1) == pytest.approx(foot[0, :, 1].max())
    assert foot[..., 1].max() <= foot[0, :, 1].max() + 1e-9
    assert foot[:, :2] == pytest.approx(stack[:, :2], abs=1e-9)
    assert np.ptp(foot[:, 2:, 0] - stack[:, 2:, 0], axis=1).max() < 0.7  # the boot keeps its shape


def test_the_correction_fades_over_the_swing():
    """One foot goes back by 2 a frame, one by 3: both end up wrong by 4, to either side."""
    limbs = {"slow": boot_cycle(0, 0), "fast": boot_cycle(0, 0) * [1.5, 1]}
    done = plant_feet(limbs, dict.fromkeys(limbs, FIRST))
    moved = (done["slow"] - limbs["slow"])[:, -1, 0]
    assert moved[[0, 8]] == pytest.approx([2, -2], rel=0.05)
    swing = np.diff(moved[np.arange(8, 17) % 16])
    assert (swing > 0).all() and swing.max() < 1


def test_a_swing_does_not_dip_into_the_ground():
    stack = boot_cycle(0, 0)
    stack[10:14, :, 1] += 12
    done = plant_feet({"foot": stack}, {"foot": FIRST})["foot"]
    assert stack[..., 1].max() > 45 and done[..., 1].max() == pytest.approx(40)


# --- bad input


def line(*points: tuple[float, float], closed: bool = False) -> Drawing:
    return Drawing({"fore_left": Curve(np.array(points, float), closed)}, 100, 60)


@pytest.mark.parametrize(
    ("one", "two", "says"),
    [
        (legs(fore_left=(1, 1)), legs(hind_left=(1, 1)), "'fore_left' only in the first"),
        (line((0, 0), (9, 9), (5, 0), closed=True), line((0, 0), (9, 9), (5, 0)), "closed in the first"),
        (line((0, 5), (9, 5)), line((0, 5), (9, 5)), "'fore_left' has no height"),
        (line((0, 5), (3, 9)), line((0, 5), (9, 5.01)), "'fore_left' has no height"),
    ],
)  # fmt: skip
def test_poses_that_do_not_fit_are_named(one, two, says):
    with pytest.raises(FinloopError, match=says):
        animate_drawing((one, two), WALK, 8, 32)


def test_a_pair_must_be_of_one_kind():
    open_one = Curve(np.array([[0, 0], [9, 9], [5, 20]], float), False)
    pair = Drawing({"fore_left": Curve(BOOT, True), "fore_right": open_one}, 100, 60)
    with pytest.raises(FinloopError, match="is closed, the other open"):
        animate_drawing((pair, pair), WALK, 8, 32)
    with pytest.raises(FinloopError, match="curve of 100 points"):
        animate_drawing(poses("fish"), SWIM, 8, 100, 4)
