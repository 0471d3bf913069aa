"""The doors of the rooms: each opens with what it is, and its verbs are there when they are used."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import finloop
from finloop import verbs

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


def test_the_door_of_the_library_hands_out_documented_verbs():
    assert finloop.__all__ == verbs.__all__
    assert all(getattr(finloop, name).__doc__ for name in finloop.__all__)


EARLY = """
import sys
def show(*names): print({*names} & {*sys.modules})
import finloop
show("numpy", "cv2", "finloop.verbs")
import finloop.bpn, finloop.export, finloop.io, finloop.loops, finloop.plots
heavy = "cv2", "matplotlib", "numba", "scipy", "skimage", "torch", "vtkmodules"
show("pyarrow", *heavy)
from finloop.base.settings import GROUPS, variants
for word in GROUPS: variants(word)
show("pandas", *heavy)
"""


def test_doors_and_declarations_cost_nothing_until_they_are_used():
    """DVC imports every declaration while it composes; none may bring its algorithm with it."""
    said = subprocess.check_output([sys.executable, "-c", EARLY], cwd=ROOT, text=True)
    assert said.split() == ["set()"] * 3
