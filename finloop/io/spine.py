"""Morphs as Spine JSON (format 4.2), the skeleton animation of games.

Every shape is a slot, or two: the area `fill:ID`, and above it the line `line:ID`. A slot shows a
mesh over a white picture, in the slot's colour, which a timeline changes. What moves like a rigid
body, also turned and scaled, hangs on a bone of its own. All else has a deform timeline. Format:
https://esotericsoftware.com/spine-json-format. Spine's y points up; frame k is at k / rate seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
from PIL import Image

from finloop.base.arrays import Complex, Floats, Ints, Points
from finloop.base.drawing import Morph
from finloop.base.paint import Shape, dash_spans, painted_frames
from finloop.base.style import Gradient, Paint, colours_at, gradient_offsets
from finloop.base.triangles import cross_products, triangulate
from finloop.io.atomic import save_bytes
from finloop.io.record import save_json

VERSION = "4.2.43"
PICTURE, SIDE_PX = "finloop-white", 16  # the white picture that all meshes show, and its side
ROUND_END = np.pi / 2 * np.array([0.33, 0.67, 0.99])
"""Where the round end of a line has corners: angles from the line's last point to its tip."""
MITRE = 2.0  # half widths: how far the outer corner of a line may be from the line
Json = dict[str, Any]


@dataclass
class _SlotMesh:
    """The fill or the stroke of a shape as a mesh: vertices in every frame, and triangles."""

    name: str
    vertices: Points  # (f, v, 2), y up; the last frame is the one after the morph's end
    hull: int  # how many of the first vertices are the outline
    meshes: list[tuple[int, int, Ints]]  # first and last frame, triangles (t, 3)
    colours: list[str]  # rrggbbaa of every frame


def save_spine(path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int) -> str:
    """Write a morph as Spine JSON with an atlas and a picture; return what Spine cannot hold.

    The result is a phrase, "" if nothing is lost. frame_rate: frames per second. longer_side_px is
    not used: the picture is scalable. The atlas has the JSON's name with the ending .atlas.
    """
    seconds = [float(frame / frame_rate) for frame in range(len(morph.tau) + 1)]
    parts, notes = _build_slot_meshes(morph)
    bones: list[Json] = [{"name": "root"}]
    slots: list[Json] = []
    skin, deforms, slot_lines, bone_lines = (dict[str, Any]() for _ in range(4))
    for part in parts:
        motion = _fit_rotation_and_scale(part.vertices, 2 * 10.0**-morph.decimals)
        first = part.vertices[0]
        names = [part.name, *(f"{part.name}:{k}" for k in range(2, len(part.meshes) + 1))]
        bone, poses = "root", part.vertices
        if motion is not None:
            middle = first.mean(axis=0)
            poses = np.broadcast_to(first - middle, part.vertices.shape)
            bone, names, part.meshes = part.name, names[:1], part.meshes[:1]
            bones.append({"name": bone, "parent": "root", **_point_to_json(middle, morph.decimals)})
            if lines := _bone_timelines(*motion, seconds):
                bone_lines[bone] = lines
        slot = {"name": part.name, "bone": bone, "color": part.colours[0], "attachment": names[0]}
        slots.append(slot)
        low, size = first.min(axis=0), np.maximum(np.ptp(first, axis=0), 1e-9)
        uvs = np.round((first - low) / size * [1, -1] + [0, 1], 5)
        skin[part.name] = {}
        for name, (start, end, triangles) in zip(names, part.meshes, strict=True):
            skin[part.name][name] = {
                "type": "mesh", "path": PICTURE, "uvs": uvs.ravel().tolist(),
                "triangles": triangles.ravel().tolist(),
                "vertices": np.round(poses[start], morph.decimals).ravel().tolist(),
                "hull": part.hull, "width": SIDE_PX, "height": SIDE_PX,
            }  # fmt: skip
            moves = np.round(poses[start : end + 1] - poses[start], morph.decimals) + 0.0
            if moves.any():
                keys = [_key(seconds[start + k], vertices=v.ravel().tolist())
                        for k, v in enumerate(moves)]  # fmt: skip
                deforms.setdefault(part.name, {})[name] = {"deform": keys}
        timelines: Json = {}
        if len(set(part.colours)) > 1:
            timelines["rgba"] = [
                _key(time, color=c) for time, c in zip(seconds, part.colours, strict=True)
            ]
        if len(names) > 1:
            timelines["attachment"] = [
                _key(seconds[start], name=name)
                for name, (start, _, _) in zip(names, part.meshes, strict=True)
            ]
        if timelines:
            slot_lines[part.name] = timelines
    animation: Json = {"slots": slot_lines, "bones": bone_lines,
                       "attachments": {"default": deforms}}  # fmt: skip
    # Something lasts as long as the morph even if nothing moves.
    animation["bones"]["root"] = {"translate": [_key(0, x=0, y=0), _key(seconds[-1], x=0, y=0)]}
    content: Json = {
        "skeleton": {"spine": VERSION, "x": 0, "y": 0, "width": morph.width,
                     "height": morph.height, "fps": float(frame_rate), "images": "./"},
        "bones": bones, "slots": slots,
        "skins": [{"name": "default", "attachments": skin}],
        "animations": {"morph": animation},
    }  # fmt: skip
    picture = BytesIO()
    Image.new("RGBA", (SIDE_PX, SIDE_PX), "white").save(picture, "png")
    save_bytes(path.with_name(f"{PICTURE}.png"), picture.getvalue())
    atlas = [f"{PICTURE}.png", f"size:{SIDE_PX},{SIDE_PX}", "filter:Linear,Linear",
             PICTURE, f"bounds:0,0,{SIDE_PX},{SIDE_PX}", ""]  # fmt: skip
    save_bytes(path.with_suffix(".atlas"), "\n".join(atlas).encode())
    save_json(path, content, indent=None)
    return "; ".join(notes)


