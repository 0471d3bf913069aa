"""The page to try a morph: what it shows is what the tool computes, in a real browser."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from browser import chromium, visit
from scratch import save_svg

from finloop.io.svg import load_svg
from finloop.morph.layers import PhysicalOptions, morph_drawings
from finloop.morph.pairs import Pairing, load_pairing, pair_drawings
from finloop.morph.tool import main
from finloop.morph.trial import PARTNERS

FIRST = (
    '<defs><linearGradient id="g"><stop stop-color="red"/><stop offset="1" stop-color="blue"/></linearGradient></defs>'
    '<path id="box" fill="url(#g)" d="M10 10H40V40H10z"/><path id="disc" fill="#00ff00" d="M60 60L90 65L75 90z"/>'
    '<path id="hat" fill="#ff0000" d="M70 10H90V20H70z"/>'
)  # fmt: skip
SECOND = (
    '<path id="box" fill="#0000ff" d="M20 15L45 40L15 45z"/><path id="ball" fill="#000000" d="M60 65H92V92H60z"/>'
)  # fmt: skip
USUAL = PhysicalOptions()


def path_points(d):
    return np.array(re.findall(r"[-\d.]+", d), float).reshape(-1, 2)


@pytest.fixture
def drawings(tmp_path):
    return [
        save_svg(tmp_path / f"{name}'s.svg", text) for name, text in (("a", FIRST), ("b", SECOND))
    ]


def write_page(tmp_path, drawings):
    page = tmp_path / "try.html"
    given = [*drawings, "-o", str(page), "--frames", "5", "--points", "16"]
    assert main(given) == 0
    return page


def test_the_page_shows_what_the_tool_computes_and_says_how_to_make_it(tmp_path, drawings, capsys):
    page = write_page(tmp_path, drawings)
    said = capsys.readouterr().out
    assert (
        "pairs: 2 of 6 computed, 5 frames; paired by place and shape: disc → ball; vanish: hat"
        in said
    )
    a, b = (load_svg(Path(path)) for path in drawings)
    with chromium() as browser:
        seen = visit(browser, page)
        shown = seen.page
        shown.wait_for_selector("html[data-ready]")

        def scrub(share):
            shown.evaluate(
                f"s => {{ s = document.getElementById('tau'); s.value = {1000 * share}; s.dispatchEvent(new Event('input')); }}"
            )

        def frames_of(name):
            """The path of a shape of the morph at every frame."""
            number = [
                *shown.locator("#rows tr").evaluate_all("rows => rows.map(row => row.dataset.name)")
            ].index(name)
            found = []
            for share in np.linspace(0, 1, 5):
                scrub(share)
                found.append(
                    path_points(shown.locator("#morph path").nth(number).get_attribute("d"))
                )
            return np.stack(found)

        def compute(pairing, method, physics=USUAL):
            return morph_drawings(
                *pair_drawings(a, b, pairing), method, 5, 16, physics=physics
            ).layers

        proposed = Pairing({"box": "box", "disc": "ball"}, ["hat"], [])
        for name, stack in compute(proposed, "fold_free").items():
            np.testing.assert_allclose(frames_of(name), stack, atol=0.02)
        assert shown.locator("#morph linearGradient").count() == 1
        # other weights
        shown.check("text=physical >> input")
        shown.locator("#stiffness input").nth(2).check()
        stiff = compute(proposed, "physical", PhysicalOptions(elastic=4.0))
        np.testing.assert_allclose(frames_of("box"), stiff["box"], atol=0.02)
        assert "--method physical --elastic 4 --damping 8 --mass 1" in shown.input_value("#command")
        shown.check("text=linear >> input")
        # other pairs, by clicks: the hat becomes the ball, and the disc is left without
        shown.locator("#first path").nth(2).click()
        shown.locator("#second path").nth(1).click(position={"x": 8, "y": 8})
        assert shown.locator("#said").inner_text() == "hat becomes ball; disc vanishes."
        np.testing.assert_allclose(
            frames_of("hat"),
            compute(Pairing({"box": "box", "hat": "ball"}, ["disc"], []), "linear")["hat"], atol=0.02,
        )  # fmt: skip
        # by keyboard
        shown.locator("#rows select").nth(2).focus()
        shown.keyboard.press("End")
        assert shown.locator("#appear").inner_text() == "These appear: ball."
        text = shown.input_value("#yaml")
        (tmp_path / "pairs.yaml").write_text(text, encoding="utf-8")
        assert load_pairing(tmp_path / "pairs.yaml") == Pairing(
            {"box": "box"}, ["disc", "hat"], ["ball"]
        )
        words = shlex.split(shown.input_value("#command"))
        assert words[:5] == ["python", "-m", "finloop.morph", *drawings]
        shown.focus("#tau")
        shown.keyboard.press("Home")
        shown.click("#play")
        shown.locator("#share", has_text=re.compile("^[1-9]")).wait_for()
        shown.click("#play")
        for width, height in ((1280, 800), (400, 800)):
            shown.set_viewport_size({"width": width, "height": height})
            assert shown.evaluate("document.documentElement.scrollWidth") <= width
        assert not seen.bad
    words[words.index("pairs.yaml")] = str(tmp_path / "pairs.yaml")
    words[words.index("morph.svg")] = str(tmp_path / "morph.svg")
    assert main([*words[3:], "--frames", "3"]) == 0


def test_a_pair_that_cannot_be_shown_says_why_and_its_shapes_vanish_and_appear(tmp_path):
    eight = '<path id="eight" d="M9 40L60 90V40L9 90z"/>'
    many = eight + "".join(f'<path id="s{k}" d="M{9 * k} 5h6v6z"/>' for k in range(PARTNERS + 2))
    paths = [save_svg(tmp_path / f"{name}.svg", many) for name in "ab"]
    page = write_page(tmp_path, paths)
    with chromium() as browser:
        seen = visit(browser, page)
        shown = seen.page
        shown.wait_for_selector("html[data-ready]")
        rows = shown.locator("#rows tr")
        assert "meets itself" in rows.first.inner_text()
        assert "pairs not shown: 1" in shown.locator("#caption").inner_text()
        shown.locator("#rows select").nth(1).select_option("s7")
        assert "not computed: only the 6 nearest" in rows.nth(1).inner_text()
        assert "not computed" in rows.last.inner_text()  # the two have exchanged partners
        assert shown.locator("#morph path").count() == len(["eight"]) + PARTNERS + 2 + 3
        shown.check("text=linear >> input")
        assert "in 5 of 5 frames" in rows.first.inner_text()
        assert not seen.bad


def test_a_page_says_that_it_pairs_one_shape_with_one(tmp_path, capsys):
    parts = '<path id="eye_left" d="M9 9h9v9z"/><path id="eye_right" d="M40 9h9v9z"/>'
    first, second = (
        save_svg(tmp_path / f"{name}.svg", text + '<path id="nose" d="M20 40h9v9z"/>')
        for name, text in (("a", '<path id="eye" d="M9 9h40v9z"/>'), ("b", parts))
    )
    pins = tmp_path / "pins.yaml"
    pins.write_text("pins: {nose: [[[20, 40], [20, 40]]]}", encoding="utf-8")
    for drawings, lost, rest in (
        ((first, second), "eye → eye_left + eye_right", "appear: eye_right"),
        ((second, first), "eye_left + eye_right → eye", "vanish: eye_right"),
    ):
        page = write_page(tmp_path, [*drawings, "--pairs", str(pins), "--level", "1"])
        said = capsys.readouterr().out
        assert f"{rest}; the page leaves out: {lost}, pins of nose" in said
    with chromium() as browser:
        seen = visit(browser, page)
        shown = seen.page
        shown.wait_for_selector("html[data-ready]")
        note = shown.locator("#left-out").inner_text()
        assert "It leaves out: eye_left + eye_right → eye, pins of nose." in note
        assert 'vanish: ["eye_right"]' in shown.input_value("#yaml")
        assert "--level 1 --points 16" in shown.input_value("#command")
        assert not seen.bad


@pytest.mark.parametrize(
    "option",
    [
        ["--force", "gravity=1"],
        ["--method", "linear"],
        ["--back"],
        ["--fps", "9"],
        ["--size", "90"],
    ],
)
def test_an_option_that_a_page_has_no_use_for_is_refused(tmp_path, drawings, option, capsys):
    page = tmp_path / "try.html"
    assert main([*map(str, drawings), "-o", str(page), *option])
    assert f"a trial page (.html) with {option[0]}" in capsys.readouterr().err
    assert not page.exists()


def test_a_page_without_a_browser_holds_text_of_the_drawings_safely(tmp_path):
    evil = save_svg(tmp_path / "<script>x.svg", '<path id="&lt;/script&gt;" d="M9 9h20v20z"/>')
    page = write_page(tmp_path, [evil, evil]).read_text(encoding="utf-8")
    assert page.count("<script>") == 1 and page.count("</script>") == 1
    assert "{{" not in page and "http" not in page.replace(
        "http://www.w3.org/2000/svg", ""
    ).replace("http-equiv", "")
