"""Morphs as files, by their ending: animated SVG, WebP, MP4, plain JSON, Lottie JSON, Spine JSON.

An SVG moves by SMIL, which every browser plays, or, with the ending .css.svg, by CSS.

A file appears under its name when it is complete. SVG and plain JSON hold the morph's numbers digit
for digit, so the frames have exactly the counted folds. Lottie, which needs six numbers for each
point and key frame, leaves out points and frames between which straight lines do as well.
"""

import io
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from math import ceil, floor, log10
from pathlib import Path
from typing import Any, cast
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from finloop.base.arrays import Floats, Ints, Picture, Points
from finloop.base.drawing import Morph
from finloop.base.errors import FinloopError
from finloop.base.paint import Shape, group_contours, paint_layers, painted_frames
from finloop.base.parallel import Threads, ordered_map
from finloop.base.style import (
    Colour,
    Fill,
    Gradient,
    Paint,
    align_dashes,
    format_colour,
    scale_paint,
)
from finloop.io.atomic import save_bytes
from finloop.io.movie import Mp4Writer
from finloop.io.record import save_json
from finloop.io.spine import save_spine
from finloop.io.video import THREADS

CRF = 18  # quality of MP4, 0 = best
EFFORT = 50  # of making WebP small, 0 … 100
SLOWEST, FASTEST = 0.1, 1000  # frames per second: the limits of a film's clock
LARGEST_PX = 2048
LINE_ERROR, VALUE_ERROR = 1e-3, 3e-3
"""How far lines in Lottie may be off, as a share of the picture's longer side, and other values, as
a share of the largest: half a pixel of 512, and less than a level of a colour."""
ROUND = 1.01  # longer to shorter half axis of an ellipse that counts as a circle
Json = dict[str, Any]


def save_animation(
    path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int = 512
) -> str:
    """Write a morph to a file in the format of its ending; return what the format cannot hold.

    The result is a phrase for the user, "" if nothing is lost. frame_rate: frames per second.
    longer_side_px: of the pictures in WebP and MP4. FinloopError if the ending is not one of
    `ENDINGS`, or if rate or side are out of their ranges.
    """
    write = find_morph_writer(path)
    if not SLOWEST <= frame_rate <= FASTEST:
        raise FinloopError(
            f"{float(frame_rate):g} frames per second",
            f"{SLOWEST:g} … {FASTEST} frames per second",
            "set --fps 30",
        )
    if not 16 <= longer_side_px <= LARGEST_PX:
        raise FinloopError(
            f"a film {longer_side_px} px large", f"16 … {LARGEST_PX} px", "set --size 512"
        )
    return write(path, morph, frame_rate, longer_side_px) or ""


def find_morph_writer(path: Path) -> "Writer":
    """Return the function that writes morphs in the format of a path's ending, such as ".svg".

    FinloopError if no format has this ending.
    """
    name = path.name.lower()
    for ending, write in ENDINGS.items():
        if name == ending:
            break
        if name.endswith(ending):
            return write
    raise FinloopError(
        f"{path} has the ending {path.suffix or 'of no format'!r}",
        f"one of {', '.join(ENDINGS)}",
        "name the output after the format you want",
    )


def _save_plain(path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int) -> None:
    """Write a morph as JSON with the points of every contour in every frame.

    The content is `{"frames": [{"tau": t, "layers": {id: [[x, y], …]}}]}`; tau is the time within
    the morph, 0 … 1. frame_rate and longer_side_px are not used: JSON has neither.
    """
    save_json(path, {"frames": [
        {"tau": float(tau), "layers": {
            name: points[frame].tolist() for name, points in morph.layers.items()
        }}
        for frame, tau in enumerate(morph.tau)
    ]}, indent=None)  # fmt: skip


# --- animated SVG (SMIL or CSS): it plays by itself in browsers, without a script


