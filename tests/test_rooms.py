"""The doors of the rooms: each opens with what it is, and its verbs are there when they are used."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = sorted(path.parent.name for path in (ROOT / "finloop").glob("*/__init__.py"))
VERBS = [room for room in ROOMS if getattr(import_module(f"finloop.{room}"), "__all__", None)]


@pytest.mark.parametrize("room", VERBS)
def test_a_room_hands_out_its_verbs(room):
    module = import_module(f"finloop.{room}")
    assert len(module.__doc__) > 80
    for name in module.__all__:
        assert getattr(module, name).__doc__, name
        assert not (ROOT / f"finloop/{room}/{name}.py").exists(), f"{name}: a verb or a module?"


def test_doors_cost_nothing_until_they_are_used():
    heavy = ("cv2", "matplotlib", "numba", "pyarrow", "scipy", "skimage", "torch")
    rooms = [room for room in ("bpn", "export", "io", "loops", "plots") if room in ROOMS]
    code = f"""
import sys
{"".join(f"import finloop.{room};" for room in rooms)}
print([name for name in {heavy} if name in sys.modules])
"""
    said = subprocess.check_output([sys.executable, "-c", code], cwd=ROOT, text=True)
    assert said.strip() == "[]"
