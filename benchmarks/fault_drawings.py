"""SVG files that do harm: thousands of spoiled drawings, and attributes that are one long pattern.

`python -m benchmarks.fault_drawings` prints the table and writes benchmarks/fault_drawings.csv.
Each file is read as by any tool (`load_svg`). It must give a drawing or one message, within the
limits of time and memory. `--count 10000` says how many drawings are spoiled, `--only 50` runs the
parts whose name has this, `--slow` names all files that take a second of the processor or more.
"""

import argparse
import re
import tempfile
from collections import Counter
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import psutil

from benchmarks.mutations import Rng, mutate
from benchmarks.pipeline import ROOT, write_table
from finloop.base.errors import FinloopError
from finloop.io import svg
from finloop.io.svg import load_svg

XMLNS = 'xmlns="http://www.w3.org/2000/svg"'
RICH = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
 width="10cm" height="50%" viewBox="0 0 100 100" preserveAspectRatio="xMidYMid meet"><style>
svg{--c:var(--d, red);--d:#00f}g > .a, #b{fill:var(--c);stroke:rgb(0 0 255 / .5)!important;
transform:translate(1px, 2px) rotate(9deg)}#k{d:path("M1 2h3v4z")}</style>
<defs><linearGradient id="l" x1="10%" gradientTransform="rotate(30)" spreadMethod="reflect">
<stop offset=".2" stop-color="oklch(0.6 0.2 29)"/><stop offset="90%" stop-opacity=".5"/>
</linearGradient><radialGradient id="r" xlink:href="#l" fx="2" gradientUnits="userSpaceOnUse"/>
<symbol id="s" viewBox="0 0 9 9"><path id="k" d="M0 0h4v4z"/></symbol></defs>
<g id="g" class="a" opacity="50%" transform="matrix(1 .1 0 1 5 5) skewX(3)"><path
 fill="url(#l) red" fill-rule="evenodd" d="M10 10C20 10 40 10 50 50S80 90 90 50zm5 5Q30 0 50
 50T90 50a30 20 9 0160 9z"/>
<ellipse cx="50" cy="40" rx="30" ry="10%" stroke="url(#r)" stroke-width="2mm" stroke-dasharray="4,3"
 stroke-dashoffset="1" pathLength="10"/><rect x="5" width="30" height="20" rx="4"/></g>
