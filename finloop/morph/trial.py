"""Build the trial page of a morph, on which to try pairs of shapes, methods and weights.

One HTML file without a server. The frames of all pairs that it can show are computed here; the page
plays them, and writes the file of pairs and the command for what the user has chosen.
"""

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from finloop.base.drawing import Drawing, Morph
from finloop.base.errors import FinloopError
from finloop.base.paint import painted_frames, shape_of
from finloop.base.style import Fill, Gradient, Paint, format_colour
from finloop.morph.layers import PhysicalOptions, fit_drawing, morph_drawings
from finloop.morph.match import Resolution
from finloop.morph.pairs import Pairing, pair_drawings, pair_shapes, shape_contours

FRAMES, POINTS = 25, 128  # of the page's morphs, without options
PARTNERS = 6  # nearest shapes of the second drawing that each shape of the first is morphed into
FACTORS = (0.25, 1.0, 4.0)
"""Stiffness and damping of the physical morph, as factors of those given. Mass is none of the
choices: only stiffness and damping per mass change a motion."""
GRID = 8192  # steps of a coordinate in the longer side of the picture
Json = dict[str, Any]


class TrialOptions(NamedTuple):
    """How the morphs on the trial page are computed."""

    frames: int
    points: int
    resolution: Resolution
    physics: PhysicalOptions


def build_trial_page(
    a: Drawing, b: Drawing, given: Pairing | None, names: tuple[str, str], options: TrialOptions
) -> tuple[str, str]:
    """Return the HTML of the trial page of two drawings, and a summary in words.

    given: pairs that go before the tool's own; names: of the drawings' files, as a shell takes
    them. The page pairs one shape with one: both say what it leaves out. FinloopError if a shape
    can neither vanish nor appear.
    """
    b = fit_drawing(b, a.width, a.height)
    pairing, left_out = _keep_single_pairs(pair_shapes(a, b, given))
    geometry = _Geometry(max(a.width, a.height) / GRID)
    candidates = [
        _candidate(a, b, first, second, geometry, options)
        for first, second in _choose_candidates(a, b, pairing)
    ]
    given_names = {*given.pairs, *given.splits} if given else set()
    content: Json = {
        "width": a.width, "height": a.height, "grid": geometry.grid, "frames": options.frames,
        "names": names, "first": list(shape_contours(a)), "second": list(shape_contours(b)),
        "pairs": dict(pairing.pairs), "candidates": candidates,
        "how": {
            name: "by the file of pairs" if name in given_names
            else "by place and shape" if name in pairing.proposed else "by id"
            for name in pairing.pairs
        },
        "elastic": [factor * options.physics.elastic for factor in FACTORS],
        "damping": [factor * options.physics.damping for factor in FACTORS],
        "mass": options.physics.mass,
        "stiffness_damping": options.physics.stiffness_damping,
        "level": options.resolution.level, "wavelet": options.resolution.wavelet,
        "partners": PARTNERS, "points": options.points, "left_out": left_out,
    }  # fmt: skip
    page = Path(__file__).with_name("trial.html").read_text(encoding="utf-8")
    title = f"{Path(names[0].strip(chr(39))).stem} → {Path(names[1].strip(chr(39))).stem}"
    for mark, value in {
        "title": escape(title),
        "content": _pack(json.dumps(content, separators=(",", ":")).encode()),
        "geometry": _pack(geometry.to_bytes()),
    }.items():
        page = page.replace(f"{{{{{mark}}}}}", value)
    shown = sum(c["first"] is not None and c["second"] is not None for c in candidates)
    summary = f"pairs: {len(pairing.pairs)} of {shown} computed, {options.frames} frames"
    return page, "; ".join(filter(None, [summary, pairing.summary, left_out]))


def _keep_single_pairs(pairing: Pairing) -> tuple[Pairing, str]:
    """Return a pairing of one shape to one, and in words what it leaves out; "" if nothing.

    Of several shapes that one becomes, or that become one, the first keeps its partner.
    """
    pairs = dict[str, str]()
    parts = dict[str, list[str]]()  # of the second drawing's shapes
    for name, other in pairing.pairs.items():
        if other not in parts:
            pairs[name] = other
        parts.setdefault(other, []).append(name)
    pairs |= {name: others[0] for name, others in pairing.splits.items()}
    lost = [f"{' + '.join(names)} → {other}" for other, names in parts.items() if len(names) > 1]
    lost += [f"{name} → {' + '.join(others)}" for name, others in pairing.splits.items()]
    lost += [f"pins of {name}" for name in pairing.pins]
    single = Pairing(
        pairs,
        [*pairing.vanish, *(name for names in parts.values() for name in names[1:])],
        [*pairing.appear, *(name for others in pairing.splits.values() for name in others[1:])],
        pairing.proposed,
    )
    return single, f"the page leaves out: {', '.join(lost)}" if lost else ""


def _pack(content: bytes) -> str:
    """Return bytes as text for a page: compressed and in base64."""
    return base64.b64encode(zlib.compress(content, 9)).decode()


class _Geometry:
    """All coordinates of the trial page, as whole steps of a grid."""

    def __init__(self, grid: float) -> None:
        """Start without coordinates; grid: size of a step, in units of the drawing."""
        self.grid, self.size, self.parts = grid, 0, list[bytes]()

    def add(self, stack: Sequence[np.ndarray]) -> Json:
        """Store contours, (f, n, 2) each; return where they begin and how many frames they have.

        Frames that are evenly between the first and the last are left out: the page blends.
        """
        points = np.concatenate(stack, axis=1)
        tau = np.linspace(0, 1, len(points))[:, None, None]
        even = (1 - tau) * points[0] + tau * points[-1]
        if abs(points - even).max() < self.grid:
            points = points[[0, -1]]
        limit = np.iinfo(np.int16)
        steps = np.clip(np.round(points / self.grid), limit.min, limit.max).astype(np.int16)
        self.parts.append(np.diff(steps, axis=0, prepend=np.int16(0)).astype("<i2").tobytes())
        place = {"at": self.size, "frames": len(points)}
        self.size += points.size
        return place

    def to_bytes(self) -> bytes:
        """Return all stored coordinates as int16, lowest byte first."""
        return b"".join(self.parts)