def _save_svg(path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int) -> None:
    """Write a morph as an SVG that plays by itself, with one animated path for every shape.

    It moves by CSS if the path ends with .css.svg, else by SMIL. Points are written as whole
    numbers, in units of the last decimal of the drawing's coordinates, each after the first
    relative to the previous one. That is exact, and half as long as decimals. frame_rate: frames
    per second. longer_side_px is not used: the picture is scalable.
    """
    grid = 10.0**morph.decimals  # units of a path in a px
    seconds = len(morph.tau) / frame_rate
    width, height = f"{morph.width:.10g}", f"{morph.height:.10g}"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}"'
        f' viewBox="0 0 {width} {height}">',
        f'<g transform="scale({1 / grid:.10g})" stroke-linejoin="round" stroke-linecap="round"'
        ' fill-rule="evenodd">',
    ]
    kind = _CssAnimator if path.name.lower().endswith(".css.svg") else _SmilAnimator
    animator = kind(f"{float(seconds):.6g}s", morph.end_frame)
    for number, frames in enumerate(painted_frames(morph)):
        shape = frames[0]
        contours = [np.round(morph.layers[name] * grid).astype(np.int64) for name in shape.layers]
        paths = [
            "".join(map(_svg_path_data, frame_contours, shape.closed))
            for frame_contours in zip(*contours, strict=True)
        ]
        paints = [scale_paint(frame.paint, grid, np.zeros(2)) for frame in frames]
        kinds = _split_by_paint_kind(paints)
        for part, (kind_paints, is_shown) in enumerate(kinds):
            # Gradients of two kinds need two paths, of which one is shown at a time.
            name = f"id={quoteattr(shape.name)} " if part == 0 else ""
            defs, attributes, animations = _svg_paint(
                kind_paints, animator, f"paint-{number}-{part}"
            )
            animations += animator.animate("d", paths)
            if not is_shown.all():
                words = ["visible" if shown else "hidden" for shown in is_shown]
                attributes += f' visibility="{words[0]}"'
                animations += animator.switch("visibility", words)
            d = quoteattr(paths[0])
            style, children = animator.place(animations)
            lines.append(f"{defs}<path {name}{attributes}{style} d={d}>{children}</path>")
    save_bytes(path, "\n".join([*lines, "</g>", *animator.rules, "</svg>", ""]).encode())


def _split_by_paint_kind(
    paints: list[Paint], by_caps: bool = False
) -> list[tuple[list[Paint], NDArray[np.bool_]]]:
    """Split a shape's paints by their kinds: colour, linear or radial gradient, of fill and stroke.

    Players cannot change the kind during an animation. paints: one for each frame. by_caps: whether
    dashes with other end caps also count as another kind. The result has two items for each kind: a
    paint for every frame, from the nearest frame of this kind, and a mask (f,) of the kind's
    frames.
    """
    kinds = [
        (
            *(
                fill.kind if isinstance(fill, Gradient) else "colour"
                for fill in (paint.fill, paint.stroke)
            ),
            by_caps and bool(paint.dashes) and not paint.round_dashes,
        )
        for paint in paints
    ]
    frames = np.arange(len(paints))
    parts = []
    for kind in dict.fromkeys(kinds):
        is_shown = np.array([other == kind for other in kinds])
        shown = frames[is_shown]
        nearest = shown[np.abs(frames[:, None] - shown).argmin(axis=1)]
        parts.append(([paints[frame] for frame in nearest], is_shown))
    return parts


def _svg_path_data(points: Ints, closed: bool) -> str:
    """Return the `d` attribute of an SVG path through points (n, 2), whole numbers."""
    text = " ".join(map(str, np.diff(points, axis=0).ravel().tolist())).replace(" -", "-")
    return f"M{points[0, 0]} {points[0, 1]}l{text}{'z' if closed else ''}"