def _key(time: float, **values: Any) -> Json:
    """Return a key of a Spine timeline: its time in seconds, and its values."""
    return {"time": round(time, 6), **values}


def _point_to_json(point: Points, decimals: int) -> Json:
    """Return a point (2,) for Spine, rounded to two decimals more than the drawing has."""
    x, y = np.round(point, decimals + 2).tolist()
    return {"x": x, "y": y}


# --- what is shown: areas and lines of shapes


def _build_slot_meshes(morph: Morph) -> tuple[list[_SlotMesh], list[str]]:
    """Return the meshes of a morph's fills and strokes, lowest first, and what Spine cannot hold.

    The losses are phrases for the user.
    """
    parts = list[_SlotMesh]()
    lost: dict[str, list[str]] = {}
    count = len(morph.tau)
    frames = [*range(count), morph.end_frame]
    for shapes in painted_frames(morph):
        name, paints = shapes[0].name, [shapes[frame].paint for frame in frames]
        contours = [
            morph.layers[layer][frames] * [1, -1] + [0, morph.height] for layer in shapes[0].layers
        ]
        if any(isinstance(fill, Gradient) for p in paints for fill in (p.fill, p.stroke)):
            lost.setdefault("gradients as one colour", []).append(name)
        if any(paint.dashes and not paint.leaves_gaps for paint in paints):
            lost.setdefault("dashes as a whole line", []).append(name)
        if any(paint.fill is not None for paint in paints):
            contours.sort(key=lambda stack: -np.ptp(stack[0], axis=0).prod())  # the outer one first
            sizes = [stack.shape[1] for stack in contours]
            vertices = np.concatenate(contours, axis=1)
            meshes, flawed, rough = _find_meshes(vertices, sizes)
            for what, number in (
                ("slivers for a moment between two frames", flawed),
                ("areas that cross themselves roughly", rough),
            ):
                if number:
                    lost.setdefault(what, []).append(f"{name} in {number} of {count} frames")
            colours = _slot_colours(shapes, frames, "fill", morph)
            parts.append(_SlotMesh(f"fill:{name}", vertices, sizes[0], meshes, colours))
        if any(paint.stroke is not None for paint in paints):
            parts.append(_build_stroke_mesh(morph, shapes, frames))
    return parts, [f"Spine shows {what}: {', '.join(names)}" for what, names in lost.items()]


