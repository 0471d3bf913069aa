"""What all pages share: the policy that forbids them anything else, and the form of their data."""

import base64
import hashlib
import json
import re
from typing import Any


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
