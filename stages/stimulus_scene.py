"""Open the film for a stimulus, with its pictures, and the display that shows it."""

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
from finloop.live.tank import warm_up_paths
from finloop.project import Project
from finloop.render.gallery import PLACE, Gallery, build_cutout_sets
from finloop.show.feed import Feed, TankCanvas
from finloop.show.pictures import PagePictures
from finloop.stimulus.display import load_display
from finloop.stimulus.log import FORMAT
from finloop.stimulus.motion import TrialContext, warm_up_stimulus
from finloop.stimulus.order import Trial
from finloop.stimulus.protocol import Protocol
from finloop.stimulus.screen import ScreenCheck
from stages.modes.matching import open_mode
from stages.settings import load_settings

DISPLAYS = Path("conf/local/displays")
_SOFTWARE = ("numpy", "numba", "scipy", "scikit-image", "opencv-contrib-python-headless", "torch")
_MADE_FROM = (
    "extract/tracks.parquet", "extract/background.png", "features/features.parquet",
    "pose/poses.parquet", "pose/shapes.json", "jumps/jumps.parquet",
)  # fmt: skip
_PLANNED_BY = ("animate", "matching")


@dataclass(frozen=True)
class FilmedScene:
    """An opened film: the planner of motion, and the pictures for the display."""

    context: TrialContext
    pictures: PagePictures
    tank: TankCanvas  # empty
    film: str  # a digest of the film's results

    def feed(self, looks: list[dict[str, Any]], fish: int, **facts: Any) -> Feed:
        """Return the data that display pages receive: the empty tank, pictures, and further fields.

        looks: those of the protocol, for the page. fish: number of fish. facts: further fields.
        """
        context = self.context
        fields = {
            "rate": context.rate_hz, "posture": context.posture, "looks": looks, "fish": fish,
            "mm_per_px": context.mm_per_px, "typical": self.pictures.measure_typical_fish(),
        }  # fmt: skip
        return Feed(self.tank, fields | facts, self.pictures)

    def screen_check(self, name: str) -> ScreenCheck | None:
        """Return what counts fish outside a display; None if it is not calibrated. name: of it."""
        path = display_file(name)
        if not path.exists():
            return None
        context = self.context
        return ScreenCheck(load_display(path), context.world.tank.legal, context.mm_per_px)

    def header(self, protocol: Protocol, trials: tuple[Trial, ...], **facts: Any) -> dict[str, Any]:
        """Return the header of a session's file: software, protocol, trials, film, parameters.

        trials: in the order in which they are shown. facts: further fields.
        """
        software = {"python": python_version(), "system": platform()}
        return {
            "format": FORMAT, "finloop": finloop.__version__,
            "begun": datetime.now().astimezone().isoformat(timespec="seconds"),
            "software": software | {name: version(name) for name in _SOFTWARE},
            "protocol": protocol.model_dump(mode="json", by_alias=True),
            "trials": [trial._asdict() for trial in trials],
            "film": self.film, "rate_hz": self.context.rate_hz, "posture": self.context.posture,
            "mm_per_px": self.context.mm_per_px, "looks": look_messages(protocol),
            "animate": _load_parameters(*_PLANNED_BY), **facts,
        }  # fmt: skip

    def find_changes_since(self, header: dict[str, Any]) -> list[str]:
        """Return what has changed since a session was recorded; [] if it can be shown again.

        It is "film" if the session used another one, and `group.key` of each parameter of the
        planner that had another value. header: of the session's file.
        """
        changes = ["film"] if self.film != header["film"] else []
        values_then = header["animate"]  # of all groups of `_PLANNED_BY`, by key
        for group in _PLANNED_BY:
            for key, value in _load_parameters(group).items():
                if value != values_then.get(key):
                    changes.append(f"{group}.{key}")
        return changes


def _load_parameters(*groups: str) -> dict[str, Any]:
    """Return the parameters of several groups in one dictionary, by name."""
    values: dict[str, Any] = {}
    for group in groups:
        values |= json.loads(json.dumps(asdict(load_settings(group))))  # tuples become lists
    return values


def look_messages(protocol: Protocol) -> list[dict[str, Any]]:
    """Return the looks of a protocol as the page reads them, a dict per look."""
    return [look.to_json_values for look in protocol.looks]


@contextmanager
def open_scene(protocol: Protocol | None = None) -> Iterator[FilmedScene]:
    """Yield an opened film for a stimulus, from the stages' results.

    protocol: None where no fish is to swim. FinloopError if the film shows too little for mode
    `matching`, or if the protocol has rules for a school and the film shows none.
    """
    fish_mm = None if protocol is None else protocol.display.fish_mm
    with Project() as project:
        animator = open_mode(project)
        reel, bodies = animator.pictures.reel, animator.pictures.bodies
        cutout_sets = build_cutout_sets({FRAME: reel.cutouts}, project.tracks(PLACE), None)
        gallery = Gallery(cutout_sets, bodies, residue=False)  # looks and grounds of its own
        mm_per_px = _mm_per_px(
            fish_mm, animator.world.motion.body_length_px, project.facts.mm_per_px, reel.scale
        )
        pictures = PagePictures(gallery, reel.scale)
        height, width = pictures.largest_px
        context = TrialContext(animator.player, bodies, mm_per_px)
        if protocol is not None:  # compile functions now, so that no trial waits for it
            warm_up_paths(animator.player)
            warm_up_stimulus(context)
        tank = TankCanvas(project.background, width, height)
        yield FilmedScene(context, pictures, tank, _results_digest(project.data))


def _mm_per_px(
    fish_mm: float | None, length_px: float, film_mm_per_px: float | None, scale: float
) -> float | None:
    """Return how many mm one px of the animation shows; None if unknown.

    fish_mm: body length that the protocol wants, None = as the film's mm per px give it. length_px:
    body length in the animation. scale: px of the animation per px of the film.
    """
    if fish_mm:
        return fish_mm / length_px
    return film_mm_per_px / scale if film_mm_per_px else None


def _results_digest(data: Path) -> str:
    """Return a digest, 16 hexadecimal digits, of the results that an animation is made from.

    data: the folder data/. Missing files are left out.
    """
    digest = hashlib.sha256()
    for name in _MADE_FROM:
        path = data / name
        if path.is_file():
            with path.open("rb") as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()[:16]


def display_file(name: str) -> Path:
    """Return the path of a display's calibration file; FinloopError if the name cannot be one."""
    if not name.replace("-", "").replace("_", "").isalnum():
        raise FinloopError(
            f"a display has the name {name!r}",
            "a name of letters, digits, - and _",
            "take another name (--display)",
        )
    return DISPLAYS / f"{name}.json"


def load_display_calibration(name: str, required: bool) -> dict[str, Any] | None:
    """Return the calibration of a display, ready for JSON; None if there is none.

    name: of the display. FinloopError if one is required and missing, or it is damaged.
    """
    path = display_file(name)
    if path.exists():
        return load_display(path).model_dump(mode="json")
    if required:
        raise FinloopError(
            f"the display {name} is not calibrated ({path} is missing)",
            "a display of known size and levels, which the protocol requires",
            f"calibrate it: python -m stages.stimulus calibrate --display {name}; or write "
            "display: {calibrated: false} in the protocol",
        )
    return None
