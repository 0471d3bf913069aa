"""The display's page in a real browser: it draws as the painter does, px by px, and moves evenly."""

import base64
import json
import re

import cv2
import numpy as np
import pytest
from browser import Visit, chromium, hold_time, visit

from finloop.base.errors import FinloopError
from finloop.puppet import PlacedBackbone
from finloop.render.painter import BentPicture, Painter, pad_picture
from finloop.show.alone import build_standalone_page
from finloop.show.drawn import POSTURE
from finloop.show.page import (
    DRAWING,
    build_display_page,
    build_experimenter_page,
    join_scripts,
    pack_message,
)
from finloop.show.pictures import PagePicture, PicturePlacement, measure_typical_fish
from finloop.stimulus.display import DisplayCalibration
from finloop.stimulus.log import parse_frame_records

STEPS, LENGTH = 24, 80.0
HEIGHT, WIDTH = 240, 320
PLAIN = {"as": "fish", "contrast": 1, "size": 1, "colour": None}
STAGE = """<!doctype html><meta charset="utf-8"><style>body{margin:0;background:#000}
canvas{position:absolute;left:0;top:0}</style><canvas id="floor"></canvas><canvas id="glass"></canvas>"""
HELP = """
const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
const floats = text => new Float32Array(bytes(text).buffer);
function seen(drawer) {  // the screen: the glass over the floor
  const {box: [left, top, width, height], view, still} = drawer, glass = drawer.pixels();
  const whole = new Uint8Array(still.data);
  for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) {
    const from = 4 * ((height - 1 - y) * width + x), to = 4 * ((y + top) * view.width + x + left);
    if (glass[from + 3]) whole.set(glass.subarray(from, from + 3), to);
  }
  let text = "";
  for (let i = 0; i < whole.length; i += 8192) text += String.fromCharCode(...whole.subarray(i, i + 8192));
  return btoa(text);
}
function stage(spec, tank) {
  window.drawer = new Drawer(document.getElementById("glass"), document.getElementById("floor"), spec, bytes(tank));
}
"""


def message(kind, payload=b"", **facts):
    return pack_message({"kind": kind, **facts}, payload)


def posture_of(bends, head=(0.45, 0.0)):
    bends = np.broadcast_to(np.asarray(bends, float), STEPS)
    return np.concatenate([head, bends, np.full(STEPS, 1 / STEPS)]).astype(np.float32)


T = np.linspace(0, 1, STEPS)
STRAIGHT = posture_of(0.0)
S_BEND = posture_of(1.1 * np.sin(5 * T), (0.3, 0.1))
CURL = posture_of(np.linspace(-2.6, 2.6, STEPS), (0.1, 0.3))


def fish_of(seed=0, bend=0.5, colour=False, level=90.0):
    """A bent fish with stripes and noise, as a picture of the film."""
    rng, size = np.random.default_rng(seed), int(1.8 * LENGTH)
    posture = posture_of(bend * np.sin(3 * T))
    bends = posture[2 : 2 + STEPS].astype(float)
    way = np.stack([-np.cos(bends), np.sin(bends)], 1) * LENGTH / STEPS
    middle = size / 2
    line = np.vstack([[middle + 0.45 * LENGTH, middle], way]).cumsum(0)
    y, x = np.mgrid[:size, :size].astype(float)
    apart = np.hypot(x[..., None] - line[:, 0], y[..., None] - line[:, 1])
    step, near = apart.argmin(-1), apart.min(-1)
    width = 8 * np.sin(np.pi * np.clip((step + 2) / (STEPS + 3), 0, 1)) ** 0.7
    alpha = np.clip(width - near + 0.5, 0, 1)
    skin = level + 60 * np.sin(step * 1.1) + 30 * np.sin(near) + rng.normal(0, 6, near.shape)
    skins = [np.clip(skin + shift, 0, 255) for shift in ((0, 40, -30) if colour else (0,))]
    layers = [np.rint(one * alpha) for one in skins] + [np.rint(255 * alpha)]
    pixels = np.dstack(layers).astype(np.uint8)
    left, top, width, height = cv2.boundingRect(pixels[..., -1])
    cut = np.ascontiguousarray(pixels[top : top + height, left : left + width])
    return PagePicture(cut, PicturePlacement(middle - left, middle - top, 0.0, LENGTH), posture)


def state_of(posture, x=160.25, y=120.5, heading=0.7, size=LENGTH, number=10, partner=-1, weight=0.0,
             mirrored=(0, 0), look=0, alpha=1.0):  # fmt: skip
    facts = [x, y, heading, size, number, partner, weight, *mirrored, look, alpha]
    return np.concatenate([facts, posture]).astype(np.float32)[None]


def bent_of(one, posture, heading=0.7, size=LENGTH, mirrored=False):
    held = pad_picture(one.pixels, *one.placement[:2])
    source = PlacedBackbone(held.x_px, held.y_px, *one.placement[2:], one.posture.astype(float))
    return BentPicture(
        held, source, posture.astype(float), float(np.float32(heading)), size, mirrored
    )


def tank_of(*shape, seed=0):
    return np.clip(np.random.default_rng(seed).normal(150, 20, shape), 0, 255).astype(np.uint8)


def text_of(array):
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()


