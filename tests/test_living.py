"""The living tank: its pictures without animals, their order, its light, and what is drawn on it.

Films are drawn here: a tank with a gradient, noise that is new at each frame, a dark disc for an
animal, and a lamp that flickers.
"""

import numpy as np
import pytest

from finloop.extract.grain import choose_spans, empty_tank_pictures
from finloop.render.living import LivingTank
from finloop.render.painter import Painter, PlacedFish, TurnedPicture, pad_picture
from finloop.tank.camera import TankSize
from finloop.tank.light import LitFloor

COUNT, HEIGHT, WIDTH, NOISE = 40, 96, 128, 3.0
TANK = np.tile(np.linspace(120, 180, WIDTH), (HEIGHT, 1)).round().astype(np.uint8)
Y, X = np.mgrid[:HEIGHT, :WIDTH]


def film(paths, noise=NOISE, gains=None, tank=TANK, count=COUNT):
    """Frames of discs of 8 px that move along paths (count, 2), in a light of `gains` (count,)."""
    rng = np.random.default_rng(0)
    gains = np.ones(count) if gains is None else gains
    frames = []
    for tick in range(count):
        frame = tank + rng.normal(0, noise, tank.shape)
        for path in paths:
            x, y = path[tick]
            frame[(X - x) ** 2 + (Y - y) ** 2 <= 64] = 40
        frames.append(np.clip(np.rint(frame * gains[tick]), 0, 255).astype(np.uint8))
    return frames


def across():
    """A path that crosses the tank; it covers no place for more than a third of the film."""
    return np.column_stack([np.linspace(20, 108, COUNT), np.full(COUNT, 48.0)])


def pictures_of(frames, tank=TANK, threshold=15.0):
    return empty_tank_pictures(frames, tank, threshold, length_px=16.0)


@pytest.mark.parametrize("colour", [False, True])
def test_pictures_show_the_tank_with_its_noise_and_neither_animal_nor_flicker(colour):
    gains = 1 + 0.05 * np.sin(np.arange(COUNT))
    frames, tank = film([across()], gains=gains), TANK
    if colour:
        frames, tank = [np.dstack([frame] * 3) for frame in frames], np.dstack([TANK] * 3)
    found = pictures_of(frames, tank)
    assert not found.lack and found.pictures.shape == (COUNT, *tank.shape)
    change = found.pictures.astype(float) - tank
    assert np.abs(change.mean(axis=0)).max() < 3  # 5 standard errors; the disc is 100 darker
    assert np.abs(change).max() < 6 * NOISE
    assert found.grain_grey == pytest.approx(NOISE, rel=0.05)
    assert np.abs(change.mean(axis=(1, 2) if not colour else (1, 2, 3))).max() < 0.6  # no flicker
    # Where the disc was, the tank lives as elsewhere.
    band = change.std(axis=0)[44:52].mean()
    assert band == pytest.approx(change.std(axis=0)[:16].mean(), rel=0.1)


def test_a_place_that_an_animal_always_covers_has_the_grain_of_the_mirrored_place():
    resting = np.tile([30.0, 48.0], (COUNT, 1))
    found = pictures_of(film([resting]))
    change = found.pictures.astype(float) - TANK
    there, mirrored = change[:, 48, 30], change[:, 48, WIDTH - 1 - 30]
    assert there.std() > NOISE / 2 and np.corrcoef(there, mirrored)[0, 1] > 0.9
    assert np.abs(change).max() < 6 * NOISE


def test_a_film_that_shows_no_grain_says_why():
    assert "no grain" in pictures_of(film([across()], noise=0.0)).lack
    assert "only 3 frames" in pictures_of(film([across()])[:3]).lack
    assert len(pictures_of(film([across()])[:3]).pictures) == 0
    white = [np.full_like(TANK, 255)] * COUNT  # a light that saturates
    assert pictures_of(white).lack
    covering = [np.where(X < 80, 40, frame).astype(np.uint8) for frame in film([])]
    assert "hidden" in pictures_of(covering).lack


def test_light_that_saturates_for_some_frames_leaves_no_flash():
    gains = np.where(np.arange(COUNT) % 10 == 0, 1.5, 1.0)  # beyond 170 all is white
    found = pictures_of(film([across()], gains=gains))
    assert not found.lack
    assert np.abs(found.pictures.astype(float) - TANK).max() < 6 * NOISE
    assert found.grain_grey == pytest.approx(NOISE, rel=0.05)


def test_a_black_tank_keeps_its_grain():
    black = np.full_like(TANK, 8)
    found = pictures_of(film([], tank=black), black)
    assert found.grain_grey == pytest.approx(NOISE, rel=0.05)


def test_spans_lie_within_a_segment_and_are_bounded_in_pictures_and_bytes():
    small, large = (480, 640), (1080, 1920, 3)
    for shape in (small, large):
        spans = choose_spans([(0, 100), (100, 4000)], shape)
        start, stop = spans[0]
        assert 100 <= start < stop <= 4000 and 8 <= stop - start <= 128
        assert (stop - start) * np.prod(shape) <= 2**26
    assert choose_spans([(0, 1), (1, 7)], small) == []
    assert choose_spans([(0, 100)], (20_000, 20_000, 3)) == []


