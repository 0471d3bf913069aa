"""A writer of glTF 2.0 in one binary file (.glb), with the parts that the tank needs.

Each array becomes an accessor of its own, in a buffer view of its own, aligned to four bytes.
"""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

_FLOAT, _SHORT = 5126, 5123
_SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_ARRAY_BUFFER, _ELEMENT_BUFFER = 34962, 34963
_LINEAR, _CLAMP = 9729, 33071


class Glb:
    """A growing glTF document: every `add_…` returns the index of the new item."""

    def __init__(self, generator: str) -> None:
        self._data = bytearray()
        self._document: dict[str, Any] = {"asset": {"version": "2.0", "generator": generator}}

    def add(self, kind: str, item: dict[str, Any]) -> int:
        """Add an item to the document's list `kind` ("nodes", "meshes" …); return its index."""
        items = self._document.setdefault(kind, [])
        items.append(item)
        return len(items) - 1

    def use(self, extension: str) -> None:
        """Declare an optional glTF extension by its name."""
        names = self._document.setdefault("extensionsUsed", [])
        if extension not in names:
            names.append(extension)

    def show(self, nodes: list[int]) -> None:
        """Add a scene of these nodes, and make it the one that a reader shows."""
        self._document["scene"] = self.add("scenes", {"nodes": nodes})

    def add_array(self, array: NDArray, *, indices: bool = False, vertices: bool = False) -> int:
        """Add an accessor of an array (n,) or (n, 2 … 4); return its index.

        Point numbers (`indices`) are written as uint16, all else, such as `vertices`, as float32.
        """
        array = np.ascontiguousarray(array, np.uint16 if indices else np.float32)
        if not np.isfinite(array).all():
            raise ValueError("NaN and infinity cannot be written")
        width = 1 if array.ndim == 1 else array.shape[1]
        view = {"target": _ELEMENT_BUFFER} if indices else {"target": _ARRAY_BUFFER}
        accessor = {
            "bufferView": self._view(array.tobytes(), view if indices or vertices else {}),
            "componentType": _SHORT if indices else _FLOAT,
            "count": len(array),
            "type": _SHAPES[width],
        }
        if not indices:  # positions and times must have their bounds
            flat = array.reshape(len(array), width)
            accessor |= {"min": flat.min(0).tolist(), "max": flat.max(0).tolist()}
        return self.add("accessors", accessor)

    def add_texture(self, coded: bytes, mime: str) -> int:
        """Add a texture from the bytes of a PNG or JPEG file; return its index.

        It is smooth and not repeated. mime: "image/png" or "image/jpeg".
        """
        sampler = {"magFilter": _LINEAR, "minFilter": _LINEAR, "wrapS": _CLAMP, "wrapT": _CLAMP}
        image = self.add("images", {"bufferView": self._view(coded, {}), "mimeType": mime})
        return self.add("textures", {"source": image, "sampler": self.add("samplers", sampler)})

    def _view(self, data: bytes, more: dict[str, int]) -> int:
        self._data += b"\0" * (-len(self._data) % 4)
        view = {"buffer": 0, "byteOffset": len(self._data), "byteLength": len(data)} | more
        self._data += data
        return self.add("bufferViews", view)

    def encode(self) -> bytes:
        """Return the bytes of the .glb file."""
        data = bytes(self._data) + b"\0" * (-len(self._data) % 4)
        document = self._document | {"buffers": [{"byteLength": len(data)}]}
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = [(b"JSON", text), (b"BIN\0", data)]
        body = b"".join(len(d).to_bytes(4, "little") + name + d for name, d in chunks)
        return b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body
