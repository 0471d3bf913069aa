"""Write checksums into a stage's folder: of what it has written, and of what that was made from.

A stage that reads data/pose reads data/features, too. Without these checksums, dvc.yaml would list
both for each such stage, and dvc.lock would hold four lines or five for each of them. With them the
folder data/pose differs whenever data/features does, so a stage lists the nearest folder alone.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from finloop.base.program import shipped_folder
from finloop.io.checksums import file_digest, files_or_record, save_checksums

DECLARED = Path("data/code/declared.yaml")  # what `meta` of dvc.yaml declares, by stage


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
    return [*_inputs_to_note(stage), *output_paths(stage)[1:]]


def _inputs_to_note(stage: Mapping[str, Any]) -> list[str]:
    """Return the inputs that `passes_on` names in `meta` of a stage of dvc.yaml."""
    return [*stage.get("meta", {}).get("passes_on", [])]


def note_origins(name: str) -> None:
    """Write the record of checksums (`finloop.io.checksums`) into the folders that a stage wrote.

    name: of the stage in dvc.yaml. The records have its other files, too; that of its first folder
    has its other folders, and what `passes_on` names. Nothing is written for another name, or if
    the first is no folder.
    """
    stage = read_stages().get(name, {})
    first, *others = map(Path, output_paths(stage) or [""])
    if stage and first.is_dir():
        for folder in filter(Path.is_dir, others):
            save_checksums(folder, filter(Path.is_file, others))
        written = [part for path in others for part in (path, *path.rglob("*"))]
        save_checksums(first, written, map(Path, _inputs_to_note(stage)))


def path_digest(path: Path) -> str:
    """Return a digest of a file, or of the names and contents of all files in a folder.

    The checksums in a folder, which are compared when its files are read, stand for these.
    """
    digest = hashlib.sha256()
    for part in sorted(files_or_record(path)):
        if part.is_file():
            digest.update(f"{part.relative_to(path).as_posix()} {file_digest(part)}\n".encode())
    return digest.hexdigest()