def _slot_colours(
    shapes: Sequence[Shape], frames: Sequence[int], key: Literal["fill", "stroke"], morph: Morph
) -> list[str]:
    """Return the colour of a shape's fill or stroke in each of some frames, as rrggbbaa.

    shapes: the shape in every frame. For a gradient it is the mean colour along the contour. Where
    nothing is painted, it is the last colour before, else the first one, with alpha 0.
    """
    rgba = list[Points | None]()
    for frame in frames:
        shape = shapes[frame]
        fill = getattr(shape.paint, key)
        opacity = 255 * getattr(shape.paint, f"{key}_opacity")
        if isinstance(fill, Gradient):
            points = np.concatenate([morph.layers[layer][frame] for layer in shape.layers])
            mean = colours_at(fill, gradient_offsets(fill, points)).mean(axis=0)
            rgba.append(mean * [1, 1, 1, opacity])
        else:
            rgba.append(None if fill is None else np.array([*fill, opacity]))
    colour = next(value for value in rgba if value is not None) * [1, 1, 1, 0]
    texts = []
    for value in rgba:
        colour = colour * [1, 1, 1, 0] if value is None else value
        texts.append("".join(f"{round(channel):02x}" for channel in colour.tolist()))
    return texts


# --- areas: triangles that no motion flips


def _find_meshes(
    stack: Points, sizes: Sequence[int]
) -> tuple[list[tuple[int, int, Ints]], int, int]:
    """Triangulate contours (f, n, 2) in runs of frames in which no triangle flips; count failures.

    A run is its first and last frame and its triangles (t, 3); the next run begins where it ends. A
    triangle flips if it changes its side, also between frames. sizes: number of vertices of each
    contour. Two counts follow: frames from which to the next one some triangles must flip; and
    frames whose contours meet, which have the triangles of the run before.
    """
    runs = list[tuple[int, int, Ints]]()
    flawed = rough = frame = 0
    last = len(stack) - 1
    while frame < last:
        triangles, is_whole = triangulate(stack[frame], sizes)
        end = _last_frame_without_flip(stack, frame, triangles) if is_whole else frame
        if end == frame:  # those of the next frame may lead there
            later, is_later_whole = triangulate(stack[frame + 1], sizes)
            if is_later_whole and not _any_flips(stack[frame], stack[frame + 1], later):
                triangles, end = later, _last_frame_without_flip(stack, frame, later)
            else:
                end = frame + 1
                flawed, rough = flawed + is_whole, rough + (not is_whole)
                triangles = runs[-1][2] if runs and not is_whole else triangles
        runs.append((frame, end, triangles))
        frame = end
    return runs, flawed, rough


def _any_flips(before: Points, after: Points, triangles: Ints) -> bool:
    """Return whether any triangle (t, 3) flips while points (n, 2) move straight to others.

    Twice its area is a quadratic in time with the Bernstein coefficients a, b, c.
    """
    a, c = cross_products(before, before, triangles), cross_products(after, after, triangles)
    b = (cross_products(before, after, triangles) + cross_products(after, before, triangles)) / 2
    stays = (a >= 0) & (c >= 0) & ((b >= 0) | (b * b <= a * c))
    return not bool(stays.all())


def _last_frame_without_flip(stack: Points, frame: int, triangles: Ints) -> int:
    """Return the last frame of contours (f, n, 2) up to which no triangle flips from a frame on."""
    while frame + 1 < len(stack) and not _any_flips(stack[frame], stack[frame + 1], triangles):
        frame += 1
    return frame


# --- lines, as areas


def _build_stroke_mesh(morph: Morph, shapes: Sequence[Shape], frames: Sequence[int]) -> _SlotMesh:
    """Return the mesh of a shape's stroke: a strip along each contour.

    shapes: the shape in every frame.
    """
    strips, triangles, hull, offset = list[Points](), list[Ints](), 0, 0
    for layer, closed in zip(shapes[0].layers, shapes[0].closed, strict=True):
        points = morph.layers[layer][frames] * [1, -1] + [0, morph.height]
        half_widths = [
            _half_widths(shapes[frame].paint, line, closed)
            for frame, line in zip(frames, points, strict=True)
        ]
        strip = _stroke_outline(points, closed, np.stack(half_widths))
        side = strip.shape[1] // 2  # vertices on the left; those on the right follow
        near = np.arange(side if closed else side - 1)
        far = (near + 1) % side
        quads = np.stack([near, far, side + near, far, side + far, side + near], axis=1)
        strips.append(strip)
        triangles.append(quads.reshape(-1, 3) + offset)
        hull = hull or side
        offset += 2 * side
    mesh = (0, len(frames) - 1, np.concatenate(triangles))
    colours = _slot_colours(shapes, frames, "stroke", morph)
    name = f"line:{shapes[0].name}"
    return _SlotMesh(name, np.concatenate(strips, axis=1), hull, [mesh], colours)


