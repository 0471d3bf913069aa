"""The tank as glTF with moving fish: floor, glass, water and shadow; one skin, morph targets.

A glTF mesh can be mixed from a few shapes (morph targets). From its own heading, a fish takes few
shapes: their mean and `MODES` principal components stand for all ticks. An animation gives the
weight of each, and the place and heading of the fish.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Reals
from finloop.base.stretches import spread_rows
from finloop.tank.body import AROUND, RINGS, surface_normals, surface_triangles, texture_coordinates
from finloop.tank.camera import GLASS_PER_DEPTH, TankSize
from finloop.tank.light import SUN, WATER

MODES = 8  # readers on the web mix eight at most
_SAMPLE = 400  # shapes from which the components are computed
_SIDE = AROUND // 4  # the column of a grid that is the fish's side
_LIFT = 0.01  # of the shadow above the floor, in body lengths
_LINES, _FACES = 1, 4
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 88]
_FLOAT, _SHORT = 5126, 5123  # codes of glTF, as are the others here
_SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_LINEAR, _CLAMP = 9729, 33071


class GlbDocument:
    """A growing glTF 2.0 document in one binary file (.glb), with the parts that the tank needs.

    Each array becomes an accessor of its own, in a buffer view of its own, aligned to four bytes.
    Every `add_…` returns the index of the new item.
    """

    def __init__(self) -> None:
        """Begin an empty document."""
        self._data = bytearray()
        self._document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "finloop"},
            "extensionsUsed": ["KHR_materials_unlit"],
        }

    def add(self, kind: str, item: dict[str, Any]) -> int:
        """Add an item to the document's list `kind` ("nodes", "meshes" …); return its index."""
        items = self._document.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def add_array(self, array: NDArray, *, indices: bool = False, vertices: bool = False) -> int:
        """Add an array (n,) or (n, 2 … 4) of numbers; return the index of its accessor.

        indices: whether these are point numbers, written as uint16; all else is written as float32.
        vertices: whether each row belongs to a point of a mesh. ValueError if a number is not
        finite.
        """
        array = np.ascontiguousarray(array, np.uint16 if indices else np.float32)
        if not np.isfinite(array).all():
            raise ValueError("NaN and infinity cannot be written")
        width = 1 if array.ndim == 1 else array.shape[1]
        target = {"target": _ELEMENT_BUFFER if indices else _ARRAY_BUFFER}
        accessor = {
            "bufferView": self._add_buffer_view(
                array.tobytes(), target if indices or vertices else {}
            ),
            "componentType": _SHORT if indices else _FLOAT,
            "count": len(array),
            "type": _SHAPES[width],
        }
        if not indices:  # positions and times must have their bounds
            rows = array.reshape(len(array), width)
            accessor |= {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
        return self.add("accessors", accessor)

    def add_texture(self, coded: bytes, mime: str) -> int:
        """Add a smooth texture from the bytes of a PNG or JPEG file; return its index.

        mime: type of the file, such as "image/png".
        """
        sampler = {"magFilter": _LINEAR, "minFilter": _LINEAR, "wrapS": _CLAMP, "wrapT": _CLAMP}
        image = self.add(
            "images", {"bufferView": self._add_buffer_view(coded, {}), "mimeType": mime}
        )
        return self.add("textures", {"source": image, "sampler": self.add("samplers", sampler)})

    def _add_buffer_view(self, data: bytes, fields: dict[str, int]) -> int:
        """Add bytes as a buffer view, aligned to 4 bytes, with further fields; return its index."""
        self._data += b"\0" * (-len(self._data) % 4)
        view = {"buffer": 0, "byteOffset": len(self._data), "byteLength": len(data)} | fields
        self._data += data
        return self.add("bufferViews", view)

    def encode(self, root: int) -> bytes:
        """Finish the document with its scene; return the bytes of the .glb file.

        root: index of the node that holds the whole scene.
        """
        self._document["scene"] = self.add("scenes", {"nodes": [root]})
        data = bytes(self._data) + b"\0" * (-len(self._data) % 4)  # padded to four bytes
        document = self._document | {"buffers": [{"byteLength": len(data)}]}
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        body = len(text).to_bytes(4, "little") + b"JSON" + text
        body += len(data).to_bytes(4, "little") + b"BIN\0" + data
        version, length = (2).to_bytes(4, "little"), (12 + len(body)).to_bytes(4, "little")
        return b"glTF" + version + length + body


class PrincipalShapes(NamedTuple):
    """Principal components of a fish's shapes; a shape is nearly mean + weights · modes.

    mean (v, 3) and modes (m, v, 3): v points, px; weights (ticks, m); error_px: the greatest
    distance of a point of such a shape from its true place.
    """

    mean: Reals
    modes: Reals
    weights: Reals
    error_px: float


def principal_shapes(points: Reals, heading: Reals, most: int = MODES) -> PrincipalShapes:
    """Return the principal components of a fish's shapes, all turned to head right.

    A component is as large as the standard deviation along it, so that of the weights is about 1.

    points (ticks, v, 3): px about the mass centre, y up; heading (ticks,): rad; most: largest
    number of components. They are computed from at most `_SAMPLE` ticks.
    """
    # Turn the points by the heading, clockwise.
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    headed_right = points.copy()
    headed_right[..., 0] = cos * points[..., 0] + sin * points[..., 1]
    headed_right[..., 1] = cos * points[..., 1] - sin * points[..., 0]
    shapes = headed_right.reshape(len(points), -1)
    sample = shapes[spread_rows(np.arange(len(shapes)), _SAMPLE)]
    mean = sample.mean(0)
    _, singular, axes = np.linalg.svd(sample - mean, full_matrices=False)
    count = min(most, int((singular > 1e-9 * max(singular[0], 1e-9)).sum()))  # others are noise
    spread = singular[:count, None] / np.sqrt(len(sample))  # standard deviation of each
    modes = spread * axes[:count]
    weights = (shapes - mean) @ axes[:count].T / spread.T
    errors = (shapes - mean - weights @ modes).reshape(points.shape)
    error_px = float(np.linalg.norm(errors, axis=-1).max())
    mode_shapes = modes.reshape(count, len(mean) // 3, 3)
    return PrincipalShapes(mean.reshape(-1, 3), mode_shapes, weights, error_px)


class AnimatedFish(NamedTuple):
    """A moving fish: its shapes, and its place and heading at every tick.

    place (ticks, 3): px of its mass centre in the tank; heading (ticks,): rad, without jumps of 2π.
    """

    shape: PrincipalShapes
    place: Reals
    heading: Reals


def encode_tank_glb(
    tank: TankSize, background: NDArray[np.uint8], skin: NDArray[np.uint8],
    swimmers: Sequence[AnimatedFish], rate_hz: float,
) -> bytes:  # fmt: skip
    """Return the bytes of a .glb file that shows the tank with its moving fish.

    A fish is one unit long, y is up, the origin the tank's middle. background (h, w[, 3]): the
    floor; skin (a, l, 3) uint8: of every fish; rate_hz: ticks per second.
    """
    glb = GlbDocument()
    skin_material = _add_skin_material(glb, skin)
    shadow_material = _add_plain_material(glb, "shadow", colour=(0.02, 0.06, 0.08, 0.38))
    suffixes = ["", *(f" {number}" for number in range(1, len(swimmers)))]
    shadows = [
        _add_shadow(glb, swimmer.shape, shadow_material, f"shadow{suffix}")
        for swimmer, suffix in zip(swimmers, suffixes, strict=True)
    ]
    bodies = [
        _add_fish(glb, swimmer.shape, skin_material, f"fish{suffix}")
        for swimmer, suffix in zip(swimmers, suffixes, strict=True)
    ]
    time = glb.add_array(np.arange(len(swimmers[0].heading)) / rate_hz)
    channels, samplers = list[dict](), list[dict]()
    for swimmer, shadow, body in zip(swimmers, shadows, bodies, strict=True):
        lift = (0, 0, _LIFT * tank.body_length)
        on_floor = swimmer.place - swimmer.place[:, 2:] * (SUN / SUN[2]) + lift  # of the shadow
        places = {shadow: on_floor, body: swimmer.place}
        for node, path, output in _add_motion(glb, swimmer, places):
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
            samplers.append({"input": time, "output": output, "interpolation": "LINEAR"})
    glb.add("animations", {"name": "swim", "channels": channels, "samplers": samplers})
    children = [*_add_still_parts(glb, tank, background), *shadows, *bodies]
    # The rotation, a quarter turn about x, makes y the upward axis.
    root = glb.add("nodes", {
        "name": "tank", "children": children, "rotation": [-(0.5**0.5), 0.0, 0.0, 0.5**0.5],
        "scale": [1 / tank.body_length] * 3,
        "translation": to_gltf_axes(-tank.middle / tank.body_length),
    })  # fmt: skip
    return glb.encode(root)


def to_gltf_axes(place: Reals) -> list[float]:
    """Return a place (3,) of the tank in the axes of glTF: x right, y up, z to the viewer."""
    return [float(place[0]), float(place[2]), float(-place[1])]


def _add_skin_material(glb: GlbDocument, skin: NDArray[np.uint8]) -> int:
    """Add the material of a fish with the skin (a, l, 3) uint8; return its index."""
    coded = cv2.imencode(".png", cv2.cvtColor(skin, cv2.COLOR_RGB2BGR))[1].tobytes()
    texture = {"index": glb.add_texture(coded, "image/png")}
    return glb.add("materials", {
        "name": "skin",
        "pbrMetallicRoughness": {
            "baseColorTexture": texture, "metallicFactor": 0.0, "roughnessFactor": 0.45,
        },
    })  # fmt: skip


def _add_fish(glb: GlbDocument, shape: PrincipalShapes, material: int, name: str) -> int:
    """Add the node of a fish, a mix of principal shapes in a skin's material; return its index."""
    grid = (1, RINGS, AROUND, 3)
    mean_normals = surface_normals(shape.mean.reshape(grid)).reshape(-1, 3)
    targets = []
    for mode in shape.modes:
        normals = surface_normals((shape.mean + mode).reshape(grid)).reshape(-1, 3)
        targets.append({
            "POSITION": glb.add_array(mode, vertices=True),
            "NORMAL": glb.add_array(normals - mean_normals, vertices=True),
        })  # fmt: skip
    primitive = {
        "attributes": {
            "POSITION": glb.add_array(shape.mean, vertices=True),
            "NORMAL": glb.add_array(mean_normals, vertices=True),
            "TEXCOORD_0": glb.add_array(texture_coordinates(), vertices=True),
        },
        "indices": glb.add_array(surface_triangles().ravel(), indices=True),
        "material": material,
    }
    return _add_morph_node(glb, name, primitive, targets)


def _add_morph_node(glb: GlbDocument, name: str, primitive: dict, targets: list[dict]) -> int:
    """Add a node whose mesh can take several shapes (morph targets); return its index.

    primitive: glTF's description of the mean shape; targets: differences that can be added to it.
    """
    mesh: dict[str, Any] = {"name": name, "primitives": [primitive]}
    if targets:
        primitive["targets"] = targets
        mesh["weights"] = [0.0] * len(targets)
    return glb.add("nodes", {"name": name, "mesh": glb.add("meshes", mesh)})


def _add_shadow(glb: GlbDocument, shape: PrincipalShapes, material: int, name: str) -> int:
    """Add the node of a fish's shadow, a flat strip on the floor; return its index."""

    def flatten(points: Reals) -> Reals:
        """Return the points of both sides of the body on the floor, (2 · RINGS, 3)."""
        sides = points.reshape(RINGS, AROUND, 3)[:, [_SIDE, AROUND - 1 - _SIDE]]
        return sides.reshape(-1, 3) * (1, 1, 0)

    first_corner = 2 * np.arange(RINGS - 1)[:, None]
    faces = first_corner + np.array([0, 2, 1, 1, 2, 3])  # two triangles between two rings
    primitive = {
        "attributes": {"POSITION": glb.add_array(flatten(shape.mean), vertices=True)},
        "indices": glb.add_array(faces.ravel(), indices=True),
        "material": material,
    }
    targets = [{"POSITION": glb.add_array(flatten(mode), vertices=True)} for mode in shape.modes]
    return _add_morph_node(glb, name, primitive, targets)


def _add_plain_material(
    glb: GlbDocument, name: str, colour: tuple[float, ...], texture: int | None = None
) -> int:
    """Add an unlit, two-sided material (colour: RGBA, 0 … 1; texture: index); return its index."""
    base: dict = {"baseColorFactor": list(colour), "metallicFactor": 0.0, "roughnessFactor": 1.0}
    if texture is not None:
        base["baseColorTexture"] = {"index": texture}
    return glb.add("materials", {
        "name": name, "pbrMetallicRoughness": base, "doubleSided": True,
        "alphaMode": "BLEND" if colour[3] < 1 else "OPAQUE",
        "extensions": {"KHR_materials_unlit": {}},
    })  # fmt: skip


def _add_motion(
    glb: GlbDocument, fish: AnimatedFish, places: Mapping[int, Reals]
) -> Iterator[tuple[int, str, int]]:
    """Add the motion of a fish and its shadow; yield (node, property, index of an accessor).

    The accessor holds the values of the property, such as "rotation", at every tick. places: the
    place (ticks, 3) of each node, the fish and its shadow, by the node's index.
    """
    zero, half = np.zeros_like(fish.heading), fish.heading / 2
    quaternions = np.stack([zero, zero, np.sin(half), np.cos(half)], -1)
    shared = {"rotation": glb.add_array(quaternions)}
    if fish.shape.weights.shape[1]:
        shared["weights"] = glb.add_array(fish.shape.weights.ravel())
    for node, place in places.items():
        yield node, "translation", glb.add_array(place)
        for path, values in shared.items():
            yield node, path, values


def _add_still_parts(glb: GlbDocument, tank: TankSize, background: NDArray[np.uint8]) -> list[int]:
    """Add floor, edges, water and glass; return the indices of their nodes, in order.

    background: picture of the floor.
    """
    # Four corners on the floor, at the water's surface, and at the rim of the glass above it.
    heights = 0.0, tank.depth, GLASS_PER_DEPTH * tank.depth
    low, water, rim = (np.c_[tank.corners, np.full(4, z)] for z in heights)
    colour = background if background.ndim == 2 else cv2.cvtColor(background, cv2.COLOR_RGB2BGR)
    coded = cv2.imencode(".jpg", colour, _JPEG)[1].tobytes()
    floor = _add_plain_material(glb, "floor", (*WATER, 1.0), glb.add_texture(coded, "image/jpeg"))
    box = np.concatenate([low, rim])  # corner i of the floor lies below corner i + 4 of the rim
    corner, following = np.arange(4), (np.arange(4) + 1) % 4
    # Of each side two triangles, and of each corner the lines along the floor, along the rim, up.
    walls = np.c_[corner, following, following + 4, corner, following + 4, corner + 4]
    edges = np.c_[corner, following, corner + 4, following + 4, corner, corner + 4]
    square, on_picture = np.array([0, 1, 2, 0, 2, 3]), np.array([[0, 1], [1, 1], [1, 0], [0, 0]])
    texture_places = {"TEXCOORD_0": glb.add_array(on_picture, vertices=True)}

    def add_part(
        name: str, points: Reals, faces: NDArray, material: int,
        attributes: dict[str, int] | None = None, mode: int = _FACES,
    ) -> int:  # fmt: skip
        """Add a node of triangles or lines between points; return its index."""
        primitive = {
            "attributes": {"POSITION": glb.add_array(points, vertices=True)} | (attributes or {}),
            "indices": glb.add_array(faces.ravel(), indices=True),
            "material": material,
            "mode": mode,
        }
        return _add_morph_node(glb, name, primitive, [])

    parts = [add_part("floor", low, square, floor, attributes=texture_places)]
    material = _add_plain_material(glb, "edges", (0.85, 0.97, 1.0, 1.0))
    parts.append(add_part("edges", box, edges, material, mode=_LINES))
    material = _add_plain_material(glb, "water", (0.62, 0.82, 0.9, 0.16))
    parts.append(add_part("water", water, square, material))
    material = _add_plain_material(glb, "glass", (0.8, 0.95, 1.0, 0.07))
    parts.append(add_part("glass", box, walls, material))
    return parts
