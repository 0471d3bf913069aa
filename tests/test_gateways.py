"""Gateways: laws on a drawn fish whose every pose is known, in both poses of the pictures.

y is down; angles are degrees, anticlockwise as seen. A fish is a head that points along its
heading and a tail that bends off it; track 1 is track 0 in a mirror, track 2 resembles nothing.
"""

from contextlib import contextmanager
from dataclasses import replace

import cv2
import numpy as np
import pandas as pd
import pytest
from conftest import TINY_CARP
from constants import with_constants
from scipy.spatial.distance import cdist
from scratch import content, prepare, put_clip
from toy_fish import mass_centre

import stages.gateways
import stages.plots.gateways
from finloop.base.cutout import Cutout
from finloop.distance.map import STEPS, MapFacts
from finloop.distance.picture import BODY, FILM, draw_centred_cutout, successive_distances
from finloop.distance.reel import Reel
from finloop.features.table import FEATURES, find_orientations, wrap_deg
from finloop.gateways import find
from finloop.io.cutouts import CutoutWriter, open_cutouts
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture
from finloop.io.record import save_record
from finloop.io.table import load_table, save_table
from finloop.plots import gateways as gateways_plots
from finloop.plots.gateways import draw_gateways, gateway_pictures
from finloop.plots.loops import spread_table_rows
from finloop.sprites.orient import SPRITES, sprite_cutouts

ORIENTATIONS = 24  # conf/features/default.yaml

RATE, DELTA, LENGTH, SIZE, FRAMES = 20.0, 4, 60.0, 48, 60
SETTINGS = find.GatewaysSettings(frames_per_sprite=12, sprites_per_frame=3, distance_threshold=1.2)


# -- a toy film -------------------------------------------------------------------------------------


