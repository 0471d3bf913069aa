"""Take over results that a colleague has pushed, so that no stage runs again: `make pull`.

DVC's remote brings what DVC keeps, and the list of earlier runs (`dvc pull --run-cache`). Numbers
and curves come by Git: DVC neither pushes nor pulls them, yet restores a stage from its cache only
if it finds them there, too. So they are copied from Git into that cache.
"""

from stages.run import run  # isort: skip

import hashlib
import re
import subprocess
import sys
from pathlib import Path

from finloop.io.atomic import save_bytes
from stages.repository import DVC, run_dvc, run_git

LISTED = re.compile(r"path: (reports/\S+\.(?:csv|json))\s+hash: md5\s+md5: (\w+)$", re.MULTILINE)
"""Path and digest of a file of numbers, in dvc.lock and in the list of earlier runs."""


def cache_committed_numbers(cache: Path) -> int:
    """Copy numbers and curves that Git has into DVC's cache; return how many files.

    cache: its folder. Only those are copied that dvc.lock or the list of earlier runs names and the
    cache lacks. Files that no commit has are left out.
    """
    lists = [Path("dvc.lock"), *(cache / "runs").glob("*/*/*")]
    paths = {
        digest: path
        for text in (file.read_text(encoding="utf-8") for file in lists if file.is_file())
        for path, digest in LISTED.findall(text)
    }
    missing = {digest: _cached_file(cache, digest) for digest in paths}
    missing = {digest: file for digest, file in missing.items() if not file.exists()}
    if not missing:
        return 0
    names = {paths[digest] for digest in missing}
    # With --full-history also versions that a merge did not take.
    listed = run_git("rev-list", "--objects", "--all", "--full-history", "--", *sorted(names))
    versions = [line.split(maxsplit=1) for line in listed.splitlines()]
    copied = 0
    for blob in {blob for blob, *name in versions if name and name[0] in names}:
        content = run_git("cat-file", "blob", blob).encode()
        if file := missing.pop(hashlib.md5(content, usedforsecurity=False).hexdigest(), None):
            file.parent.mkdir(parents=True, exist_ok=True)
            save_bytes(file, content)
            file.chmod(0o444)  # as DVC does: it trusts such a file
            copied += 1
    return copied


def _cached_file(cache: Path, digest: str) -> Path:
    """Return where DVC's cache keeps the file with this digest."""
    return cache / "files/md5" / digest[:2] / digest[2:]


def main() -> None:
    """Pull DVC's files and run cache; copy the numbers that Git has; exit with DVC's status."""
    pulled = subprocess.run([*DVC, "pull", "--run-cache", *sys.argv[1:]], check=False)
    cache = Path(run_dvc("cache", "dir", folder=Path.cwd())[1].strip())
    print(f"{cache_committed_numbers(cache)} files with numbers of Git are in DVC's cache now")
    sys.exit(pulled.returncode)


if __name__ == "__main__":
    run(main)
