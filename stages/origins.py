"""Note what a stage's folder was made from, as digests in its file made_from.yaml.

A stage that reads data/pose reads data/features, too. Without this note, dvc.yaml would list both
for each such stage, and dvc.lock would hold four lines or five for each of them. With it the folder
data/pose differs whenever data/features does, so a stage lists the nearest folder alone.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from finloop.base.program import shipped_folder
from finloop.io.atomic import save_bytes

DECLARED = Path("data/code/declared.yaml")  # what `meta` of dvc.yaml declares, by stage
NOTE = "made_from.yaml"


def read_stages() -> dict[str, Any]:
    """Return the stages of finloop's dvc.yaml, name → keys such as cmd, deps, outs and meta."""
    text = (shipped_folder() / "dvc.yaml").read_text(encoding="utf-8")
    return yaml.load(text, yaml.CSafeLoader)["stages"]


def output_paths(stage: Mapping[str, Any]) -> list[str]:
    """Return the paths that a stage of dvc.yaml writes, in the order of outs, metrics and plots."""
    outputs = [*stage.get("outs", []), *stage.get("metrics", []), *stage.get("plots", [])]
    # An output with options is {path: options}.
    return [next(iter(output)) if isinstance(output, dict) else output for output in outputs]


def paths_to_note(stage: Mapping[str, Any]) -> list[str]:
    """Return the paths whose digests a stage writes into its first folder.

    They are its other outputs, and those inputs that `passes_on` names in `meta` of dvc.yaml.
    """
    return [*stage.get("meta", {}).get("passes_on", []), *output_paths(stage)[1:]]


def note_origins(name: str) -> None:
    """Write made_from.yaml, digests of `paths_to_note`, into the first folder that a stage wrote.

    name: of the stage in dvc.yaml. Nothing is written for another name, or without such paths.
    """
    stage = read_stages().get(name, {})
    folder = Path(next(iter(output_paths(stage)), ""))
    if folder.is_dir() and (paths := paths_to_note(stage)):
        digests = {path: path_digest(Path(path)) for path in paths}
        save_bytes(folder / NOTE, yaml.safe_dump(digests).encode())


def path_digest(path: Path) -> str:
    """Return a digest of a file, or of the names and contents of all files in a folder."""
    digest = hashlib.sha256()
    for part in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if part.is_file():
            with part.open("rb") as file:
                content = hashlib.file_digest(file, "sha256").hexdigest()
            digest.update(f"{part.relative_to(path).as_posix()} {content}\n".encode())
    return digest.hexdigest()