def fish(heading, bend):
    """A premultiplied cut-out (130, 130, 2) of a fish, its head in the middle, bent by `bend`°."""
    share = np.linspace(0, 1, 25)
    along = np.radians(heading - bend * np.clip(share - 1 / 3, 0, 1) * 1.5)
    step = -LENGTH / 24 * np.stack([np.cos(along), -np.sin(along)], 1)
    line = np.vstack([[0, 0], np.cumsum(step, 0)]) + 64
    alpha, light = np.zeros((2, 130, 130), np.uint8)
    for at, (a, b) in enumerate(zip(line[:-1], line[1:], strict=True)):
        ends = [tuple(np.round(64 * end).astype(int).tolist()) for end in (a, b)]
        cv2.line(alpha, *ends, 255, max(2, 12 - at // 2), cv2.LINE_AA, 6)
    cv2.circle(light, (64, 64), 9, 200, -1, cv2.LINE_AA)
    return np.dstack([np.minimum(alpha, 60 + light // 2), alpha])


def poses():
    """track, heading, bend of every frame; no two poses of a track are alike."""
    t = np.arange(FRAMES)
    heading, bend = wrap_deg(40 + 3.1 * t), 70 * np.sin(0.45 * t) * (1 - t / 90)
    odd = np.full(FRAMES, 5.0), np.linspace(100, 150, FRAMES)
    for track, (h, b) in enumerate([(heading, bend), (wrap_deg(-heading), -bend), odd]):
        yield from ((track, at, h[at], b[at]) for at in t)


def feature_table():
    rows, cutouts = [], []
    for track, frame, heading, bend in poses():
        pixels = fish(heading, bend)
        x, y = mass_centre(pixels[..., 1].astype(float))
        cutouts.append(Cutout(track, frame, 10 + frame, 20, pixels))
        rows.append((track, frame, 10 + frame + x, 20 + y, heading))
    table = pd.DataFrame(rows, columns=["track_id", "frame", "x_px", "y_px", "heading_deg"])
    table["heading_deg"] = table["heading_deg"].astype(np.float32)
    table["orientation"] = find_orientations(table["heading_deg"].to_numpy(), ORIENTATIONS)
    table["orientations"] = ORIENTATIONS
    table["body_length_px"] = LENGTH
    table = table.reindex(columns=FEATURES.names, fill_value=0)
    last = table["frame"] >= FRAMES - DELTA
    table["displacement"] = np.where(last, np.nan, 0.0)
    return table.astype(FEATURES.pandas_dtypes), cutouts


def sprite_rows(features, picked, off=0.0, mirrored=False, sequence="straight"):
    """Rows of SPRITES of rows of the feature table; drawn by a line `off` degrees off the head."""
    side = -1 if mirrored else 1
    of = features.iloc[picked]
    heading = of["heading_deg"].to_numpy() - off
    after = features["heading_deg"].to_numpy()[np.minimum(np.array(picked) + 1, len(features) - 1)]
    return pd.DataFrame(
        {
            "sequence": sequence, "step": np.arange(len(picked)), "phase": "cycle", "row": picked,
            "track_id": of["track_id"].to_numpy(), "frame": of["frame"].to_numpy(),
            "mirrored": mirrored, "x_px": of["x_px"].to_numpy(), "y_px": of["y_px"].to_numpy(),
            "heading_deg": wrap_deg(heading), "head_offset_deg": side * off, "scale": 1.0,
            "motion_area_rel": 0.1, "bend": 0.0, "forward": 0.0, "sideways": 0.0,
            "turn_deg": side * wrap_deg(after - off - heading), "orientations": ORIENTATIONS,
        }
    )  # fmt: skip


def whole(*parts):
    table = pd.concat(parts, ignore_index=True)
    table.insert(0, "sprite", np.arange(len(table)))
    return table[SPRITES.names].astype(SPRITES.pandas_dtypes)


class World:
    """A film, sprites cut from it, and everything near everything."""

    def __init__(self, folder, features, cutouts, sprites, pose=BODY):
        self.features, self.sprites, self.pose = features, sprites, pose
        with CutoutWriter(folder / "sprites.arrow", sprites=True) as writer:
            for one in sprite_cutouts(sprites, cutouts):
                writer.write(one)
        with CutoutWriter(folder / "cutouts.arrow") as writer:
            for one in cutouts:
                writer.write(one)
        self.folder = folder
        with self.open() as (store, film):
            self.near = find.measure_sprite_distances(
                self.reel(store, film), np.arange(len(features)), SIZE, pose
            )
            self.step = float(np.median(successive_distances(self.film(film))[: FRAMES - 1]))

    @contextmanager
    def open(self):
        with (
            open_cutouts(self.folder / "sprites.arrow") as store,
            open_cutouts(self.folder / "cutouts.arrow") as film,
        ):
            yield store, film

    def reel(self, store, film):
        return Reel(self.features, film, self.sprites, store)

    def film(self, film, pose=None):
        rows = np.arange(len(self.features))
        return Reel(self.features, film).draw_rows(rows, SIZE, pose or self.pose)

    def table(self, **asked):
        settings = with_constants(SETTINGS, **asked)
        return find.list_gateways(self.near, self.sprites, self.features, self.step, settings)

    def ways(self, direction, **asked):
        table = self.table(**asked)
        return table[table["direction"] == direction]


@pytest.fixture(scope="module")
def film():
    return feature_table()


PICKED = [5, 6, 7, 20, 21, 33]
TURN = [40, 41, 42]


@pytest.fixture(scope="module")
def world(tmp_path_factory, film):
    """Straight sprites drawn 6° off their heads, a turn."""
    features, cutouts = film
    sprites = whole(
        sprite_rows(features, PICKED, off=6.0),
        sprite_rows(features, TURN, off=-4.0, sequence="left"),
    )
    return World(tmp_path_factory.mktemp("world"), features, cutouts, sprites)


@pytest.fixture(scope="module")
def film_world(tmp_path_factory, film):
    """The same as filmed; headings of the sprites are their orientations'."""
    features, cutouts = film
    exact = features.assign(heading_deg=15.0 * np.round(features["heading_deg"] / 15))
    sprites = whole(sprite_rows(exact, PICKED), sprite_rows(exact, TURN, sequence="left"))
    return World(tmp_path_factory.mktemp("filmed"), features, cutouts, sprites, FILM)


# -- ways in and out --------------------------------------------------------------------------------


def test_a_sprite_leads_first_to_the_frame_that_came_after_it(world):
    first = world.ways(find.IN)[lambda t: t["rank"] == 1]
    assert list(first["row"]) == [row + 1 for row in PICKED + TURN]
    assert (first["distance"] == 0).all()
    assert (first["orientation"] == 0).all()  # in the pose BODY it does not matter
    # The film turned as the sprite was: by its line, not by its head.
    np.testing.assert_allclose(first["turn_deg"], -world.sprites["heading_deg"], atol=1e-4)


def test_the_frame_before_a_sprite_s_own_leads_first_to_it(world):
    first = world.ways(find.OUT)[lambda t: t["rank"] == 1].set_index("row")
    for sprite, row in enumerate([*PICKED, TURN[0]]):
        assert first.loc[row - 1, "sprite"] == sprite
        assert first.loc[row - 1, "distance"] < 0.3 * world.step  # turned twice: a little soft
        drawn_deg = world.sprites["heading_deg"][sprite]
        assert first.loc[row - 1, "turn_deg"] == pytest.approx(-drawn_deg, abs=1e-3)


@pytest.mark.parametrize("name", ["world", "film_world"])
@pytest.mark.parametrize("direction", [find.IN, find.OUT])
def test_turned_by_turn_deg_the_film_fits_the_sprite_as_drawn(name, direction, request):
    """Eq. 5 as it looks, in whatever orientation the sprite is drawn."""
    of = request.getfixturevalue(name)
    number = 8
    drawn_deg = (number - 1) * 15.0
    ways = of.ways(direction)
    assert len(ways) > 20
    with of.open() as (store, film):
        if direction == find.IN:  # drawn in that orientation after the sprite has turned on
            shown = of.reel(store, film).draw_frames_after_sprites(SIZE, number)
            drawn_deg = drawn_deg - of.sprites["turn_deg"].to_numpy()
        else:
            shown = of.reel(store, film).draw_sprites(SIZE, number)
            drawn_deg = np.full(len(of.sprites), drawn_deg)
        for way in ways.iloc[:: max(1, len(ways) // 40)].itertuples():
            row = way.row + (direction == find.OUT)
            turn = drawn_deg[way.sprite] + way.turn_deg
            turned = draw_centred_cutout(
                film[row], of.features.loc[row, ["x_px", "y_px"]], LENGTH, SIZE, turn
            )
            far = np.linalg.norm(turned - shown[way.sprite])
            assert far == pytest.approx(way.distance, abs=0.25 * of.step)


@pytest.mark.parametrize("name", ["world", "film_world"])
def test_every_distance_is_that_of_the_two_pictures(name, request):
    of = request.getfixturevalue(name)
    number = np.maximum(of.near.orientation, 1)
    with of.open() as (store, film):
        shown = of.film(film).reshape(len(of.features), -1).astype(float)
        for one in np.unique(number):
            sides = find.draw_sprites_and_next(of.reel(store, film), SIZE, of.pose, int(one))
            given = of.near.from_next_frame, of.near.from_sprite
            for side, found in zip(sides, given, strict=True):
                want = cdist(side.reshape(len(side), -1), shown[number == one])
                np.testing.assert_allclose(found[:, number == one], want, atol=1e-4)


def test_as_filmed_a_sprite_meets_only_frames_of_its_orientation(film_world):
    table = film_world.table(distance_threshold=100.0)
    compared = table["row"] + (table["direction"] == find.OUT)
    assert (table["orientation"] == film_world.features["orientation"].to_numpy()[compared]).all()
    assert (table["orientation"] >= 1).all() and table["orientation"].nunique() > 5
    turned = np.where(
        table["direction"] == find.IN, film_world.sprites["turn_deg"][table["sprite"]], 0
    )
    want = wrap_deg(turned - 15.0 * (table["orientation"] - 1))
    np.testing.assert_allclose(wrap_deg(table["turn_deg"] - want), 0, atol=1e-4)


def test_as_filmed_too_a_sprite_leads_to_the_frame_after_it(film_world):
    ways = film_world.ways(find.IN)
    for sprite, row in enumerate(PICKED + TURN):
        number = film_world.features["orientation"][row + 1]
        best = ways[(ways["sprite"] == sprite) & (ways["orientation"] == number)].iloc[0]
        assert best["rank"] == 1 and best["row"] == row + 1
        assert best["distance"] < film_world.step


@pytest.mark.parametrize("threshold", [0.2, 0.7, 2.0])
def test_nothing_is_farther_than_the_threshold_and_nothing_nearer_is_lost(world, threshold):
    ways = world.ways(find.OUT, distance_threshold=threshold)
    most = threshold * world.step
    assert (ways["distance"] <= most).all()
    free = world.ways(find.OUT, distance_threshold=1e6)
    assert len(ways) == (free["distance"] <= most).sum() < len(free)


@pytest.mark.parametrize("apart", [0.0, 1.0, 2.5])
def test_frames_a_sprite_leads_to_are_apart(world, apart):
    ways = world.ways(
        find.IN, distance_threshold=1e6, min_deltas_between_frames=apart, frames_per_sprite=100
    )
    assert not ways.duplicated(["sprite", "row"]).any()
    least = max(1, apart * DELTA)
    for sprite, of in ways.groupby("sprite"):
        kept, distance = of["row"].to_numpy(), of["distance"].to_numpy()
        rows = np.sort(kept)
        same = np.diff(world.features["track_id"].to_numpy()[rows]) == 0
        assert np.diff(rows)[same].min() >= least
        # The nearest stay, and what is left out is near a nearer one.
        lasts = FRAMES - 1 - world.features["frame"].to_numpy() >= SETTINGS.min_deltas_ahead * DELTA
        for row in np.flatnonzero(lasts & ~np.isin(np.arange(len(lasts)), rows)):
            near = (np.abs(kept - row) < least) & (kept // FRAMES == row // FRAMES)
            nearest = distance[near].min(initial=np.inf)
            assert nearest <= world.near.from_next_frame[sprite, row] or len(of) == 100


@pytest.mark.parametrize("least", [0.0, 2.5, 10.0])
def test_frames_led_to_have_film_ahead(world, least):
    ways = world.ways(
        find.IN,
        distance_threshold=1e6,
        min_deltas_ahead=least,
        min_deltas_between_frames=0.0,
        frames_per_sprite=100,
    )
    left = FRAMES - 1 - world.features["frame"].to_numpy()[ways["row"]]
    assert left.min() >= least * DELTA
    if least > 5:  # the next frame of the sprites at 20, 21, 33, 40 has not so much left
        assert not (ways["row"] == 21).any()


def test_ranks_count_from_the_nearest(world):
    for direction, key, top in ((find.IN, "sprite", 12), (find.OUT, "row", 4 * 3)):
        ways = world.ways(direction, distance_threshold=1e6)
        for _, of in ways.groupby(key):
            assert list(of["rank"]) == list(range(1, len(of) + 1)) and len(of) <= top
            assert of["distance"].is_monotonic_increasing
    every = world.ways(find.OUT, distance_threshold=1e6)
    of_sequence = world.sprites["sequence"].to_numpy()[every["sprite"]]
    assert (every.groupby(["row", of_sequence]).size().groupby("row").max() <= 3).all()
    assert every.groupby("row")["sprite"].nunique().min() == 4  # three of the cycle, one turn
    few = world.ways(find.IN, distance_threshold=1e6, frames_per_sprite=4)
    assert (few.groupby("sprite").size() == 4).all()


def test_a_turn_is_entered_at_its_start_and_left_anywhere(world):
    turn = np.arange(len(PICKED), len(PICKED) + len(TURN))
    assert set(turn) <= set(world.ways(find.IN)["sprite"])
    ways = world.ways(find.OUT, distance_threshold=1e6, sprites_per_frame=100)
    assert set(ways["sprite"]) == set(range(len(PICKED) + 1))
    # The last frame of a track has no way out.
    assert set(ways["row"]) == {row for row in range(3 * FRAMES) if row % FRAMES != FRAMES - 1}


@pytest.mark.parametrize("pose", [BODY, FILM])
def test_a_mirrored_sprite_leads_to_the_mirror_of_what_came_after_it(tmp_path, film, pose):
    features, cutouts = film
    sprites = whole(sprite_rows(features, PICKED, off=6.0, mirrored=True))
    world = World(tmp_path, features, cutouts, sprites, pose)
    ways = world.ways(find.IN, distance_threshold=1e6, min_deltas_between_frames=0.0)
    for sprite, row in enumerate(PICKED):
        mirror = row + 1 + FRAMES  # the same frame of track 1
        of = ways[ways["sprite"] == sprite]
        if pose == FILM:
            of = of[of["orientation"] == features["orientation"][mirror]]
            assert mirror in set(of["row"]) and row + 1 not in set(of["row"])
            continue
        best = of.iloc[0]
        assert best["row"] == mirror and best["distance"] < 0.3 * world.step
        # Its line is the mirror of the sprite's, 6° to the other side of the head.
        want = wrap_deg(np.array(world.sprites["heading_deg"][sprite]))
        assert best["turn_deg"] == pytest.approx(want, abs=1e-3)
    if pose == BODY:  # and back: the frame before the mirrored one leads to it
        first = world.ways(find.OUT)[lambda t: t["rank"] == 1].set_index("row")
        assert [first.loc[row - 1 + FRAMES, "sprite"] for row in PICKED] == list(range(len(PICKED)))


def test_after_the_last_frame_of_a_track_comes_the_frame_itself(tmp_path, film):
    features, cutouts = film
    last = FRAMES - 1
    sprites = whole(sprite_rows(features, [last], off=6.0)).assign(turn_deg=3.0)
    world = World(tmp_path, features, cutouts, sprites)
    far = world.near.from_next_frame[0]
    assert far.argmin() == last and far[last] == 0
    assert world.near.next_frame_deg[0] == world.near.sprite_deg[0] == pytest.approx(6.0, abs=1e-3)


# -- the empty table, numbers -----------------------------------------------------------------------


def test_nothing_near_enough_gives_an_empty_table(world, tmp_path):
    none = world.table(distance_threshold=0.0, min_deltas_ahead=500.0)
    assert len(none) == 0
    save_table(tmp_path / "none.parquet", none, find.GATEWAYS)
    assert len(load_table(tmp_path / "none.parquet", find.GATEWAYS)) == 0
    nearest = world.table(distance_threshold=np.inf)
    found = find.gateway_metrics(none, nearest, world.near, world.features, RATE, world.step)
    assert found["ways_in"] == found["ways_out"] == found["film_rows_with_way_out_pct"] == 0
    assert found["sprites_in_orientations_without_way_in"] == len(world.sprites)
    assert found["nearest_in_steps"] == 0 < found["nearest_out_steps"]
    assert np.isnan(found["distance_in_median_steps"])


def test_numbers_count(world):
    table = world.table()
    nearest = world.table(distance_threshold=np.inf)
    found = find.gateway_metrics(table, nearest, world.near, world.features, RATE, world.step)
    ways_out = table[table["direction"] == find.OUT]
    assert found["ways_in"] + found["ways_out"] == len(table)
    assert found["sprites_in_orientations_without_way_in"] == 0
    rows = set(ways_out["row"])
    assert found["film_rows_with_way_out_pct"] == pytest.approx(100 * len(rows) / (3 * FRAMES))
    longest = 0
    for track in range(3):
        text = "".join("x" if track * FRAMES + t in rows else "-" for t in range(FRAMES))
        longest = max(longest, *map(len, text.split("x")))
    assert found["film_longest_without_way_out_s"] == pytest.approx(longest / RATE)
    assert 0 < found["distance_out_median_steps"] <= found["distance_out_p95_steps"] <= 1.2


# -- the contact sheet ------------------------------------------------------------------------------


def test_the_sheet_goes_from_the_best_to_the_worst(world):
    ways = world.ways(find.OUT)
    facts = MapFacts(world.pose, SIZE, 0.1, 1.5, world.step, world.step)
    with world.open() as (store, film):
        reel = world.reel(store, film)
        shown = [gateway_pictures(part, 5, reel, facts) for part in (ways, ways[:2], ways[:0])]
    some, two, none = (
        [float(pair.below.removesuffix(" steps")) for pair in pairs] for pairs in shown
    )
    steps = ways["distance"] / world.step
    assert some == sorted(some) and len(some) == 5
    assert some[0] == pytest.approx(steps.min(), abs=0.01)
    assert some[-1] == pytest.approx(steps.max(), abs=0.01)
    assert some[2] == pytest.approx(steps.median(), rel=0.2)
    assert len(two) == 2 and len(none) == 0


def test_ways_of_a_part_are_those_of_the_whole_that_compare_its_rows(world, film):
    """Every way out of a part of the film is one of the whole film, to a row of that part."""
    features, _ = film
    rows = np.arange(len(features))[len(features) // 4 : -3]
    with world.open() as (store, pictures):
        near = find.measure_sprite_distances(world.reel(store, pictures), rows, SIZE, world.pose)
    np.testing.assert_array_equal(near.from_sprite, world.near.from_sprite[:, rows])
    settings = replace(SETTINGS, distance_threshold=3.0)
    whole, some = (
        find.list_gateways(one, world.sprites, features, world.step, settings)
        for one in (world.near, near)
    )
    out = whole[(whole["direction"] == find.OUT) & np.isin(whole["row"] + 1, rows)]
    pd.testing.assert_frame_equal(
        some[some["direction"] == find.OUT].reset_index(drop=True), out.reset_index(drop=True)
    )
    leads_in = some[some["direction"] == find.IN]
    assert len(leads_in) and np.isin(leads_in["row"], rows).all()


@pytest.mark.parametrize("name", ["world", "film_world"])
def test_the_pictures_of_a_pair_are_those_compared(name, request, monkeypatch):
    monkeypatch.setattr(gateways_plots, "TILE", SIZE)
    of = request.getfixturevalue(name)
    facts = MapFacts(of.pose, SIZE, 0.1, 1.5, of.step, of.step)
    ways = [of.ways(way, distance_threshold=3.0) for way in (find.IN, find.OUT)]
    some = pd.concat([spread_table_rows(table.sort_values("distance"), 4) for table in ways])
    with of.open() as (store, film):
        reel = of.reel(store, film)
        shown = [pair for table in ways for pair in gateway_pictures(table, 4, reel, facts)]
    for pair, way in zip(shown, some.itertuples(), strict=True):
        assert pair.before.shape == (SIZE, SIZE, 2)
        far = np.linalg.norm(pair.natural - pair.instead)
        assert far == pytest.approx(way.distance, abs=1e-3)
        assert pair.below == f"{way.distance / of.step:.2f} steps"
        assert pair.above.startswith("film") == (way.direction == find.OUT)
    sheet = draw_gateways({find.IN: shown[:4], find.OUT: shown[4:]})
    assert sheet.shape == (4 * SIZE + 40, 12 * SIZE, 3) and sheet.std() > 5
    assert draw_gateways({find.IN: [], find.OUT: []}).shape == (40, 12 * SIZE, 3)


# -- the stage --------------------------------------------------------------------------------------


@pytest.fixture
def work(tmp_path, monkeypatch, world, film):
    features, _ = film
    put_clip(tmp_path, [np.zeros((32, 48), np.uint8)] * 4, rate=round(RATE))
    save_table(tmp_path / "data/features/features.parquet", features, FEATURES)
    save_table(tmp_path / "data/sprites/sprites.parquet", world.sprites, SPRITES)
    for folder, name in (("extract", "cutouts"), ("sprites", "sprites")):
        (tmp_path / "data" / folder).mkdir(exist_ok=True)
        (tmp_path / "data" / folder / f"{name}.arrow").write_bytes(
            (world.folder / f"{name}.arrow").read_bytes()
        )
    facts = MapFacts(BODY, SIZE, 0.1, 1.5, world.step, 2 * world.step)
    save_record(tmp_path / "data/distance/steps/facts.json", facts)
    same = dict.fromkeys(("step", "headed", "as_filmed"), world.step)
    steps = features[["track_id", "frame"]].assign(**same)
    save_table(tmp_path / "data/distance/steps/steps.parquet", steps, STEPS)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_stage_writes_table_sheet_and_metrics_the_same_each_time(work, world, capsys):
    prepare(work, *TINY_CARP, "gateways.sprites_per_frame=3")
    stages.gateways.main()
    stages.plots.gateways.main()
    table = load_table(work / "data/gateways/gateways.parquet", find.GATEWAYS)
    want = world.table()
    assert list(table["row"]) == list(want["row"])
    np.testing.assert_allclose(table["distance"], want["distance"], rtol=1e-5)
    metrics = load_numbers(work / "reports/gateways")
    assert metrics["ways_in"] + metrics["ways_out"] == len(table)
    assert load_picture(work / "reports/motion/gateways/contact_sheet.png").ndim == 3
    assert "no way" not in capsys.readouterr().err
    first = content(work / "data/gateways"), content(work / "reports/gateways")
    stages.gateways.main()
    assert (content(work / "data/gateways"), content(work / "reports/gateways")) == first


def test_stage_says_which_threshold_would_give_some(work, world, capsys, monkeypatch):
    # No sprite's own next frame has so much ahead: but for the odd track's, all are far.
    prepare(work, *TINY_CARP, "gateways.distance_threshold=0.01")
    monkeypatch.setattr(find.GatewaysSettings, "min_deltas_ahead", 14)
    stages.gateways.main()
    assert not len(load_table(work / "data/gateways/gateways.parquet", find.GATEWAYS))
    said = capsys.readouterr().err
    for word, direction in (("into", find.IN), ("out of", find.OUT)):
        every = world.ways(direction, distance_threshold=1e6, min_deltas_ahead=14)
        free = every["distance"].min() / world.step
        line = next(line for line in said.splitlines() if f"no gateway {word} the film" in line)
        told = float(line.split("gateways.distance_threshold=")[1].split()[0])
        assert free <= told <= free + 0.1
        assert len(world.ways(direction, distance_threshold=told, min_deltas_ahead=14))
    assert load_numbers(work / "reports/gateways")["ways_in"] == 0
    monkeypatch.setattr(find.GatewaysSettings, "min_deltas_ahead", 100)
    stages.gateways.main()
    assert "no gateway into the film; no track lasts 100 Δ" in capsys.readouterr().err
