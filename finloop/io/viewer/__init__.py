"""A page that shows a .glb and plays its animation, all in one file: it needs no network.

The viewer is <model-viewer> (Apache-2.0), from the installed package `dash-model-viewer`, which is
used for nothing else and never imported.
"""

import base64
import html
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes

_PACKAGE, _SCRIPT = "dash-model-viewer", "dash_model_viewer/vendor/model-viewer-umd.min.js"
_PAGE = Path(__file__).with_name("page.html")


def save_viewer(
    path: Path, glb: bytes, title: str, alt: str, track: list[list[float]], rate_hz: float
) -> None:
    """Write an HTML page that shows a 3-D scene (.glb) with a camera that can follow the fish.

    alt: a description of the scene for screen readers. track: the fish's place x, y, z at every
    tick, in units of the .glb. rate_hz: ticks per second. FinloopError if the viewer is not
    installed.
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
    """Return the JavaScript of the 3-D viewer; FinloopError if its package is not installed."""
    try:
        return Path(str(distribution(_PACKAGE).locate_file(_SCRIPT))).read_text(encoding="utf-8")
    except (PackageNotFoundError, OSError) as error:
        raise FinloopError(
            f"the viewer for the 3-D page is not there ({error})",
            f"the package {_PACKAGE}, whose file {_SCRIPT} goes into the page",
            "make setup; or: pip install --no-deps dash-model-viewer==1.0.0",
        ) from error