class _SmilAnimator:
    """Writer of SVG animation elements, all of one duration, from a value for each frame."""

    def __init__(self, duration: str, end_frame: int) -> None:
        """Start; duration: such as "2s"; end_frame: the frame after the last."""
        self.duration, self.end_frame = duration, end_frame
        self.rules = list[str]()  # lines at the end of the file

    def animate(self, attribute: str, values: Sequence[str]) -> str:
        """Return what changes an attribute smoothly; "" if all values are equal."""
        if len(set(values)) == 1 and attribute != "d":
            return ""
        return self._write(attribute, [*values, values[self.end_frame]], "")

    def switch(self, attribute: str, values: Sequence[str]) -> str:
        """Return what changes an attribute at once at every frame."""
        return self._write(attribute, values, 'calcMode="discrete" ')

    def switch_gradient(self, attribute: str, names: Sequence[str]) -> tuple[str, str]:
        """Return what switches between gradients: text for the gradient, and text for the path.

        One of them is "". attribute: fill or stroke (SMIL ignores it); names: "#id" of each frame.
        """
        return self.switch("href", names), ""

    def place(self, animations: str) -> tuple[str, str]:
        """Return a path's further attributes and children, which hold its animations."""
        return "", animations

    def _write(self, attribute: str, values: Sequence[str], how: str) -> str:
        """Return the animation element of an attribute."""
        timing = f'{how}dur="{self.duration}" repeatCount="indefinite"'
        return f'<animate attributeName="{attribute}" {timing} values="{";".join(values)}"/>'


class _CssAnimator(_SmilAnimator):
    """Writer of CSS animations: keyframes at the end of the file, which a path's style names."""

    def switch_gradient(self, attribute: str, names: Sequence[str]) -> tuple[str, str]:
        """Return "" and the animation of the path, since CSS cannot change a gradient's href."""
        return "", self.switch(attribute, [f"url({name})" for name in names])

    def place(self, animations: str) -> tuple[str, str]:
        """Return a path's further attributes and children, which hold its animations."""
        return f' style="animation:{animations.rstrip(",")}"' if animations else "", ""

    def _write(self, attribute: str, values: Sequence[str], how: str) -> str:
        """Return the animation of a property, for a list of them, and keep its keyframes."""
        if len(set(values)) == 1:
            return ""
        name, last = f"move-{len(self.rules)}", len(values) - (not how)
        form = 'path("{}")' if attribute == "d" else "{}"
        frames = "".join(
            f"{100 * k / last:.6g}%{{{attribute}:{form.format(value)}}}"
            for k, value in enumerate(values)
        )
        self.rules.append(f"<style>@keyframes {name}{{{frames}}}</style>")
        return f"{name} {self.duration} {'step-end' if how else 'linear'} infinite,"


def _svg_paint(paints: list[Paint], animator: _SmilAnimator, name: str) -> tuple[str, str, str]:
    """Return the SVG text for a shape's fill and stroke: gradients, attributes and animations.

    paints: one for each frame, in units of the path, with gradients of one kind. name: prefix of
    the gradients' ids, unique in the file.
    """
    defs, animations = "", ""
    attributes = dict[str, str]()

    def add_values(key: str, values: list[str], usual: str = "") -> None:
        """Add an attribute with its value in every frame, unless all are the default (`usual`)."""
        nonlocal animations
        if set(values) != {usual}:
            attributes[key] = values[0]
            animations += animator.animate(key, values)

    for key in ("fill", "stroke"):
        fills: list[Fill] = [getattr(paint, key) for paint in paints]
        if isinstance(fills[0], Gradient):
            own, turn = _svg_gradient(cast("list[Gradient]", fills), animator, f"{name}-{key}", key)
            defs += own
            animations += turn
            attributes[key] = f"url(#{name}-{key})"
        else:
            add_values(key, [_svg_colour(cast("Colour | None", fill)) for fill in fills])
        if fills[0] is not None:
            opacities = [f"{getattr(paint, f'{key}_opacity'):.4g}" for paint in paints]
            add_values(f"{key}-opacity", opacities, "1")
    if paints[0].stroke is not None:
        add_values("stroke-width", [f"{paint.width:.6g}" for paint in paints])
        lines = align_dashes(paints)
        if lines[0].dashes:
            dashes = [" ".join(f"{length:.6g}" for length in line.dashes) for line in lines]
            add_values("stroke-dasharray", dashes)
            add_values("stroke-dashoffset", [f"{line.dash_offset:.6g}" for line in lines], "0")
            caps = [
                "butt" if paint.dashes and not paint.round_dashes else "round" for paint in paints
            ]
            attributes["stroke-linecap"] = caps[0]
            if len(set(caps)) > 1:
                animations += animator.switch("stroke-linecap", caps)
    return defs, " ".join(f'{key}="{value}"' for key, value in attributes.items()), animations