def _choose_candidates(
    a: Drawing, b: Drawing, pairing: Pairing
) -> list[tuple[str | None, str | None]]:
    """Return the pairs of shapes offered on the page; None stands for no partner.

    Each shape of the first drawing has the PARTNERS nearest ones of the second, and the one that it
    is paired with.
    """
    first, second = shape_contours(a), shape_contours(b)
    middles = [
        {name: np.mean(np.concatenate([c.points for c in curves]), axis=0)
         for name, curves in shapes.items()}
        for shapes in (first, second)
    ]  # fmt: skip
    pairs: list[tuple[str | None, str | None]] = []
    for name, middle in middles[0].items():
        far = {other: float(np.hypot(*(middle - place))) for other, place in middles[1].items()}
        near = sorted(far, key=far.__getitem__)[:PARTNERS]
        paired = [pairing.pairs[name]] if name in pairing.pairs else []
        pairs += [(name, other) for other in dict.fromkeys([*paired, *near])]
    return [*pairs, *((name, None) for name in first), *((None, name) for name in second)]


def _candidate(
    a: Drawing, b: Drawing, first: str | None, second: str | None, geometry: _Geometry,
    options: TrialOptions,
) -> Json:  # fmt: skip
    """Return the page's data of a pair of shapes: paints, and a motion by every method.

    first, second: their ids; None for a shape that appears, or vanishes.
    """
    pairing = Pairing(
        {first: second} if first and second else {},
        [first] if first and not second else [],
        [second] if second and not first else [],
    )
    ends = pair_drawings(_take_shape(a, first), _take_shape(b, second), pairing)
    motions: Json = {}
    result: Json = {"first": first, "second": second, "motions": motions}
    weights = {
        f"physical {k} {m}": options.physics._replace(
            elastic=FACTORS[k] * options.physics.elastic,
            damping=FACTORS[m] * options.physics.damping,
        )
        for k, m in product(range(len(FACTORS)), repeat=2)
    }
    for key in ("linear", "fold_free", *weights):
        method, physics = key.split()[0], weights.get(key, options.physics)
        try:
            morph = morph_drawings(
                *ends, method, options.frames, options.points, options.resolution, physics
            )
        except FinloopError as error:
            if key == "linear" and None in (first, second):
                raise
            motions[key] = {"error": f"{error.came}; wanted: {error.wanted}"}
            continue
        stacks = list(morph.layers.values())
        motions[key] = geometry.add(stacks) | {
            "sizes": [stack.shape[1] for stack in stacks],
            "closed": list(morph.closed.values()),
            "folds": int(np.any(list(morph.folds.values()), axis=0).sum()),
            "covers": max(morph.count_cover_frames().values(), default=0),
        }
        if "paints" not in result:
            result["paints"] = _list_paints(morph)
    return result


def _take_shape(drawing: Drawing, shape: str | None) -> Drawing:
    """Return a drawing of one of its shapes alone, or of none."""
    curves = {name: curve for name, curve in drawing.curves.items() if shape_of(name) == shape}
    return replace(
        drawing,
        curves=curves,
        styles={name: paint for name, paint in drawing.styles.items() if name in curves},
        groups={},
    )


def _list_paints(morph: Morph) -> list[Json]:
    """Return the paint of a morph's only shape in each frame; one paint if all are equal."""
    paints = [_paint_values(shape.paint) for shape in painted_frames(morph)[0]]
    return paints[:1] if all(paint == paints[0] for paint in paints) else paints


def _paint_values(paint: Paint) -> Json:
    """Return a paint as plain values for the page."""
    values: Json = {"fill": _fill_values(paint.fill), "stroke": _fill_values(paint.stroke)}
    if paint.fill is not None:
        values["fill-opacity"] = round(paint.fill_opacity, 4)
    if paint.stroke is not None:
        values |= {"stroke-opacity": round(paint.stroke_opacity, 4),
                   "stroke-width": round(paint.width, 4)}  # fmt: skip
    if paint.dashes:
        values |= {"stroke-dasharray": " ".join(f"{length:.5g}" for length in paint.dashes),
                   "stroke-dashoffset": round(paint.dash_offset, 4),
                   "stroke-linecap": "round" if paint.round_dashes else "butt"}  # fmt: skip
    return values


def _fill_values(fill: Fill) -> str | Json:
    """Return a fill for the page: "none", "#rrggbb", or what an SVG gradient needs."""
    if fill is None:
        return "none"
    if not isinstance(fill, Gradient):
        return format_colour(fill)
    place: Mapping[str, Any] = {"x1": 0, "y1": 0, "x2": 1, "y2": 0}
    if fill.kind == "radial":
        place = {"cx": 0, "cy": 0, "r": 1, "fx": fill.focus[0], "fy": fill.focus[1]}
    matrix = " ".join(f"{value:.6g}" for value in fill.matrix)
    return {
        "kind": f"{fill.kind}Gradient",
        "place": {**place, "gradientTransform": f"matrix({matrix})", "spreadMethod": fill.spread},
        "stops": [
            [round(stop.offset, 4), format_colour(stop.colour), round(stop.opacity, 4)]
            for stop in fill.stops
        ],
    }
