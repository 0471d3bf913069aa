"""The locks hold a digest of every file of every package, and the page all licences."""

import re
import tomllib

import pytest
from conftest import ROOT

LOCKS = {path.stem.removeprefix("requirements").strip("-"): path.read_text("utf-8")
         for path in ROOT.glob("requirements*.lock")}  # fmt: skip
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def plain(name: str) -> str:
    """A package's name as indexes compare it, without what is asked of its version."""
    return re.sub(r"[-_.]+", "-", re.split(r"[\[<>=]", name)[0]).lower()


def pins(lock: str) -> dict[str, str]:
    """The version of each package in a lock, by name."""
    found = re.findall(r"^([^\s#=]+)==(\S+)", LOCKS[lock], re.M)
    return {plain(name): version for name, version in found}


@pytest.mark.parametrize("lock", sorted(LOCKS))
def test_every_package_has_digests_and_pytorch_alone_none(lock):
    parts = re.split(r"^(?=[^\s#])", LOCKS[lock], flags=re.M)[1:]
    assert len(parts) == len(pins(lock)) > 0
    for part in parts:
        assert bool(re.search(r"--hash=sha256:[0-9a-f]{64}", part)) == (lock != "torch"), part
    assert "://" not in LOCKS[lock]  # an index is everybody's own


def test_the_locks_have_what_the_project_names():
    wanted = {"": PROJECT["project"]["dependencies"]}
    wanted |= {**PROJECT["project"]["optional-dependencies"], **PROJECT["dependency-groups"]}
    for lock, names in wanted.items():
        have = pins("").keys() | pins("torch").keys() | pins(lock).keys()
        assert set(map(plain, names)) <= have, lock
    asked = (ROOT / "requirements-tracks.in").read_text("utf-8").splitlines()
    assert pins("tracks").keys() == {plain(line) for line in asked if not line.startswith("#")}


def test_the_page_of_licences_lists_what_the_locks_install():
    rows = re.findall(
        r"^\| (\S+) \| (\S+) \| .+ \|$", (ROOT / "docs/licences.md").read_text("utf-8"), re.M
    )
    listed = {plain(name): version for name, version in rows if name not in ("package", "pip")}
    locked = pins("") | pins("tests") | pins("torch")
    elsewhere = re.findall(
        r"^(\S+)==.* ; sys_platform == '(?:darwin|win32|emscripten)'", LOCKS[""], re.M
    )
    assert listed == {name: version for name, version in locked.items() if name not in elsewhere}
