"""What all pages share: the policy that forbids them anything else, and the form of their data."""

import base64
import hashlib
import json
import re
from typing import Any


def make_content_policy(page: str, sources: str) -> str:
    """Return the Content-Security-Policy of a page: it may run only its own script and style.

    page: HTML; sources: further directives, such as "img-src data:".
    """
    digests = {}
    for tag in ("script", "style"):
        texts = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
        hashes = (base64.b64encode(hashlib.sha256(text.encode()).digest()) for text in texts)
        digests[tag] = " ".join(f"'sha256-{one.decode()}'" for one in hashes)
    return (
        f"default-src 'none'; script-src {digests['script']}; style-src {digests['style']}; "
        f"{sources}; base-uri 'none'; form-action 'none'"
    )


def pack_message(facts: dict[str, Any], payload: bytes = b"") -> bytes:
    """Return a message to a page as bytes: the length of a JSON text, that text, the payload.

    facts: content of the JSON text. The length takes 4 bytes.
    """
    text = json.dumps(facts, separators=(",", ":")).encode()
    return len(text).to_bytes(4, "little") + text + payload