def noise_pictures(count=24, share=0.0):
    """Pictures of noise, each with a share of the one before."""
    rng = np.random.default_rng(1)
    levels = [rng.normal(0, 1, (40, 50))]
    for _ in range(count - 1):
        levels.append(share * levels[-1] + (1 - share**2) ** 0.5 * rng.normal(0, 1, (40, 50)))
    return [np.rint(128 + 20 * level).astype(np.uint8) for level in levels]


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_pictures_follow_in_the_films_order_or_jump_to_one_that_is_as_like(share):
    pictures = noise_pictures(share=share)
    tank, again = LivingTank(pictures), LivingTank(pictures)
    order = [tank.number_at(tick) for tick in range(600)]
    assert order[::-1] == [again.number_at(tick) for tick in reversed(range(600))]
    assert set(order) == set(range(24))
    steps = np.diff(order)
    assert np.abs(steps).min() > 0 and np.mean(np.abs(steps) == 1) > 0.7
    level = np.stack(pictures).astype(float)
    natural = np.median(np.sqrt(((level[1:] - level[:-1]) ** 2).mean(axis=(1, 2))))
    shown = level[order]
    change = np.sqrt(((shown[1:] - shown[:-1]) ** 2).mean(axis=(1, 2)))
    assert change.max() < 1.35 * natural
    if share < 0.5:  # new at each frame: a picture is not followed by the same one for ever
        follows = {number: set() for number in range(24)}
        for now, then in zip(order, order[1:], strict=False):
            follows[now].add(then)
        assert np.mean([len(after) for after in follows.values()]) > 3


def test_a_jump_leads_to_no_picture_that_was_shown_just_before():
    tank = LivingTank(noise_pictures())
    order = [tank.number_at(tick) for tick in range(400)]
    for tick in range(13, 400):
        if abs(order[tick] - order[tick - 1]) != 1:
            assert order[tick] not in order[tick - 12 : tick]


@pytest.mark.parametrize("count", [1, 2])
def test_a_tank_of_one_or_two_pictures_lives_for_ever(count):
    pictures = noise_pictures(count)
    tank = LivingTank(pictures)
    assert {tank.number_at(tick) for tick in range(50)} == set(range(count))


def test_the_light_is_the_films_forward_and_back():
    tank = LivingTank([TANK], np.array([1.0, 1.1, 0.9]))
    assert [tank.light_at(tick) for tick in range(6)] == [1.0, 1.1, 0.9, 1.1, 1.0, 1.1]


def disc():
    alpha = np.where((X[:21, :21] - 10) ** 2 + (Y[:21, :21] - 10) ** 2 <= 64, 255, 0)
    return np.dstack([np.full_like(alpha, 30) * (alpha > 0), alpha]).astype(np.uint8)


def fish_at(x, y):
    return PlacedFish(x, y, TurnedPicture(pad_picture(disc(), 10.0, 10.0)), None, 0.0)


@pytest.mark.parametrize("colour", [False, True])
def test_a_painter_draws_fish_on_the_present_picture_and_leaves_no_trace(colour):
    pictures = noise_pictures()
    tank = LivingTank(pictures)
    painter = Painter(pictures[0], colour=colour, tank=tank)
    for tick in range(12):
        painter.show(fish_at(8 + 3 * tick, 20), tick=tick)
        frame = painter.frame[..., 0] if colour else painter.frame
        floor = tank.picture_at(tick)
        covered = (X[:40, :50] - 8 - 3 * tick) ** 2 + (Y[:40, :50] - 20) ** 2 <= 64
        assert (frame[covered] == 30).all() and (frame[~covered] == floor[~covered]).all()


def test_beneath_a_cut_out_the_tank_stands_still_in_the_light_around():
    """So grain is not seen twice, and a fish is as bright as a tank that is lit up beside it."""
    rng = np.random.default_rng(4)
    brighter = np.clip(1.1 * TANK + rng.normal(0, 3, TANK.shape), 0, 255).astype(np.uint8)
    pixels = disc()
    pixels[..., 1] = np.maximum(pixels[..., 1], 1)  # with a residue that is hardly seen around it
    painter = Painter(TANK, tank=LivingTank([brighter]))
    fish = PlacedFish(50.0, 50.0, TurnedPicture(pad_picture(pixels, 10.0, 10.0)), None, 0.0)
    painter.show(fish)
    box = np.s_[40:61, 40:61]
    light = brighter[box].mean() / TANK[box].mean()
    expected = light * (pixels[..., 0] + (1 - pixels[..., 1] / 255) * TANK[box])
    assert np.abs(painter.frame[box] - expected).max() < 1
    outside = np.ones(TANK.shape, bool)
    outside[box] = False
    assert np.array_equal(painter.frame[outside], brighter[outside])


def test_the_films_light_falls_on_tank_and_fish():
    tank = LivingTank([TANK], np.array([1.0, 1.2, 0.5]))
    painter, still = Painter(TANK, tank=tank), Painter(TANK)
    for tick in range(4):
        painter.show(fish_at(50, 50), tick=tick)
        still.show(fish_at(50, 50))
        expected = np.clip(still.frame * tank.light_at(tick), 0, 255)
        assert np.abs(painter.frame - expected).max() <= 0.5 + 1e-6


def test_the_floor_in_three_dimensions_lives_as_the_tank_does():
    pictures = noise_pictures()
    tank = LivingTank(pictures, np.array([1.0, 0.5]))
    size = TankSize(50, 40, depth=20, body_length=10, aspect=1.25)
    living, still = LitFloor(pictures[0], size, tank), LitFloor(pictures[0], size)
    assert (living.draw_floor([], 2.0, tick=0) == still.draw_floor([], 2.0)).all()
    shown = living.draw_floor([], 2.0, tick=1).astype(float)
    expected = LitFloor(tank.picture_at(1), size).draw_floor([], 2.0) / 2
    assert np.abs(shown - expected).max() <= 1