def _half_widths(paint: Paint, points: Points, closed: bool) -> Floats:
    """Return half the width of a stroke at points (n, 2); 0 where a line is cut open.

    A morph stores such openings, at cuts and lost holes, as gaps of dashes (`Paint.leaves_gaps`).
    Gaps of ordinary dashes do not count.
    """
    half = np.full(len(points), paint.width / 2)
    if not (paint.leaves_gaps and paint.dashes):
        return half
    ring = np.concatenate([points, points[:1]]) if closed else points
    along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(ring, axis=0).T))]
    places = along[: len(points)]
    is_shown = np.zeros(len(points), bool)
    for start, end in dash_spans(paint, float(along[-1])):
        is_shown |= (places >= start) & (places <= end)
    return half * is_shown


def _stroke_outline(points: Points, closed: bool, half_widths: Floats) -> Points:
    """Return the left, then the right side (f, 2 m, 2) of a stroke along points (f, n, 2).

    half_widths (f, n): half its width. Open lines have round ends. Corners are mitred, up to MITRE.
    """
    if closed:
        before, after = points - np.roll(points, 1, axis=1), np.roll(points, -1, axis=1) - points
    else:
        edges = np.diff(points, axis=1)
        before = np.concatenate([edges[:, :1], edges], axis=1)
        after = np.concatenate([edges, edges[:, -1:]], axis=1)
    directions = [
        edge / np.maximum(np.hypot(*np.moveaxis(edge, 2, 0)), 1e-12)[..., None]
        for edge in (before, after)
    ]
    mean = (directions[0] + directions[1]) / 2
    # |mean| is the cosine of half the turn; a mitre is 1 / cosine half widths long.
    square = np.maximum((mean**2).sum(axis=2), 1 / MITRE**2)[..., None]
    normals = mean[..., ::-1] * [-1, 1] / square * half_widths[..., None]
    if not closed:
        ends = []
        for index, sign in ((0, -1), (-1, 1)):
            along = directions[1][:, index, None] * (half_widths[:, index, None, None] * sign)
            middle = points[:, index, None] + np.sin(ROUND_END)[:, None] * along
            ends.append((middle, np.cos(ROUND_END)[:, None] * normals[:, index, None]))
        (start, start_normals), (end, end_normals) = ends
        points = np.concatenate([start[:, ::-1], points, end], axis=1)
        normals = np.concatenate([start_normals[:, ::-1], normals, end_normals], axis=1)
    return np.concatenate([points + normals, points - normals], axis=1)


# --- what moves like a rigid body


def _fit_rotation_and_scale(stack: Points, tolerance: float) -> tuple[Complex, Points] | None:
    """Fit rotation, scaling and shift from the first frame to each; None if a vertex is far off.

    stack (f, v, 2): vertices in every frame. Rotation and scaling come back as complex factors
    (f,), the middles of the vertices as (f, 2). tolerance: the largest error of a vertex.
    """
    middles = stack.mean(axis=1)
    z = (stack - middles[:, None]) @ [1, 1j]
    factors = z @ z[0].conj() / max(float((abs(z[0]) ** 2).sum()), 1e-300)
    off = abs(factors[:, None] * z[0] - z).max()
    return (factors, middles) if off <= tolerance and (abs(factors) > 1e-9).all() else None


def _bone_timelines(factors: Complex, middles: Points, seconds: Sequence[float]) -> Json:
    """Return the timelines that rotate, move and scale a bone; those without a change are left out.

    factors (f,): rotation and scaling, as complex numbers. middles (f, 2): places of the bone.
    seconds: of the keys.
    """
    turns = np.round(np.degrees(np.unwrap(np.angle(factors))), 6) + 0.0
    scales = np.round(abs(factors), 9)
    moves = np.round(middles - middles[0], 9) + 0.0
    lines: Json = {}
    if turns.any():
        lines["rotate"] = [_key(t, value=v) for t, v in zip(seconds, turns.tolist(), strict=True)]
    if moves.any():
        lines["translate"] = [
            _key(t, x=x, y=y) for t, (x, y) in zip(seconds, moves.tolist(), strict=True)
        ]
    if (scales != 1).any():
        lines["scale"] = [_key(t, x=v, y=v) for t, v in zip(seconds, scales.tolist(), strict=True)]
    return lines
