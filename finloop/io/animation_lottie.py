"""A morph as Lottie JSON (version 5.7), the vector animation of apps and web pages.

Every shape is a Lottie layer, the topmost first. Every frame is a keyframe with the same number of
vertices; in between, players interpolate linearly in space and time.
"""

from fractions import Fraction
from math import ceil
from typing import Any

from finloop.base.drawing import Morph
from finloop.base.paint import Colour, Paint, Shape, group_contours

Json = dict[str, Any]


def to_lottie(morph: Morph, frame_rate: Fraction) -> Json:
    """Convert a morph to Lottie, a dictionary for `json.dumps`; frame_rate: frames per second."""
    what = group_contours(morph.closed, morph.styles, max(morph.width, morph.height))
    return {
        "v": "5.7.0", "fr": float(frame_rate), "ip": 0, "op": len(morph.tau),
        "w": ceil(morph.width), "h": ceil(morph.height), "nm": "morph", "ddd": 0, "assets": [],
        "layers": [_layer(morph, shape, k) for k, shape in enumerate(what[::-1], 1)],
    }  # fmt: skip


def _layer(morph: Morph, shape: Shape, index: int) -> Json:
    paths = [
        _animated_path(morph, name, closed)
        for name, closed in zip(shape.layers, shape.closed, strict=True)
    ]
    items = [*paths, *_paints(shape.paint), {"ty": "tr", **_still()}]
    return {
        "ddd": 0, "ind": index, "ty": 4, "nm": shape.name, "sr": 1, "ks": _still(), "ao": 0,
        "shapes": [{"ty": "gr", "nm": shape.name, "it": items}],
        "ip": 0, "op": len(morph.tau), "st": 0, "bm": 0,
    }  # fmt: skip


def _animated_path(morph: Morph, name: str, closed: bool) -> Json:
    frames = morph.layers[name].tolist()
    straight = [[0, 0]] * len(frames[0])
    keys: list[Json] = [
        {"t": k, "s": [{"i": straight, "o": straight, "v": points, "c": closed}]}
        for k, points in enumerate(frames)
    ]
    for key in keys[:-1]:  # players take a keyframe with easing for the start of another step
        key |= {"i": {"x": 1, "y": 1}, "o": {"x": 0, "y": 0}}
    return {"ty": "sh", "nm": name, "ks": {"a": 1, "k": keys}}


def _paints(paint: Paint) -> list[Json]:
    """Return stroke before fill: the first lies on top."""
    paints: list[Json] = []
    if paint.stroke is not None:
        opacity, width = _constant(100 * paint.stroke_opacity), _constant(paint.width)
        stroke = {"ty": "st", "c": _colour(paint.stroke), "o": opacity, "w": width}
        paints.append(stroke | {"lc": 2, "lj": 2})
    if paint.fill is not None:
        opacity = _constant(100 * paint.fill_opacity)
        paints.append({"ty": "fl", "c": _colour(paint.fill), "o": opacity, "r": 2})
    return paints


def _still() -> Json:
    """Return a transform that changes nothing."""
    numbers = {"o": 100, "r": 0, "p": [0, 0], "a": [0, 0], "s": [100, 100]}
    return {key: _constant(number) for key, number in numbers.items()}


def _colour(colour: Colour) -> Json:
    return _constant([round(c / 255, 4) for c in colour] + [1])


def _constant(value: object) -> Json:
    return {"a": 0, "k": value}