def _svg_colour(colour: Colour | None) -> str:
    """Return a colour as #rrggbb, or "none"."""
    return "none" if colour is None else format_colour(colour)


def _svg_gradient(
    gradients: list[Gradient], animator: _SmilAnimator, name: str, attribute: str
) -> tuple[str, str]:
    """Return the SVG definition of a gradient that changes from frame to frame.

    The second text is what a path that it paints needs for that. attribute: fill or stroke.

    It has an element for each different gradient, and one called `name` that refers to them in
    turn. gradients: one for each frame, of one kind, in units of the path.
    """
    tag = f"{gradients[0].kind}Gradient"
    defs, names = dict[Gradient, str](), list[str]()
    for gradient in gradients:
        defs.setdefault(gradient, f"{name}-{len(defs)}")
        names.append(f"#{defs[gradient]}")
    lines = []
    for gradient, own_name in defs.items():
        matrix = " ".join(f"{value:.9g}" for value in gradient.matrix)
        place = 'x1="0" y1="0" x2="1" y2="0"'
        if gradient.kind == "radial":
            place = 'cx="0" cy="0" r="1" fx="{:.6g}" fy="{:.6g}"'.format(*gradient.focus)
        stops = "".join(
            f'<stop offset="{stop.offset:.6g}" stop-color="{_svg_colour(stop.colour)}"'
            + (f' stop-opacity="{stop.opacity:.4g}"' if stop.opacity < 1 else "")
            + "/>"
            for stop in gradient.stops
        )
        lines.append(
            f'<{tag} id="{own_name}" gradientUnits="userSpaceOnUse" {place}'
            f' gradientTransform="matrix({matrix})" spreadMethod="{gradient.spread}">'
            f"{stops}</{tag}>"
        )
    turn, turn_path = animator.switch_gradient(attribute, names) if len(defs) > 1 else ("", "")
    lines.append(f'<{tag} id="{name}" href="{names[0]}">{turn}</{tag}>')
    return f"<defs>{''.join(lines)}</defs>", turn_path


# --- Lottie (version 5.7), the vector animation of apps and web pages


def _save_lottie(path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int) -> str:
    """Write a morph as Lottie JSON; return what Lottie cannot hold, "" if nothing is lost.

    A shape becomes a layer, the topmost first. Players interpolate linearly between keyframes:
    those frames that they need to stay within LINE_ERROR and VALUE_ERROR. frame_rate: frames per
    second. longer_side_px is not used: the picture is scalable.
    """
    layers = [
        _lottie_layer(morph, frames, k) for k, frames in enumerate(painted_frames(morph)[::-1], 1)
    ]
    # fr: frames per second; ip, op: first frame, and the one after the last; ddd: three dimensions.
    save_json(path, {
        "v": "5.7.0", "fr": float(frame_rate), "ip": 0, "op": len(morph.tau),
        "w": ceil(morph.width), "h": ceil(morph.height), "nm": "morph", "ddd": 0, "assets": [],
        "layers": layers,
    }, indent=None)  # fmt: skip
    return _lottie_losses(morph)


def _lottie_layer(morph: Morph, frames: list[Shape], index: int) -> Json:
    """Return the Lottie layer that shows one shape of a morph.

    frames: the shape in every frame. index: number of the layer, 1 = topmost.
    """
    shape = frames[0]
    # Opacity, rotation, position, anchor and scale that change nothing.
    transform = {"o": 100, "r": 0, "p": [0, 0], "a": [0, 0], "s": [100, 100]}
    still = {key: _lottie_constant(value) for key, value in transform.items()}
    items = [
        *(_lottie_path(morph, *part) for part in zip(shape.layers, shape.closed, strict=True)),
        *_lottie_paints([frame.paint for frame in frames]),
        {"ty": "tr", **still},
    ]
    # Type 4 is a layer of shapes, "gr" a group of them, "tr" its transform.
    return {
        "ddd": 0, "ind": index, "ty": 4, "nm": shape.name, "sr": 1, "ks": still, "ao": 0,
        "shapes": [{"ty": "gr", "nm": shape.name, "it": items}],
        "ip": 0, "op": len(morph.tau), "st": 0, "bm": 0,
    }  # fmt: skip