<use id="b" href="#s" x="10" width="20" style="fill:hsl(120 100% 50%);stroke-linecap:square"/>
<switch systemLanguage="en, de"><polygon points="1,2 3,4 5 0"/></switch><line x2="9" y2="9"/></svg>
"""
WORDS = (
    *("1e999", "nan", "-", "0", "-1", "1e-320", "99999999999", "%", "url(#l)", "url(#none)", "z"),
    *("var(--c)", "inherit", "none", "calc(1px + 2%)", "/*", "]]>", "&amp;", "&#0;", "\x00", "M"),
    *("\U0001f41f", "é", "<g>", "</g>", "<use href='#g'/>", "<style>*{fill:red}</style>", "a1"),
)
FILLERS = (
    *"a1(){}[]<>,.-+e#;:%*/\\\"'! \n\tMzé",
    *("1 ", "1,", "h1", "a1 ", "rotate(", "rotate(1)", "rotate(1", "var(--a,", "var(--c)", "url("),
    *("calc(", "/*", "*{}", "a{}", "a b ", "a>", "a,", "--a:1;", "--a:var(--c);", "fill:red;"),
    *("M0 0h9v9z", "A1 1 0 0 1 9 9", "1e", "0.", "1-", "&#97;", "path('", "hsl(", "_x41_"),
)
SLOTS = (
    *("d", "points", "transform", "style", "class", "id", "fill", "stroke-dasharray", "opacity"),
    *("stroke-width", "systemLanguage", "viewBox", "preserveAspectRatio", "href", "x"),
    *("pathLength", "gradientTransform", "text of style", "rule of style", "selector of style"),
    *("path in style", "text of element"),
)


class Outcome(NamedTuple):
    """What became of a file: "drawing", "refused", "too much" or "crash", and what it took.

    processor_s, memory_mib: 0 for "too much", which took as much as the limits permit.
    """

    kind: str
    message: str
    processor_s: float
    memory_mib: float


def _choose_word(rng: Rng) -> str:
    """Return one of `WORDS`."""
    return WORDS[int(rng.integers(len(WORDS)))]


def _insert_part(data: bytes, rng: Rng) -> bytes:
    """Insert a part of an SVG anywhere."""
    place = int(rng.integers(len(data) + 1))
    return data[:place] + _choose_word(rng).encode() + data[place:]


def _replace_value(data: bytes, rng: Rng) -> bytes:
    """Replace the value of an attribute, or a number, so that the file stays an SVG."""
    values = list(re.finditer(rb'"[^"<>]*"|[-\d.]+', data))
    if not values:
        return data
    begin, end = values[int(rng.integers(len(values)))].span()
    word = _choose_word(rng).replace("<", "").encode()
    return data[:begin] + (b'"%b"' % word if data[begin:].startswith(b'"') else word) + data[end:]


def spoiled_drawings(count: int, seed: int) -> Iterator[bytes]:
    """Yield drawings that were spoiled at random: of those that are shipped, and a rich one."""
    rng = np.random.default_rng(seed)
    shipped = [path.read_bytes() for path in sorted(ROOT.glob("data/drawings/*.svg"))]
    for number in range(count):
        use_rich = rng.random() < 0.7 or not shipped
        drawing = RICH.encode() if use_rich else shipped[int(rng.integers(len(shipped)))]
        # half of all mutations are of values: most others are no XML any more
        yield mutate(drawing, (seed, number), own=[_insert_part, *[_replace_value] * 10])


def long_patterns(size: int) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the text of drawings in which one value is a pattern, `size` letters."""
    for slot, filler in product(SLOTS, FILLERS):
        pattern = filler * (size // len(filler))
        value = pattern if "&#" in filler else pattern.replace("<", "&lt;").replace('"', "&quot;")
        inside, attributes, root = "", "", 'viewBox="0 0 99 99"'
        match slot:
            case "text of style":
                inside = f"<style>{value}</style>"
            case "rule of style":
                inside = f"<style>*{{{value}}}</style>"
            case "selector of style":
                inside = f"<style>{value}{{fill:red}}</style>"
            case "path in style":
                inside = f"<style>path{{d:path('{value}')}}</style>"
            case "text of element":
                inside = f"<g>{value}</g>"
            case "viewBox" | "preserveAspectRatio":
                root = f'{root if slot[0] == "p" else ""} {slot}="{value}"'
            case "gradientTransform":
                inside = f'<linearGradient id="l" {slot}="{value}"><stop/></linearGradient>'
                attributes = 'fill="url(#l)"'
            case "href":
                inside = f'<use href="#{value}"/>'
            case _:
                attributes = f'{slot}="{value}"'
        path = "" if slot in ("d", "path in style") else 'd="M1 1h9v9z"'
        tag = {"points": "polygon", "x": "rect width='9' height='9'"}.get(slot, f"path {path}")
        yield (
            f"{slot}: {filler!r} × {len(pattern)}",
            f"<svg {XMLNS} {root}>{inside}<{tag} {attributes}/></svg>".encode(),
        )


def crowds(size: int) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the text of drawings of very many parts, about `size` letters long."""
    squares = "".join(
        f"M{x} {x}H{999 - x}V{999 - x}H{x}z" for x in np.linspace(1, 400, 990).round(2)
    )
    attributes = " ".join(f"a{n}='1'" for n in range(size // 9))
    variables = "".join(f"--v{n}:var(--v{n + 1}) var(--v{n + 1});" for n in range(900))
    rules = "".join(f".c{n}{{fill:red}}" for n in range(4000))
    gradients = "".join(f'<linearGradient id="l{n}" href="#l{n + 1}"/>' for n in range(5000))
    shape = '<path d="M0 0h9v9z"/>'
    many = {
        "contours in each other": f'<path d="{squares}"/>',
        "the same, with an outline": f'<path stroke="red" d="{squares}"/>',
        "smooth curves": f'<path d="M0 0{"C1 2 3 4 9 9" * (size // 12)}"/>',
        "arcs": f'<path d="M0 0{"a99 9 9 01 1 9" * (size // 14)}"/>',
        "contours": f'<path d="{"M0 0h9v9z" * (size // 9)}"/>',
        "corners": f'<path d="M0 0{"h1v1" * (size // 4)}"/>',
        "a million corners": f'<path d="M0 0{"h1" * 10**6}"/>',
        "groups": "<g>" * 60 + shape * 999 + "</g>" * 60,
        "shapes": '<rect width="9" height="9"/>' * (size // 28),
        "attributes": f"<g {attributes}/>{shape}",
        "variables": f"<style>*{{{variables}fill:var(--v0)}}</style>{shape * 99}",
        "rules": f"<style>{rules}</style>{shape * 900}",
        "gradients in a row": gradients + '<path fill="url(#l0)" d="M0 0h9v9z"/>' * 500,
    }
    for name, body in many.items():
        yield name, f'<svg {XMLNS} viewBox="0 0 999 999">{body}</svg>'.encode()


def judge_drawing(path: Path) -> Outcome:
    """Read a file as any tool does; return what became of it."""
    before_s, _ = _use_of_parser()
    kind, message = "drawing", ""
    try:
        load_svg(path)
    except FinloopError as error:
        kind, message = "refused", str(error)
        if "takes more than" in error.came:
            return Outcome("too much", message, 0.0, 0.0)  # its process has ended
    except Exception as error:
        kind, message = "crash", repr(error)
    after_s, memory_mib = _use_of_parser()
    return Outcome(kind, message, after_s - before_s, memory_mib)


def _use_of_parser() -> tuple[float, float]:
    """Return the seconds of the processor, and the MiB, that the process that parses has used."""
    found = svg._PARSER._process
    if found is None:
        return 0.0, 0.0
    process = psutil.Process(found.pid)
    times = process.cpu_times()
    return times.user + times.system, process.memory_info().rss / 2**20


def judge_all(what: str, drawings: Iterator[tuple[str, bytes]], slow: bool) -> dict[str, object]:
    """Return a row of the table: what became of some drawings; print crashes, and slow ones."""
    kinds, outcomes = Counter[str](), list[Outcome]()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drawing.svg"
        for name, content in drawings:
            path.write_bytes(content)
            outcome = judge_drawing(path)
            kinds[outcome.kind] += 1
            outcomes.append(outcome)
            if outcome.kind in ("crash", "too much") or (slow and outcome.processor_s > 1):
                words = f"{name} {outcome.message[:200]}"
                print(f"{outcome.kind}, {outcome.processor_s:.1f} s: {words}", flush=True)
    return {
        "what": what, "files": len(outcomes), "drawings": kinds["drawing"],
        "refused_by_name": kinds["refused"], "refused_by_limit": kinds["too much"],
        "crashes": kinds["crash"],
        "others_processor_s": round(max(one.processor_s for one in outcomes), 1),
        "others_memory_mib": round(max(one.memory_mib for one in outcomes)),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=10_000, help="of spoiled drawings")
    parser.add_argument("--only", help="a part of the table's first column")
    parser.add_argument("--slow", action="store_true")
    options = parser.parse_args()
    spoiled = (("", content) for content in spoiled_drawings(options.count, 0))
    parts: dict[str, Iterator[tuple[str, bytes]]] = {
        "spoiled at random": spoiled,
        "one long value, 50 kB": long_patterns(50_000),
        "one long value, 400 kB": long_patterns(400_000),
        "very many parts": crowds(400_000),
    }
    rows = [
        judge_all(what, drawings, options.slow)
        for what, drawings in parts.items()
        if options.only is None or options.only in what
    ]
    write_table(__file__, pd.DataFrame(rows), part="what")


if __name__ == "__main__":
    main()