LOOKS = {
    "plain": PLAIN, "none": PLAIN | {"contrast": 0}, "half": PLAIN | {"contrast": 0.5},
    "double": PLAIN | {"contrast": 2}, "most": PLAIN | {"contrast": 4}, "larger": PLAIN | {"size": 1.25},
    "black": PLAIN | {"as": "silhouette", "colour": [0, 0, 0]}, "dot": PLAIN | {"as": "dot"},
    "dark": PLAIN | {"as": "silhouette"},
    "orange": PLAIN | {"as": "silhouette", "colour": [200, 100, 50]},
    "large dot": PLAIN | {"as": "dot", "size": 2, "colour": [0, 0, 0]},
    "small dot": PLAIN | {"as": "dot", "size": 0.5, "colour": [0, 0, 0]},
}  # fmt: skip


def look(name):
    return list(LOOKS).index(name)


class Stage:
    """The drawing alone, on a page of its own."""

    def __init__(self, browser, tank, colour=False):
        self.tank, self.pictures = tank, {10: fish_of(colour=colour), 11: fish_of(1, -0.3, colour)}
        spec = {
            "width": WIDTH, "height": HEIGHT, "channels": 3 if colour else 1, "posture": len(STRAIGHT), "slots": 3,
            "slot_width": 160, "slot_height": 160, "looks": list(LOOKS.values()), "fish": 3,
        }  # fmt: skip
        self.page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        self.page.set_content(STAGE)
        self.page.add_script_tag(content=join_scripts(*DRAWING, "levels.js") + HELP)
        self.page.evaluate("([spec, tank]) => stage(spec, tank)", [spec, text_of(tank)])
        self.reset()

    def reset(self):
        self.by(None)
        for slot, (number, one) in enumerate(self.pictures.items()):
            self.take(number, slot, one)

    def by(self, display, width=WIDTH, height=HEIGHT):
        """Draw by a display, on a screen of this size."""
        self.size = width, height
        self.page.set_viewport_size({"width": width, "height": height})
        self.page.evaluate(
            "([w, h, display]) => drawer.screen(w, h, 1, display, null)", [width, height, display]
        )

    def take(self, number, slot, one):
        height, width = one.pixels.shape[:2]
        arrays = [list(one.placement), text_of(one.posture), text_of(one.pixels)]
        self.page.evaluate(
            "([n, s, w, h, line, posture, pixels]) => drawer.picture(n, s, w, h, line, floats(posture), bytes(pixels))",
            [number, slot, width, height, *arrays],
        )

    def run(self, states, result):
        """Draw states, and return what some code gives then."""
        whole = np.concatenate([np.zeros((0, POSTURE + len(STRAIGHT)), np.float32), *states])
        code = f"([states, count]) => {{ drawer.draw(floats(states), count); return {result}; }}"
        return self.page.evaluate(code, [text_of(whole), len(whole)])

    def draw(self, *states):
        pixels = np.frombuffer(base64.b64decode(self.run(states, "seen(drawer)")), np.uint8)
        return pixels.reshape(self.size[1], self.size[0], 4)[..., :3].astype(int)

    def digest(self, *states, square=0):
        return self.run(states, f"drawer.digest({square})")

    def shot(self):
        """What the browser shows."""
        return screenshot(self.page, cv2.IMREAD_COLOR)[..., ::-1]


def screenshot(page, flags=cv2.IMREAD_GRAYSCALE):
    return cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), flags)


@pytest.fixture(scope="module")
def browser():
    with chromium() as one:
        yield one


@pytest.fixture(scope="module")
def stages(browser):
    made = {
        "noise": Stage(browser, tank_of(HEIGHT, WIDTH)),
        "white": Stage(browser, np.full((HEIGHT, WIDTH), 255, np.uint8)),
        "colour": Stage(browser, tank_of(HEIGHT, WIDTH, 3), True),
    }

    def reset_stage(name):
        made[name].reset()
        return made[name]

    return reset_stage


@pytest.fixture
def stage(stages):
    return stages("noise")


@pytest.fixture
def white(stages):
    return stages("white")


@pytest.fixture
def colour(stages):
    return stages("colour")


def wait(page, what):
    """Until something is so; a page's policy forbids the browser's own way."""
    for _ in range(3000):
        if page.evaluate(what):
            return
        page.wait_for_timeout(20)
    raise AssertionError(what)


def paint(tank, *fish):
    painter = Painter(tank)
    for one in fish:
        painter.draw(*one)
    return painter.frame.astype(int)


# --- the drawing


def test_in_its_own_posture_at_its_own_place_a_picture_is_the_cut_out(stage):
    one, tank = fish_of(), tank_of(HEIGHT, WIDTH)
    drawn = stage.draw(state_of(one.posture, one.placement[0] + 60, one.placement[1] + 40, 0.0))
    height, width = one.pixels.shape[:2]
    wanted = tank.astype(float)
    part = wanted[40 : 40 + height, 60 : 60 + width]
    part[...] = one.pixels[..., 0] + (1 - one.pixels[..., 1] / 255) * part
    assert np.abs(drawn[..., 0] - wanted).max() <= 1
    assert (drawn == drawn[..., :1]).all()