def _lottie_path(morph: Morph, name: str, closed: bool) -> Json:
    """Return the Lottie path of one contour of a morph, with keyframes.

    name: of the contour in `morph.layers`. closed: whether its end joins its beginning.
    """
    stack, error = morph.layers[name], LINE_ERROR * max(morph.width, morph.height)
    stack = stack[:, _find_needed_points(stack, closed, error / 4)]
    keys = _find_needed_frames(stack, 3 * error / 4)
    decimals = min(morph.decimals, 1 - floor(log10(error)))  # to a tenth of the error or finer
    frames = np.round(stack[keys], decimals).tolist()
    straight = [[0, 0]] * stack.shape[1]  # tangents of length 0: polylines
    values = [{"i": straight, "o": straight, "v": points, "c": closed} for points in frames]
    return {"ty": "sh", "nm": name, "ks": {"a": 1, "k": _lottie_keyframes(keys, values)}}


def _find_needed_rows(rows: int, errors: Callable[[int, int], Floats], most: float) -> list[int]:
    """Return the rows to keep, so that those left out are off by at most `most`.

    errors: gives how far off the rows first + 1 … last − 1 are, if only first and last are kept
    (Douglas and Peucker 1973).
    """
    kept, spans = {0, rows - 1}, [(0, rows - 1)]
    while spans:
        first, last = spans.pop()
        if last - first > 1:
            off = errors(first, last)
            middle = first + 1 + int(off.argmax())
            if off.max() > most:
                kept.add(middle)
                spans += [(first, middle), (middle, last)]
    return sorted(kept)


def _find_needed_frames(values: Floats, most: float) -> list[int]:
    """Return the frames to keep of values (f, …), between which others are nearly linear in time.

    most: by how much a number may be off.
    """
    flat = values.reshape(len(values), -1)

    def errors(first: int, last: int) -> Floats:
        """Return the largest error of each frame between first and last."""
        share = (np.arange(first + 1, last) - first)[:, None] / (last - first)
        even = flat[first] + share * (flat[last] - flat[first])
        return np.asarray(np.abs(flat[first + 1 : last] - even).max(axis=1))

    return _find_needed_rows(len(values), errors, most)


