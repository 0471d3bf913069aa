"""A page that shows a .glb and plays its animation, all in one file: it needs no network.

The viewer is <model-viewer> 4.4.0 (Apache-2.0): `dist/model-viewer-umd.min.js` of the npm package
`@google/model-viewer`, unchanged.
"""

import base64
import hashlib
import html
from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes

_SCRIPT = Path(__file__).with_name("model-viewer-umd.min.js")
_SHA256 = "d785423b1d046ea84a9f59ef6cf15f3077603e1bf938b01ced9b0240691884a2"
_PAGE = Path(__file__).with_name("page.html")


def save_viewer(
    path: Path, glb: bytes, title: str, alt: str, track: list[list[float]], rate_hz: float
) -> None:
    """Write an HTML page that shows a 3-D scene (.glb) with a camera that can follow the fish.

    alt: a description of the scene for screen readers. track: the fish's place x, y, z at every
    tick, in units of the .glb. rate_hz: ticks per second. FinloopError if the viewer is damaged.
    """
    page = _PAGE.read_text(encoding="utf-8")  # it has {title}, {alt} … where the values belong
    for name, value in {
        "title": html.escape(title),
        "alt": html.escape(alt),
        "glb": base64.b64encode(glb).decode(),
        "way": str([[round(coordinate, 2) for coordinate in place] for place in track]),
        "rate": str(rate_hz),
        "script": _load_viewer_script().replace("</script", "<\\/script"),
    }.items():
        page = page.replace(f"{{{name}}}", value)
    save_bytes(path, page.encode())


def _load_viewer_script() -> str:
    """Return the JavaScript of the 3-D viewer; FinloopError if it is not the published file."""
    script = _SCRIPT.read_bytes()
    if (digest := hashlib.sha256(script).hexdigest()) != _SHA256:
        raise FinloopError(
            f"{_SCRIPT} is damaged: its sha256 is {digest}",
            f"the viewer, whose sha256 is {_SHA256}",
            "bring it back: git checkout the file, or install finloop again",
        )
    return script.decode()