@pytest.mark.parametrize(
    ("posture", "heading", "size", "mirrored"),
    [
        (STRAIGHT, 0.7, LENGTH, False), (S_BEND, 2.0, LENGTH, True),
        (S_BEND, -1.0, 1.5 * LENGTH, False), (CURL, 3.0, 0.8 * LENGTH, True),
    ],
)  # fmt: skip
def test_in_any_pose_it_is_what_the_painter_draws(stage, posture, heading, size, mirrored):
    drawn = stage.draw(state_of(posture, heading=heading, size=size, mirrored=(mirrored, 0)))
    tank = tank_of(HEIGHT, WIDTH)
    wanted = paint(tank, (160.25, 120.5, bent_of(fish_of(), posture, heading, size, mirrored)))
    fish = wanted != tank
    assert fish.sum() > 500
    apart = np.abs(drawn[..., 0] - wanted)
    assert apart[fish].mean() < 0.1 and apart.max() <= 2


def test_a_partner_is_mixed_in_and_a_later_fish_lies_over_an_earlier_one(stage):
    first, second = fish_of(), fish_of(1, -0.3)
    mixed = state_of(S_BEND, partner=11, weight=0.4, mirrored=(0, 1))
    states = mixed, state_of(STRAIGHT, 175, 130, 2.0, number=11)
    partner = bent_of(second, S_BEND, mirrored=True)
    wanted = paint(
        tank_of(HEIGHT, WIDTH),
        (160.25, 120.5, bent_of(first, S_BEND), partner, float(np.float32(0.4))),
        (175.0, 130.0, bent_of(second, STRAIGHT, 2.0)),
    )
    assert np.abs(stage.draw(*states)[..., 0] - wanted).max() <= 2
    assert np.abs(stage.draw(*states[::-1])[..., 0] - wanted).max() > 30


def test_colours_are_drawn_as_the_painter_does(colour):
    wanted = paint(colour.tank, (160.25, 120.5, bent_of(fish_of(colour=True), S_BEND)))
    assert np.abs(colour.draw(state_of(S_BEND)) - wanted).max() <= 2
    assert np.abs(wanted[..., 0] - wanted[..., 1]).max() > 20


def test_nothing_is_drawn_without_its_picture_or_beyond_the_screen(stage):
    tank = stage.tank
    for state in (state_of(STRAIGHT, number=-1), state_of(STRAIGHT, number=99), state_of(STRAIGHT, alpha=0.0),
                  state_of(STRAIGHT, x=-500.0)):  # fmt: skip
        assert (stage.draw(state)[..., 0] == tank).all()
    half = stage.draw(state_of(STRAIGHT, x=0.0))[..., 0]
    assert (half[:, :60] != tank[:, :60]).any() and (half[:, 60:] == tank[:, 60:]).all()


def test_where_a_fish_folds_no_pixel_is_covered_twice(white):
    folded = posture_of(np.linspace(0, 7.5, STEPS))  # more than a circle: head and tail cross
    half = state_of(folded, look=look("black"), alpha=0.5)
    assert white.draw(half).min() in (127, 128)
    assert white.draw(half, half).min() in (63, 64)


def test_the_same_states_give_the_same_pixels_and_others_a_new_digest(stage):
    states = state_of(S_BEND), state_of(STRAIGHT, 60, 60, number=11)
    first = stage.digest(*states)
    moved = stage.digest(state_of(S_BEND, x=160.5), states[1])
    square = stage.digest(*states, square=1)
    assert stage.digest(*states) == first and len({first, moved, square}) == 3
    assert first == int(first) and 0 <= first < 2**53


def test_a_slot_that_is_used_again_forgets_its_picture(stage):
    before = stage.draw(state_of(STRAIGHT))
    stage.take(12, 0, fish_of(5, level=200.0))
    assert (stage.draw(state_of(STRAIGHT))[..., 0] == stage.tank).all()
    assert np.abs(stage.draw(state_of(STRAIGHT, number=12)) - before).max() > 50


# --- looks


CONTRASTS = [("none", 0), ("half", 0.5), ("plain", 1), ("double", 2), ("most", 4)]


@pytest.mark.parametrize("name, contrast", CONTRASTS)
def test_contrast_is_that_of_the_fish_against_the_floor(stage, name, contrast):
    tank = stage.tank.astype(int)
    plain = stage.draw(state_of(S_BEND))[..., 0]
    drawn = stage.draw(state_of(S_BEND, look=look(name)))[..., 0]
    wanted = np.clip(tank + contrast * (plain - tank), 0, 255)
    assert np.abs(drawn - wanted).max() <= 1 + contrast / 2


def test_a_silhouette_has_the_outline_and_one_colour(colour):
    one = fish_of(colour=True)
    place = one.placement[0] + 60, one.placement[1] + 40
    drawn = colour.draw(state_of(one.posture, *place, 0.0, look=look("orange")))
    height, width = one.pixels.shape[:2]
    alpha, wanted = one.pixels[..., 3:] / 255, colour.tank.astype(float)
    part = wanted[40 : 40 + height, 60 : 60 + width]
    part[...] = alpha * [200, 100, 50] + (1 - alpha) * part
    assert np.abs(drawn - wanted).max() <= 1


