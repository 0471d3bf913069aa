"""The pages: each one HTML text with all that it needs, its policy, and the form of its data.

A page has exactly one script and one style, from the files in `page/`, so that its policy can
forbid the browser to run anything else.
"""

import base64
import hashlib
import json
import re
from pathlib import Path
from typing import Any

DRAWING = ("strip.js", "shaders.js", "view.js", "draw.js", "motion.js")
"""The scripts that draw and move the fish, on every page that shows them."""
TANK = ("link.js", *DRAWING, "tank.js")
"""The scripts of a page that shows what a server sends."""
_FILES = Path(__file__).with_name("page")


def read_page_file(name: str) -> str:
    """Return the text of a file in the folder `page`."""
    return (_FILES / name).read_text(encoding="utf-8")


def join_scripts(*names: str) -> str:
    """Return some JavaScript files of the folder `page`, joined to one script in strict mode."""
    return '"use strict";\n' + "\n".join(map(read_page_file, names))


def build_page(name: str, *scripts: str) -> str:
    """Return a page's HTML with scripts put in, and desk.css where it has the mark /*style*/.

    name, scripts: files in the folder `page`. Other marks, such as /*title*/ and /*data*/, stay.
    """
    page = read_page_file(name).replace("/*style*/", read_page_file("desk.css"))
    return page.replace("/*script*/", join_scripts(*scripts))


def build_display_page() -> str:
    """Return the HTML of the page that the live animals see; its server sends what it shows."""
    return build_page("display.html", *TANK, "levels.js", "panel.js", "display.js")


def build_experimenter_page() -> str:
    """Return the HTML of the page from which a session is run."""
    return build_page("experimenter.html", "link.js", "experimenter.js")


def build_tank_page() -> str:
    """Return the HTML of the page of the live tank."""
    return build_page("play.html", *TANK, "play.js")


def make_content_policy(page: str, sources: str) -> str:
    """Return the Content-Security-Policy by which a page may run its own script and style only.

    page: HTML; sources: further directives, such as "img-src data:".
    """
    hashes: dict[str, str] = {}
    for tag in ("script", "style"):
        texts = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
        digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()) for text in texts]
        hashes[tag] = " ".join(f"'sha256-{digest.decode()}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {hashes['script']}; style-src {hashes['style']}; "
        f"{sources}; base-uri 'none'; form-action 'none'"
    )


def pack_message(facts: dict[str, Any], payload: bytes = b"") -> bytes:
    """Return a message to a page as bytes: the length of a JSON text, that text, the payload.

    facts: content of the JSON text. The length takes 4 bytes, little-endian.
    """
    text = json.dumps(facts, separators=(",", ":")).encode()
    return len(text).to_bytes(4, "little") + text + payload
