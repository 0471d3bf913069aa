"""Write docs/licences.md from a list of packages in CycloneDX: `python -m docs.licences FILE`."""

import json
import sys
from pathlib import Path
from typing import Any

from finloop.io.atomic import save_bytes

PAGE = Path("docs/licences.md")
_HEAD = """# Licences of the packages

What `make setup` installs, with the licence that each package states of itself. `make sbom` writes
this page, and the same list for programs, `sbom.cdx.json` ([CycloneDX](https://cyclonedx.org)).
finloop itself is under the MIT licence. In its folder `finloop/io/viewer/` lies one file of the npm
package `@google/model-viewer` 4.4.0, under Apache-2.0.

| package | version | licence |
|---|---|---|
"""
_MARK = "License :: OSI Approved :: "  # of the classifiers on the package index


def licences_page(sbom: dict[str, Any]) -> str:
    """Return the page of all packages in a CycloneDX list, with their versions and licences."""
    rows = []
    for part in sorted(sbom["components"], key=lambda part: part["name"].lower()):
        version = part["version"].partition("+")[0]  # without the build, as in 2.13.0+cpu
        rows.append(f"| {part['name']} | {version} | {_describe_licence(part)} |\n")
    return _HEAD + "".join(rows)


def _describe_licence(part: dict[str, Any]) -> str:
    """Return the licence of a package: its expression or name, else its classifiers."""
    stated = []
    for entry in part.get("licenses", []):
        licence = entry.get("license", {})
        stated.append(entry.get("expression") or licence.get("id") or licence["name"])
    named = [text for text in stated if not text.startswith(_MARK)]
    names = named or [text.removeprefix(_MARK) for text in stated]
    return ", ".join(names) or "not stated in the package's metadata"


if __name__ == "__main__":
    save_bytes(PAGE, licences_page(json.loads(Path(sys.argv[1]).read_text("utf-8"))).encode())