def test_dots_and_silhouettes_of_a_session_are_alike_whatever_the_picture(white):
    facts, one = measure_typical_fish(white.pictures.values()), fish_of()
    area = one.pixels[..., 1].sum() / 255
    assert facts["area"] * one.placement[3] ** 2 == pytest.approx(area, rel=0.1)
    for name in ("dot", "dark"):
        white.page.evaluate("facts => { drawer.spec.typical = facts; }", facts)
        states = [state_of(S_BEND, number=number, look=look(name)) for number in (10, 11)]
        drawn = [white.draw(state) for state in states]
        white.page.evaluate("drawer.spec.typical = null")
        assert drawn[0].min() == drawn[1].min() == pytest.approx(facts["dark"][0], abs=1)
        if name == "dot":
            np.testing.assert_array_equal(*drawn)


def test_a_dot_covers_the_area_of_the_fish_and_is_as_dark_as_its_darkest(white):
    one = fish_of()
    dot = white.draw(state_of(S_BEND, look=look("dot")))[..., 0]
    opaque = one.pixels[one.pixels[..., 1] == 255][:, 0]
    assert opaque.min() <= dot.min() <= np.percentile(opaque, 10)
    area = one.pixels[..., 1].sum() / 255
    assert (255 - dot).sum() / (255 - dot.min()) == pytest.approx(area, rel=0.02)
    y, x = np.nonzero(dot == dot.min())
    assert x.mean() == pytest.approx(160.25, abs=0.3) and y.mean() == pytest.approx(120.5, abs=0.3)
    large = white.draw(state_of(S_BEND, look=look("large dot")))[..., 0]
    assert (255 - large).sum() / 255 == pytest.approx(4 * area, rel=0.02)


def test_size_changes_the_fish_and_not_its_place(stage):
    wanted = paint(stage.tank, (160.25, 120.5, bent_of(fish_of(), S_BEND, size=1.25 * LENGTH)))
    assert np.abs(stage.draw(state_of(S_BEND, look=look("larger")))[..., 0] - wanted).max() <= 2


# --- the display


def display_of(width=WIDTH, height=HEIGHT, **facts):
    plain = {
        "version": 1, "px_per_mm": None, "width_px": width, "height_px": height, "ratio": 1.0, "background": "film",
        "gamma": None, "corners": None, "square": None, "scale": None, "refresh_hz": 60.0,
    }  # fmt: skip
    return plain | facts


def test_a_scaled_tank_lies_in_the_middle_and_its_fish_are_as_large(white):
    white.by(display_of(scale=2.0), 700, 500)
    tank = np.zeros((500, 700), int)
    tank[10:490, 30:670] = 255
    assert (white.draw()[..., 0] == tank).all()
    large = np.full((2 * HEIGHT, 2 * WIDTH), 255, np.uint8)
    fish = bent_of(fish_of(), S_BEND, size=2 * LENGTH)
    wanted = paint(large, (2 * 160.75 - 0.5, 2 * 121 - 0.5, fish))
    assert np.abs(white.draw(state_of(S_BEND))[10:490, 30:670, 0] - wanted).max() <= 2


def test_one_tone_fills_the_screen(stage):
    stage.by(display_of(background=[10, 200, 30.4]), 400, 300)
    assert (stage.draw() == [10, 200, 30]).all()


def test_a_keystone_takes_every_place_where_its_projection_does(white):
    corners = [[0.1, 0.05], [0.95, 0.0], [0.9, 0.97], [0.02, 0.9]]
    white.by(display_of(corners=corners))
    size = np.float32([WIDTH, HEIGHT])
    square = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]]) * size
    m = cv2.getPerspectiveTransform(square, np.float32(corners) * size)
    inside = cv2.erode((white.draw()[..., 0] == 255).astype(np.uint8), np.ones((3, 3)))
    for place in ((80.0, 60.0), (240.0, 60.0), (250.0, 190.0)):
        drawn = white.draw(state_of(STRAIGHT, *place, look=look("small dot")))[..., 0]
        wanted = cv2.perspectiveTransform(np.float32([[np.add(place, 0.5)]]), m)[0, 0] - 0.5
        y, x = np.nonzero((drawn < 128) & (inside > 0))
        assert [x.mean(), y.mean()] == pytest.approx(wanted.tolist(), abs=0.6)


