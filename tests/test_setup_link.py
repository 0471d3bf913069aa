"""`make setup` leaves an environment alone that belongs to another folder."""

import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_make_setup_refuses_a_linked_environment_and_empties_nothing(tmp_path: Path) -> None:
    for path in (ROOT / "Makefile", *ROOT.glob("requirements*.lock")):
        shutil.copy(path, tmp_path)
    kept = tmp_path / "other" / "pyvenv.cfg"
    kept.parent.mkdir()
    kept.write_text("home = /usr/bin\n")
    (tmp_path / ".venv").symlink_to("other")
    done = subprocess.run(["make", "setup"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode and ".venv is a link to other" in done.stdout
    assert kept.is_file()
