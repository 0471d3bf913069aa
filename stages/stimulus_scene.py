"""The film behind a stimulus, opened with its pictures, and the display that shows it."""

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from platform import platform, python_version
from typing import Any

import finloop
from finloop.base.errors import FinloopError
from finloop.edit.schema import FRAME
from finloop.live.tank import rehearse_paths
from finloop.project import Project
from finloop.render.gallery import PLACE, Gallery, build_shelves
from finloop.stimulus.display import load_display
from finloop.stimulus.feed import Feed, TankCanvas
from finloop.stimulus.log import FORMAT
from finloop.stimulus.motion import TrialContext, rehearse_stimulus
from finloop.stimulus.order import Trial
from finloop.stimulus.pictures import PagePictures
from finloop.stimulus.protocol import Protocol
from stages.modes.matching import open_mode
from stages.settings import load

DISPLAYS = Path("conf/local/displays")
_SOFTWARE = ("numpy", "numba", "scipy", "scikit-image", "opencv-contrib-python-headless", "torch")
_MADE_FROM = (
    "extract/tracks.parquet", "extract/background.png", "features/features.parquet",
    "pose/poses.parquet", "pose/shapes.json", "jumps/jumps.parquet",
)  # fmt: skip
_PLANNED_BY = ("animate", "matching")


@dataclass(frozen=True)
class FilmedScene:
    """A film opened for a stimulus: what plans its motion, and the pictures for the page."""

    scene: TrialContext
    pictures: PagePictures
    tank: TankCanvas  # empty
    film: str  # a digest of the film's results

    def feed(self, looks: list[dict[str, Any]], fish: int, **facts: Any) -> Feed:
        """Return the data that display pages receive; `fish`: how many; `facts`: further fields."""
        scene = self.scene
        more = {
            "rate": scene.rate_hz, "posture": scene.posture, "looks": looks, "fish": fish,
            "mm_per_px": scene.mm_per_px, "typical": self.pictures.measure_typical_fish(),
        }  # fmt: skip
        return Feed(self.tank, more | facts, self.pictures)

    def header(self, plan: Protocol, trials: tuple[Trial, ...], **facts: Any) -> dict[str, Any]:
        """Return the header of a session's file: software, protocol, trials, film, parameters."""
        software = {"python": python_version(), "system": platform()}
        return {
            "format": FORMAT, "finloop": finloop.__version__,
            "begun": datetime.now().astimezone().isoformat(timespec="seconds"),
            "software": software | {name: version(name) for name in _SOFTWARE},
            "protocol": plan.model_dump(mode="json", by_alias=True),
            "trials": [one._asdict() for one in trials],
            "film": self.film, "rate_hz": self.scene.rate_hz, "posture": self.scene.posture,
            "mm_per_px": self.scene.mm_per_px, "looks": looks_of(plan),
            "animate": _parameters(*_PLANNED_BY), **facts,
        }  # fmt: skip

    def find_differences(self, header: dict[str, Any]) -> list[str]:
        """Return what differs from a session with this header: "film", or `group.key`."""
        film = ["film"] if self.film != header["film"] else []
        then = header["animate"]
        return film + [
            f"{word}.{name}"
            for word in _PLANNED_BY
            for name, value in _parameters(word).items()
            if value != then.get(name)
        ]


def _parameters(*words: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for word in words:
        values |= json.loads(json.dumps(asdict(load(word))))
    return values


def looks_of(plan: Protocol) -> list[dict[str, Any]]:
    """Return the looks of a protocol as the dicts that the page reads, one per look."""
    return [look.message for look in plan.looks]


@contextmanager
def open_scene(plan: Protocol | None = None) -> Iterator[FilmedScene]:
    """Yield the film and all that a session needs, opened from the stages' results.

    plan: None where no fish is to swim. FinloopError also if the film has no mode `matching`, or
    the protocol has rules of a school and the film shows none.
    """
    fish_mm = None if plan is None else plan.display.fish_mm
    with Project() as project:
        brought = open_mode(project)
        reel, bodies = brought.pictures.reel, brought.pictures.bodies
        gallery = Gallery(build_shelves({FRAME: reel.film}, project.tracks(PLACE), None), bodies)
        film_mm, length_px = project.facts.mm_per_px, brought.world.motion.body_length_px
        mm_per_px = fish_mm / length_px if fish_mm else film_mm and film_mm / reel.size
        pictures = PagePictures(gallery, reel.size)
        height, width = pictures.largest_px
        made = TrialContext(brought.player, bodies, mm_per_px)
        if plan is not None:
            rehearse_paths(brought.player)
            rehearse_stimulus(made)
        tank = TankCanvas(project.background, width, height)
        yield FilmedScene(made, pictures, tank, _digest(project.data))


def _digest(data: Path) -> str:
    digest = hashlib.sha256()
    for name in _MADE_FROM:
        path = data / name
        if path.is_file():
            with path.open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()[:16]


def display_file(name: str) -> Path:
    """Return the path of a display's calibration; raise FinloopError if its name is unusable."""
    if not name.replace("-", "").replace("_", "").isalnum():
        raise FinloopError(
            f"a display has the name {name!r}",
            "a name of letters, digits, - and _",
            "take another name (--display)",
        )
    return DISPLAYS / f"{name}.json"


def known_display(name: str, demanded: bool) -> dict[str, Any] | None:
    """Return a display's calibration, ready for JSON; None where it has none and needs none.

    FinloopError where one is demanded and missing, or it is damaged.
    """
    path = display_file(name)
    if path.exists():
        return load_display(path).model_dump(mode="json")
    if demanded:
        raise FinloopError(
            f"the display {name} is not calibrated ({path} is missing)",
            "a display of known size and levels, which the protocol requires",
            f"calibrate it: python -m stages.stimulus calibrate --display {name}; or write "
            "display: {calibrated: false} in the protocol",
        )
    return None