def test_levels_go_through_the_table_last_of_all(stage):
    states = state_of(S_BEND), state_of(STRAIGHT, 40, 200, number=11, alpha=0.5)
    plain = stage.draw(*states)
    stage.by(display_of(gamma=[[255 - level, level, level // 2] for level in range(256)]))
    drawn = stage.draw(*states)
    assert (drawn == np.dstack([255 - plain[..., 0], plain[..., 1], plain[..., 2] // 2])).all()
    assert (stage.shot() == drawn).all()


def test_tables_make_luminance_even(stage):
    levels = np.array([0, 32, 64, 128, 192, 255])
    shine = 0.3 + 120 * (levels / 255) ** 2.2
    run, rows = stage.page, np.column_stack([levels, shine]).tolist()
    table = np.array(run.evaluate("rows => tableOfLuminances(rows)", rows))
    assert table.shape == (256, 3)
    assert 255 * (table[:, 0] / 255) ** 2.2 == pytest.approx(np.arange(256), abs=0.5)
    known = np.array(run.evaluate("tableOfExponents([2.2, 1, 1.8])"))
    assert known[:, 0] == pytest.approx(table[:, 0], abs=0.5)
    assert known[:, 1].tolist() == list(range(256))
    pasted = "r,g,b\n" + "\n".join(f"{level},{level};{level}" for level in range(256))
    read = run.evaluate("text => tableOfText(text)", pasted)
    assert read == [[level] * 3 for level in range(256)]
    for wrong, why in (("tableOfText('1,2,3')", "wanted 256"), ("tableOfLuminances([[0,1],[9,2],[200,3]])", "0 and 255"),
                       ("tableOfLuminances([[0,5],[9,2],[255,3]])", "brighter"), ("numbersOf('1,2\\n3')", "row 2")):  # fmt: skip
        caught = "catch (error) { return error.message }"
        assert why in run.evaluate(f"(() => {{ try {{ {wrong}; return '' }} {caught} }})()")


# --- time


def motion(page, code):
    """What a piece of code gives, with motions of two fish without a posture."""
    return page.evaluate(
        """code => new Function("F", "state", "at", code)(11,
          (x, heading = 0, picture = 1) => Float32Array.from([x, 0, heading, 1, picture, -1, 0, 0, 0, 0, 1]),
          (motion, t) => { const states = new Float32Array(11 * motion.fish); motion.at(t, states); return [...states]; })""",
        code,
    )


def test_between_ticks_places_are_linear_and_headings_turn_the_shorter_way(stage):
    half, late, edge = motion(stage.page, """
      const m = new Motion(1, F, 25);
      m.rows({seq: 1, tick: 0, due: 1}, state(0, 3, 7), 0);
      m.rows({seq: 2, tick: 1, due: 2}, state(10, -3, 8), 0);
      return [1.25, 1.75, 3].map(t => at(m, t));""")  # fmt: skip
    assert half[0] == 2.5 and late[0] == 7.5 and edge[0] == 10
    assert half[2] == pytest.approx(3 + (2 * np.pi - 6) / 4) and (half[4], late[4]) == (7, 8)


def test_a_cut_leaves_no_jump_and_arrives_in_time(stage):
    before, after, on, end, other = motion(stage.page, """
      const m = new Motion(1, F, 25);
      [0, 1, 2, 3].forEach(k => m.rows({seq: k, tick: k, due: k}, state(10 * k), -1));
      const out = [at(m, 1.5)];
      m.rows({seq: 9, tick: 2, due: 2, cut: true}, state(-50), 1.5);
      out.push(at(m, 1.5), at(m, 1.75), at(m, 2));
      m.rows({seq: 10, tick: 3, due: 3}, state(-60), 1.9);
      out.push(at(m, 2.5));
      return out.map(one => one[0]);""")  # fmt: skip
    assert (before, after, end) == (15, 15, -50) and on == pytest.approx(-17.5) and other == -55


def test_a_cut_keeps_the_ticks_before_it(stage):
    assert motion(stage.page, """
      const m = new Motion(1, F, 25);
      [0, 1, 2, 3].forEach(k => m.rows({seq: k, tick: k, due: k}, state(10 * k), -1));
      at(m, 0.5);
      m.rows({seq: 9, tick: 2, due: 2, cut: true}, state(0), 0.5);
      return [0.5, 1, 1.5, 2].map(t => at(m, t)[0]);""") == [5, 10, 5, 0]  # fmt: skip


def test_late_rows_find_the_fish_where_it_waits_and_no_old_ones_are_swum(stage):
    held, there, between, end = motion(stage.page, """
      const m = new Motion(1, F, 10);
      m.rows({seq: 1, tick: 0, due: 0}, state(0), -1);
      m.rows({seq: 2, tick: 1, due: 0.1}, state(10), -1);
      const out = [at(m, 0.3)];
      [2, 3, 4].forEach(k => m.rows({seq: 1 + k, tick: k, due: k / 10}, state(k < 4 ? 999 : 40), 0.45 + k / 1000));
      return [...out, at(m, 0.454), at(m, 0.479), at(m, 0.504)].map(one => one[0]);""")  # fmt: skip
    assert (held, end) == (10, 40) and 10 <= there < 50
    assert between == pytest.approx((there + 40) / 2)


def test_a_fish_that_comes_or_goes_does_not_slide(stage):
    assert motion(stage.page, """
      const m = new Motion(2, F, 25);
      m.rows({seq: 1, tick: 0, due: 0}, state(5), -1);  // the second one is not there yet
      m.rows({seq: 2, tick: 1, due: 1}, Float32Array.from([...state(7), ...state(100)]), -1);
      return [0.25, 0.75].map(t => { const s = at(m, t); return [s[0], s[F], s[F + 4]]; });
    """) == [[5.5, 0, -1], [6.5, 100, 1]]  # fmt: skip
    nothing = motion(stage.page, "const m = new Motion(1, F, 25); return at(m, 3)[4];")
    assert nothing == -1


def test_nothing_is_shown_before_the_first_tick_and_something_ever_after(stage):
    assert motion(stage.page, """
      const m = new Motion(1, F, 25);
      const out = [at(m, 0)[4]];
      m.rows({seq: 1, tick: 0, due: 1}, state(0), 0.5);
      m.rows({seq: 2, tick: 0, due: 1, cut: true}, state(3), 0.6);  // before it began
      out.push(at(m, 0.9)[4], at(m, 1)[0]);
      m.rows({seq: 3, tick: 1, due: 2}, state(5), 1.2);
      out.push(at(m, 1.19)[0], at(m, 1.6)[0]);  // a frame that began before these rows came
      m.hold(1.6);
      out.push(at(m, 9)[0]);
      m.clear();
      return [...out, at(m, 10)[4]];""") == [-1, -1, 3, 3, 4, 4, -1]  # fmt: skip


def test_rows_that_were_applied_are_numbered(stage):
    assert motion(stage.page, """
      const m = new Motion(1, F, 25), states = new Float32Array(F);
      [0, 1, 2].forEach(k => m.rows({seq: 5 + k, tick: k, due: k}, state(k), -1));
      return [0, 0.5, 1, 1.5].map(t => m.at(t, states));""") == [5, 6, 6, 7]  # fmt: skip


def test_the_clock_trusts_the_quickest_ping_and_is_bent_without_a_jump(stage):
    first, last, steps, before, after, far, renewed = stage.page.evaluate("""() => {
      const c = new Clock();
      c.ping(1000, 51.01, 1020);   // the server is 50 s ahead
      const first = c.at(2000);
      c.ping(2000, 52.3, 2400);    // a slow one tells nothing
      const last = c.at(2400);
      const before = c.at(3000);
      c.ping(2990, 53.015, 3000);  // 20 ms more
      const after = c.at(3000), steps = [];
      for (let ms = 3000; ms < 7000; ms += 100) steps.push(c.at(ms + 100) - c.at(ms));
      const far = c.at(7000);
      c.renew(); c.ping(7000, 1007, 7000);
      return [first, last, steps, before, after, far, c.at(7000)];
    }""")
    assert (first, last, before) == pytest.approx((52, 52.4, after))
    assert min(steps) > 0 and max(steps) == pytest.approx(0.101) and far == pytest.approx(57.02)
    assert renewed == 1007


def test_dropped_frames_are_counted_on_an_even_grid(stage):
    period, frames = stage.page.evaluate("""() => {
      const r = new Refresh(), out = [];
      let ms = 0;
      for (let k = 0; k < 200; k++) { ms += k === 100 ? 30 : k === 150 ? 20 : 10; out.push(r.frame(ms + (k % 2) * 0.4)); }
      return [r.period, out];
    }""")
    dropped = [one["dropped"] for one in frames]
    assert period == pytest.approx(10, abs=0.5)
    assert (sum(dropped), dropped[100], dropped[150]) == (3, 2, 1)
    ideal = np.diff([one["ideal"] for one in frames])[20:95]
    assert np.abs(ideal - 10).max() < 0.5  # the browser's own intervals are 9.6 and 10.4 ms


# --- the page before the animals


class Server:
    """Stands for the server of a session."""

    def __init__(self, browser):
        self.seen = visit_of(browser)
        self.page, self.texts, self.frames, self.sockets = self.seen.page, [], [], []
        self.page.clock.install()
        self.page.route("http://tank.test/**", self._answer)
        self.page.route_web_socket("ws://tank.test/display?token=a", self._open)
        self.page.goto("http://tank.test/show?token=a")
        self.until("ready")

    def _answer(self, route):
        policy = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src ws://tank.test; img-src data:"
        route.fulfill(
            body=build_display_page(),
            content_type="text/html; charset=utf-8",
            headers={"Content-Security-Policy": policy},
        )

    def _open(self, socket):
        self.sockets.append(socket)
        socket.on_message(self._take)

    def _take(self, told):
        if isinstance(told, bytes):
            self.frames += parse_frame_records(told, POSTURE + len(STRAIGHT))
            return
        self.texts.append(json.loads(told))
        if self.texts[-1]["do"] == "ping":
            sent = self.texts[-1]["sent"]
            self.send(message("pong", sent=sent, now=sent / 1000 + 100))

    def send(self, *messages):
        for one in messages:
            self.sockets[-1].send(one)

    def until(self, kind, count=1):
        for _ in range(2400):
            told = [one for one in self.texts if one["do"] == kind]
            if len(told) >= count:
                return told
            self.page.wait_for_timeout(25)
        raise AssertionError((kind, self.texts, self.seen.bad))

    def hello(self, **facts):
        tank = tank_of(HEIGHT, WIDTH)
        plain = {
            "rate": 25.0, "width": WIDTH, "height": HEIGHT, "channels": 1, "posture": len(STRAIGHT), "slots": 3,
            "slot_width": 160, "slot_height": 160, "looks": [PLAIN], "fish": 2, "display": None, "name": "left",
            "mm_per_px": 0.5, "mode": "session", "digest": True, "keys": [" "],
        }  # fmt: skip
        one = fish_of()
        height, width = one.pixels.shape[:2]
        self.send(
            message("hello", tank.tobytes(), **(plain | facts)),
            message("picture", one.posture.tobytes() + one.pixels.tobytes(), picture=10, slot=0, width=width,
                    height=height, line=list(one.placement)),
        )  # fmt: skip
        wait(self.page, "drawer && drawer.pictures.has(10)")

    def clear(self):
        """The fish go, and what is recorded of them has come."""
        self.send(message("clear"))
        wait(self.page, "!motion.keys.length")
        self.page.clock.run_for(400)
        wait(self.page, "!noted && !records.length")

    def rows(self, seq, tick, due, *states, cut=False):
        facts = {"seq": seq, "tick": tick, "due": due, "cut": cut}
        self.send(message("rows", np.concatenate(states).tobytes(), **facts))

    def hold_clock(self):
        hold_time(self.page)
        return self.page.evaluate("clock.at(performance.now())")


def visit_of(browser):
    seen = Visit(browser.new_context(viewport={"width": 400, "height": 300}).new_page())
    seen.page.remove_listener("request", seen._note_request)
    return seen


def test_a_session_is_shown_and_every_frame_is_recorded(browser):
    server = Server(browser)
    page = server.page
    ready = server.until("ready")[0]
    assert (ready["width"], ready["height"], ready["ratio"]) == (400, 300, 1)
    assert ready["renderer"] and ready["agent"]
    server.hello()
    server.send(message("say", text="press the space bar to start"))
    wait(page, "!document.getElementById('say').hidden")
    assert "space bar" in page.locator("#say").text_content()
    page.keyboard.press(" ")
    assert server.until("key")[0]["key"] == " "
    server.send(message("say", text=""))
    wait(page, "document.getElementById('say').hidden")
    begin = server.hold_clock() + 0.1
    for tick in range(11):
        server.rows(tick + 1, tick, begin + tick / 25, state_of(S_BEND, 100 + 4 * tick))
    page.keyboard.press("c")  # no panel while fish are shown
    wait(page, "motion.keys.length === 11")
    page.clock.run_for(600)
    assert page.locator("#panel").is_hidden()
    server.clear()
    facts = np.array([one for one, _ in server.frames])
    assert len(facts) > 10 and (np.diff(facts[:, 0]) >= 1).all()
    assert (facts[:, 3] >= facts[:, 2]).all() and (np.diff(facts[:, 1]) > 0).all()
    assert facts[-1, 6] == 0 and facts[-2, 4] == 11 and (facts[:-1, 6] == 2).all()
    assert (facts[:, 7] > 0).all()
    yet = [drawn[0, 0] for one, drawn in server.frames[:-1] if one[1] < begin]
    assert not any(yet)  # nothing is shown before the first tick
    shown = [one for one in server.frames[:-1] if one[0][1] > begin]
    moves = np.array([(facts[1] - begin, drawn[0, 0]) for facts, drawn in shown])
    wanted = 100 + 4 * 25 * np.clip(moves[:, 0], 0, 0.4)
    assert moves[:, 1] == pytest.approx(wanted, abs=0.1)  # the place of the frame's own time
    assert server.seen.bad == []


def test_a_page_keeps_its_identity_in_another_size(browser):
    server = Server(browser)
    server.page.set_viewport_size({"width": 500, "height": 310})
    resized = server.until("resized")[-1]
    assert (resized["width"], resized["height"], resized["ratio"]) == (500, 310, 1)
    server.sockets[-1].close()
    first, again = server.until("ready", 2)
    assert first["page"] == again["page"] and len(first["page"]) > 20
    assert server.seen.bad == []


def test_a_lost_connection_is_not_seen_and_comes_back(browser):
    server = Server(browser)
    page = server.page
    server.hello(digest=False)
    begin = server.hold_clock()
    server.rows(1, 0, begin + 0.05, state_of(S_BEND, 100))
    wait(page, "motion.keys.length")
    page.clock.run_for(100)
    assert page.evaluate("states[0]") == 100
    page.clock.resume()
    server.sockets[-1].close()
    server.until("ready", 2)
    hold_time(page)
    lost = page.evaluate("[drawer.rects.length, document.getElementById('say').hidden]")
    assert lost == [1, True]
    server.hello(digest=False)
    begin = page.evaluate("clock.at(performance.now())")
    server.rows(7, 50, begin + 0.3, state_of(S_BEND, 120))
    wait(page, "motion.keys.some(one => one.tick === 50)")
    page.clock.run_for(600)
    assert page.evaluate("states[0]") == 120
    server.clear()
    places = [states[0, 0] for _, states in server.frames if len(states)]
    assert any(100 < x < 120 for x in places)  # it swam there from where it was
    assert server.seen.bad == []


def test_a_display_is_calibrated_with_the_keyboard(browser):
    server = Server(browser)
    server.hello(display=None)
    page = server.page
    page.keyboard.press("c")
    assert page.locator("#panel").is_visible()
    assert page.evaluate("document.activeElement.id") == "mm"
    page.fill("#mm-number", "4")
    assert page.locator("#card").bounding_box()["width"] == pytest.approx(4 * 85.6, abs=0.1)
    wait(page, "drawer.view.scale === 2")  # 4 px/mm, 0.5 mm per px of the tank
    page.locator("#handles button").nth(1).focus()
    for key in ("Shift+ArrowLeft", "ArrowDown"):
        page.keyboard.press(key)
    page.select_option("#levels", "luminances")
    page.fill("#levels-text", "0,1\n128,20")
    page.click("#levels-apply")
    assert "0 and 255" in page.locator("#panel-said").text_content()
    page.select_option("#levels", "exponents")
    page.click("#levels-apply")
    page.select_option("#square-corner", "bottom left")
    page.select_option("#tone", "even")
    page.click("#save")
    text = json.dumps(server.until("display")[0]["display"])
    display = DisplayCalibration.model_validate_json(text)
    assert (display.px_per_mm, display.background) == (4, (128, 128, 128))
    assert display.square.corner == "bottom left"
    assert display.corners[1] == pytest.approx((1 - 10 / 400, 1 / 300), abs=1e-4)
    assert display.gamma[128][0] == pytest.approx(255 * (128 / 255) ** (1 / 2.2), abs=0.01)
    assert (display.width_px, display.height_px) == (400, 300) and 20 < display.refresh_hz < 400
    unnamed = page.evaluate("""[...document.querySelectorAll('#panel input, #panel select, #panel textarea')]
      .filter(one => !one.labels.length && !one.getAttribute('aria-label')).map(one => one.id)""")
    assert unnamed == []
    page.keyboard.press("Escape")
    assert page.locator("#panel").is_hidden() and page.locator("#handles").is_hidden()
    assert server.seen.bad == []


def test_the_square_of_the_photodiode_is_white_on_every_other_frame(browser):
    server, square = Server(browser), {"corner": "top right", "size_px": 30}
    server.hello(mode="replay", display=display_of(400, 300, square=square))
    for number, level in ((6, 0), (7, 255), (8, 0)):
        server.send(message("frame", state_of(S_BEND).tobytes(), number=number))
        wait(server.page, f"number === {number}")
        shot = screenshot(server.page)
        assert (shot[:30, 370:] == level).all() and shot[31, 369] not in (0, 255)


# --- the page that plays alone


def test_a_page_plays_a_motion_without_a_server(browser, tmp_path):
    first = [state_of(S_BEND, 60 + 20 * tick) for tick in range(5)]
    states = np.stack([np.concatenate([one, state_of(CURL, 200, number=11)]) for one in first])
    pictures, tank = {10: fish_of(), 11: fish_of(1, -0.3)}, tank_of(HEIGHT, WIDTH)
    text = build_standalone_page("a <title>", 10.0, tank, pictures, states, loops=False)
    path = tmp_path / "alone.html"
    path.write_text(text, encoding="utf-8")
    seen = Visit(browser.new_context(viewport={"width": WIDTH, "height": HEIGHT}).new_page())
    page = seen.page
    page.clock.install()
    page.goto(path.as_uri())
    wait(page, "typeof drawer !== 'undefined' && drawer && drawer.box")
    assert page.title() == "a <title>" and page.locator("#hint").is_visible()
    page.evaluate("document.getElementById('hint').hidden = true; paint(1)")
    wanted = paint(
        tank,
        (80.0, 120.5, bent_of(pictures[10], S_BEND)),
        (200.0, 120.5, bent_of(pictures[11], CURL)),
    )
    assert np.abs(screenshot(page).astype(int) - wanted).max() <= 2
    page.keyboard.press("i")
    hold_time(page)
    page.keyboard.press(" ")
    page.clock.run_for(1000)
    assert page.evaluate("[runs, played]") == [False, 4]  # swum to its end, once
    assert page.evaluate("frames * refresh.period") == pytest.approx(500, abs=100)  # ms
    assert page.evaluate("states[0]") == 140
    assert "frames dropped" in page.locator("#info").text_content()
    page.keyboard.press("r")
    assert page.evaluate("[played, states[0]]") == [0, 60]
    assert seen.bad == []


def test_more_pictures_than_slots_take_turns(browser, tmp_path):
    states = np.stack([state_of(STRAIGHT, number=number) for number in range(260)])
    two = fish_of(level=60.0), fish_of(level=60.5)
    pictures = {number: two[number % 2] for number in range(260)}
    text = build_standalone_page("many", 25.0, tank_of(HEIGHT, WIDTH), pictures, states)
    path = tmp_path / "many.html"
    path.write_text(text, encoding="utf-8")
    page = visit(browser, path, viewport={"width": WIDTH, "height": HEIGHT}).page
    wait(page, "typeof drawer !== 'undefined' && drawer && drawer.box")
    assert page.evaluate("""() => {
      const shown = [];
      for (const tick of [...Array(260).keys(), 0]) { paint(tick); shown.push(drawer.rects.length); }
      return [Math.min(...shown), drawer.pictures.size];
    }""") == [1, 256]  # fmt: skip


def test_a_page_refuses_a_motion_without_pictures_or_ticks():
    tank, one = tank_of(HEIGHT, WIDTH), np.stack([state_of(STRAIGHT, partner=12)])
    with pytest.raises(FinloopError, match="1 pictures are missing, 12 first"):
        build_standalone_page("x", 10.0, tank, {10: fish_of()}, one)
    with pytest.raises(FinloopError, match="at least one tick"):
        build_standalone_page("x", 10.0, tank, {10: fish_of()}, one[:0])
    one[0, 0, 0] = np.nan
    with pytest.raises(FinloopError, match="all of them numbers"):
        build_standalone_page("x", 10.0, tank, {10: fish_of(), 12: fish_of()}, one)


def test_every_page_has_one_script_and_one_style_for_the_policy():
    states = np.stack([state_of(STRAIGHT)])
    alone = build_standalone_page("x", 10.0, tank_of(9, 9), {10: fish_of()}, states)
    desk = build_experimenter_page()
    for page in (build_display_page(), alone, desk):
        for tag in ("script", "style"):
            assert page.count(f"<{tag}") == page.count(f"</{tag}>") == 1
        assert not re.search(r"<[^>]+\s(?:style|on\w+)=", page.partition("<script>")[0])
    assert "innerHTML" not in desk