def _find_needed_points(stack: Points, closed: bool, most: float) -> list[int]:
    """Return the points to keep of a contour (f, n, 2), between which others are nearly on a line.

    closed: whether its end joins its beginning. most: distance from the line, in any frame.
    """
    points = np.concatenate([stack, stack[:, :1]], axis=1) if closed else stack

    def errors(first: int, last: int) -> Floats:
        """Return the largest distance of each point between first and last from their line."""
        offset = points[:, first + 1 : last] - points[:, [first]]
        chord = points[:, [last]] - points[:, [first]]
        length = np.maximum((chord**2).sum(axis=2, keepdims=True), 1e-300)
        share = np.clip((offset * chord).sum(axis=2, keepdims=True) / length, 0, 1)
        return np.asarray(np.hypot(*np.moveaxis(offset - share * chord, 2, 0)).max(axis=0))

    kept = _find_needed_rows(points.shape[1], errors, most)
    kept = kept[:-1] if closed else kept
    count = stack.shape[1]
    return kept if len(kept) > 2 - (not closed) else [0, count // 3, 2 * count // 3]  # a point


def _lottie_keyframes(frames: Sequence[int], values: Sequence[Any]) -> list[Json]:
    """Return Lottie keyframes: values, each at its frame."""
    keys: list[Json] = [{"t": k, "s": [value]} for k, value in zip(frames, values, strict=True)]
    # Linear easing to the next keyframe; the last has none, or players would look for one more.
    for key in keys[:-1]:
        key |= {"i": {"x": 1, "y": 1}, "o": {"x": 0, "y": 0}}
    return keys


def _lottie_paints(paints: list[Paint]) -> list[Json]:
    """Return the Lottie items that paint a shape: its strokes, and then its fills, which lie below.

    paints: one for each frame. An elliptical gradient becomes a circular one of the same area.
    """
    items: list[Json] = []
    for key, letter in (("stroke", "s"), ("fill", "f")):
        for kind_paints, is_shown in _split_by_paint_kind(paints, by_caps=key == "stroke"):
            fills: list[Fill] = [getattr(paint, key) for paint in kind_paints]
            if fills[0] is None:
                continue
            opacities = [
                100 * getattr(paint, f"{key}_opacity") * bool(shown)
                for paint, shown in zip(kind_paints, is_shown, strict=True)
            ]
            item: Json = {"ty": letter + "tl"[key == "fill"], "o": _lottie_property(opacities)}
            if isinstance(fills[0], Gradient):
                item |= {"ty": f"g{letter}"} | _lottie_gradient(cast("list[Gradient]", fills))
            else:
                colours = [
                    [*(round(level / 255, 4) for level in colour), 1]
                    for colour in cast("list[Colour]", fills)
                ]
                item["c"] = _lottie_property(colours)
            item |= _lottie_stroke(kind_paints) if key == "stroke" else {"r": 2}  # 2: even-odd
            items.append(item)
    return items


def _lottie_stroke(paints: list[Paint]) -> Json:
    """Return the width of a Lottie stroke and its dashes, in every frame."""
    line: Json = {"w": _lottie_property([paint.width for paint in paints]), "lc": 2, "lj": 2}
    paints = align_dashes(paints)
    if not paints[0].dashes:
        return line  # 2: round ends and joins
    dashes = [
        {"n": "dg"[k % 2], "v": _lottie_property(list(lengths))}
        for k, lengths in enumerate(zip(*(paint.dashes for paint in paints), strict=True))
    ]
    offset = {"n": "o", "v": _lottie_property([paint.dash_offset for paint in paints])}
    return line | {"d": [*dashes, offset], "lc": 2 if paints[0].round_dashes else 1}


def _lottie_gradient(gradients: list[Gradient]) -> Json:
    """Return a Lottie gradient: its kind, and its end points and stops in every frame."""
    starts, ends, stops = list[list[float]](), list[list[float]](), list[list[float]]()
    for gradient in gradients:
        rows = np.reshape(gradient.matrix, (3, 2))
        start, reach = rows[2], rows[0]
        if gradient.kind == "radial":
            reach = np.array([np.sqrt(abs(np.linalg.det(rows[:2]))), 0])
        elif area := float(np.linalg.det(rows[:2])):
            # A skewed gradient changes fastest across its lines of equal colour.
            across = rows[1, ::-1] * [1, -1]
            reach = across * area / (across @ across)
        starts.append(start.tolist())
        ends.append((start + reach).tolist())
        # First all offsets with their colours, then all offsets with their opacities.
        colours = [[stop.offset, *np.divide(stop.colour, 255)] for stop in gradient.stops]
        opacities = [[stop.offset, stop.opacity] for stop in gradient.stops]
        stops.append([round(float(value), 4) for part in (*colours, *opacities) for value in part])
    item = {
        "t": 1 if gradients[0].kind == "linear" else 2,
        "s": _lottie_property(starts),
        "e": _lottie_property(ends),
        "g": {"p": len(gradients[0].stops), "k": _lottie_property(stops)},
    }
    if gradients[0].kind == "radial":
        # Length in per cent of the radius, and angle against start → end, which runs to the right.
        focus = [
            np.array(gradient.focus) @ np.reshape(gradient.matrix, (3, 2))[:2]
            for gradient in gradients
        ]
        radii = [max(end[0] - start[0], 1e-300) for start, end in zip(starts, ends, strict=True)]
        item["h"] = _lottie_property([
            min(99.0, 100 * float(np.hypot(*place)) / radius)
            for place, radius in zip(focus, radii, strict=True)
        ])  # fmt: skip
        item["a"] = _lottie_property([float(np.degrees(np.arctan2(y, x))) for x, y in focus])
    return item


def _lottie_losses(morph: Morph) -> str:
    """Return a phrase on the gradients of a morph that Lottie cannot hold; "" without any."""
    lost = dict[str, list[str]]()
    for name, paints in morph.styles.items():
        for fill in {fill for paint in paints for fill in (paint.fill, paint.stroke)}:
            if isinstance(fill, Gradient):
                rows = np.reshape(fill.matrix, (3, 2))[:2]
                stretch = np.linalg.svd(rows, compute_uv=False)
                if fill.spread != "pad":
                    lost.setdefault("gradients that repeat or reflect end", []).append(name)
                if fill.kind == "radial" and stretch[0] > ROUND * stretch[1]:
                    lost.setdefault("gradients along ellipses are circles", []).append(name)
    several = {what: list(dict.fromkeys(names)) for what, names in lost.items()}
    return "; ".join(
        f"in Lottie, {what} ({', '.join(names[:3])}{' …' * (len(names) > 3)})"
        for what, names in several.items()
    )


def _lottie_property(values: list[Any]) -> Json:
    """Return a Lottie property, a number or a list, from its value in every frame."""
    if all(value == values[0] for value in values):
        return _lottie_constant(values[0])
    numbers = np.asarray(values, np.float64)
    frames = _find_needed_frames(numbers, VALUE_ERROR * float(np.abs(numbers).max()))
    keys = _lottie_keyframes(frames, [values[frame] for frame in frames])
    for key in keys:
        key["s"] = key["s"][0] if isinstance(key["s"][0], list) else key["s"]
    return {"a": 1, "k": keys}


def _lottie_constant(value: object) -> Json:
    """Return a Lottie property that does not change during the animation."""
    return {"a": 0, "k": value}


# --- films


def _save_film(path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int) -> None:
    """Write a morph as a film: MP4 if the ending of `path` is .mp4, else animated WebP.

    frame_rate: frames per second. longer_side_px: longer side of the pictures.
    """
    scale = longer_side_px / max(morph.width, morph.height)
    # Both formats need even sides.
    height, width = (2 * max(1, round(side * scale / 2)) for side in (morph.height, morph.width))
    pictures = _paint_frames(morph, (height, width), scale)
    if path.suffix.lower() == ".mp4":
        with Mp4Writer(path, (height, width, 3), frame_rate, CRF) as film:
            for picture in pictures:
                film.write(picture)
        return
    begins_ms = [round(1000 * frame / frame_rate) for frame in range(len(morph.tau) + 1)]
    first, *others = map(Image.fromarray, pictures)
    # Without loss: else the coder leaves out what changes little from frame to frame, and colours
    # that change slowly lag behind.
    buffer = io.BytesIO()
    first.save(
        buffer, "webp", save_all=True, append_images=others, duration=np.diff(begins_ms).tolist(),
        loop=0, lossless=True, quality=EFFORT, method=2,
    )  # fmt: skip
    save_bytes(path, buffer.getvalue())


def _paint_frames(morph: Morph, shape: tuple[int, int], scale: float) -> Iterator[Picture]:
    """Yield the picture (h, w, 3) of every frame of a morph.

    shape: height and width of the pictures [px]. scale: px of the picture per px of the drawing.
    """
    side = max(morph.width, morph.height)

    def paint_frame(frame: int) -> Picture:
        """Return the picture (h, w, 3) of a frame, given its number."""
        shapes = group_contours(morph.closed, morph.paints_at(frame), side)
        contours = [(item, [morph.layers[name][frame] for name in item.layers]) for item in shapes]
        return paint_layers(contours, shape, scale)

    return ordered_map(paint_frame, range(len(morph.tau)), Threads(THREADS))


Writer = Callable[[Path, Morph, Fraction, int], str | None]
ENDINGS: dict[str, Writer] = {
    ".css.svg": _save_svg,
    ".svg": _save_svg,
    ".lottie.json": _save_lottie,
    ".spine.json": save_spine,
    ".json": _save_plain,
    ".webp": _save_film,
    ".mp4": _save_film,
}
