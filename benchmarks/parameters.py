"""Search for parameters of conf/ without effect, by changing each in turn on tiny films.

`python -m benchmarks.parameters [group …]` gives each parameter another value, runs the stages that
read it, and compares the outputs byte by byte. A parameter is dead if it changes no output on any
film and `WHEN` does not explain it. The last line lists the dead parameters, and the exit status is
1 if there are any. A value that makes a stage fail does not count.
"""

import contextlib
import hashlib
import importlib
import io
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import pandas as pd
import yaml

from benchmarks.pipeline import ROOT, load_stages, written_paths
from finloop.base.override import format_override
from finloop.base.settings import WORDS, variants
from finloop.edit.modes import MODES
from stages.code import stage_module
from stages.compose import compose_params

FILM = [
    "clip=carp", "clip.frames=300", "clip.width_px=320", "clip.height_px=240",
    "clip.body_length_px=70", "clip.colour=false", "clip.seed=7", "features.orientations=12",
    "loops.distance_threshold=1", "bpn.epochs=5", "bpn.held_out_block_deltas=3",
    "forecast.epochs=30", "forecast.held_out_block_deltas=3",
    "animate.seconds=6", "animate.trials=3", "realism.seconds=8", "realism.window_deltas=1",
    "realism.cross_validation_folds=2", "realism.classifier_trees=5",
    "tank.seconds=0.3", "tank.width_px=160", "tank.height_px=120",
    "morph.frames=8", "morph.contour_points=64",
    "render.webp_seconds=1", "render.comparison_seconds=1", "export.webp_seconds=1",
]  # fmt: skip
PLAYED = (*(f"modes-{mode}" for mode in MODES), "animate")
MORE: dict[str, tuple[list[str], Sequence[str]]] = {
    "two fish": (["matching.fish=2", "matching.rule=zones"], PLAYED),
    "a path": (["matching.path=track:0"], PLAYED),
    "predictions alone": (["matching.uses=[forecast]"], PLAYED),
    "inertial": (
        ["hybrid.join=inertial", "network.join=inertial", "loops.join=inertial"], PLAYED,
    ),
    "three carp": (
        ["clip.fish=3", "retarget.tracks=track:0", "retarget.allow_own_frames=false"],
        ("clip", "extract", "features", "identity", "calibrate", "pose", "jumps", "distance",
         "retarget"),
    ),
}  # fmt: skip
"""Further runs: their settings in addition to FILM, and the stages to run again."""
OTHER = {
    "morph.first_drawing": "data/drawings/face_b.svg",
    "morph.last_drawing": "data/drawings/face_a.svg",
    "morph.wavelet": "db4",
    "gait.wavelet": "db4",
    "gait.walker_drawings": ["data/drawings/dog_2.svg", "data/drawings/dog_1.svg"],
    "gait.swimmer_drawings": ["data/drawings/fish_2.svg", "data/drawings/fish_1.svg"],
    "gait.swimmer_gait": None,
    "retarget.tracks": "track:1",
}
"""The value to try for a parameter for which `other_values` finds no effective value."""
WHEN: dict[str, str] = {
    "matching.follow_pairs": "several fish, one of which follows another",
    "matching.path": "a fish that is to swim a path",
    "animate.goal_unit": "goals given in px",
    "bpn.held_out_by": "films of several tracks",
    "export.tracks_min_s": "films of shorter tracks",
    "export.tracks_netcdf": "a machine with `make tracks`",
    "export.tracks_nwb": "a machine with `make tracks`",
    "extract.max_link_distance_bl": "animals that swim farther than that from frame to frame",
    "extract.min_track_frames": "films of shorter tracks",
    "extract.min_area_ratio": "films with specks, or animals of several sizes",
    "extract.max_area_ratio": "animals that touch",
    "extract.min_contrast_ratio": "reflections in the walls of a tank",
    "extract.tracks_path": "tracks of another program",
    "identity": "tracks that end and begin again: several animals that cross",
    "calibrate": "films of several animals",
    "gait.regions": "a film of limbs of one's own",
    "gait.symmetry": "a film of limbs of one's own",
    "morph.pairs": "a file of pairs",
    "morph.forces": "the physical morph (`morph.method`)",
    "loops.loop_end_choice": "loop ends at which two ways pass the tests, as on the zebrafish",
    "render.shadow_darkness": "several fish that swim over one another (`matching.overlap`)",
    "retarget.allow_backwards": "an animal that goes tail first",
    "retarget.keypoint_range": "tracks of another program",
    "retarget.animal": "tracks of another program",
    "retarget.body_keypoints": "tracks of another program",
    "retarget.tracks_rate_hz": "tracks of another program",
    "retarget.min_confidence": "tracks of another program",
    "sprites.track_change_cost": "films of several tracks, as the zebrafish",
    "sprites.straight_frames": "a sequence given by hand",
    "sprites.slide_frames": "a sequence given by hand",
    "sprites.left_frames": "a sequence given by hand",
    "sprites.right_frames": "a sequence given by hand",
    "sprites.min_head_confidence": "films whose heads are doubtful",
    "sprites.min_neighbour_distance_bl": "films of several animals",
}
"""The condition for an effect of parameters without one on these films, by name or prefix."""


def when_it_acts(parameter: str) -> str:
    """Return when a parameter without effect on these films acts; empty if unknown."""
    by_prefix = (WHEN[start] for start in WHEN if parameter.startswith(start))
    return WHEN.get(parameter) or next(by_prefix, "")


def reading_stages(group: str) -> list[str]:
    """Return the stages that read a group of parameters, in their order.

    `realism` is left out of all groups but its own: it reads `extract` and `features`, too, but
    only to measure as they do.
    """
    names = []
    for name, stage in load_stages().items():
        params = stage.get("meta", {}).get("params", [])
        groups = {parameter.partition(".")[0] for parameter in params}
        if group in groups and (name != "realism" or group == "realism"):
            names.append(name)
    return names


def stage_outputs(stage: str) -> list[str]:
    """Return the files and folders that a stage writes."""
    return sorted(written_paths(load_stages()[stage]))


def digest_outputs(folder: Path, stage: str) -> str:
    """Return a digest of a stage's outputs in a folder."""
    digest = hashlib.sha256()
    for out in stage_outputs(stage):
        path = folder / out
        files = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in files:
            if file.is_file():
                digest.update(file.relative_to(folder).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()


def other_values(value_type: Any, value: Any) -> Iterator[Any]:
    """Yield other values of a parameter's type, mild changes first."""
    if get_origin(value_type) is Annotated:
        yield from other_values(get_args(value_type)[0], value)
    elif get_origin(value_type) is Literal:
        yield from (item for item in get_args(value_type) if item != value)
    elif get_origin(value_type) in (Union, UnionType):
        for part in get_args(value_type):
            yield from other_values(part, value)
    elif value_type is bool:
        yield not value
    elif value_type in (int, float):
        number = value if isinstance(value, int | float) and not isinstance(value, bool) else 1
        for factor in (2, 0.3, 0.001, 20, 1.3, 0.8):
            yield value_type(round(number * factor)) if value_type is int else number * factor
        yield from (value_type(1), value_type(0), value_type(3), number + 1, number - 1)
    elif isinstance(value, list) and value:
        yield value[:-1]
        yield [item * 1.5 if isinstance(item, float) else item for item in value]


@contextlib.contextmanager
def work_in(folder: Path) -> Iterator[None]:
    """Work in a folder, without output, until the block ends."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        os.chdir(before)


def run_stage(folder: Path, stage: str) -> str | None:
    """Run a stage in a folder; return the digest of its outputs, None if it fails."""
    with work_in(folder):
        try:
            importlib.import_module(stage_module(stage)).main()
        except Exception:
            return None
    return digest_outputs(folder, stage)


def write_params(folder: Path, overrides: list[str]) -> dict[str, Any]:
    """Write params.yaml with overrides, and return it; FinloopError if they are invalid."""
    text = compose_params(["~local", *overrides])
    (folder / "params.yaml").write_text(text, encoding="utf-8")
    values: dict[str, Any] = yaml.safe_load(text)
    return values


def run_unchanged(folder: Path, overrides: list[str], stages: Sequence[str]) -> dict[str, str]:
    """Run stages in a folder; return their digests, and print and omit those that fail."""
    for name in ("conf", "benchmarks", "data/drawings", "data/gaits"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if not (folder / name).exists():
            (folder / name).symlink_to(ROOT / name)
    write_params(folder, overrides)
    digests = {stage: run_stage(folder, stage) for stage in stages}
    for stage in (stage for stage in stages if digests[stage] is None):
        print(f"parameters: stage {stage} fails with {' '.join(overrides)}", file=sys.stderr)
    return {stage: digest for stage, digest in digests.items() if digest is not None}


def move_outputs(stage: str, source: Path, target: Path) -> None:
    """Move a stage's outputs from a folder to another, in place of those there."""
    for out in stage_outputs(stage):
        path = target / out
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        if (source / out).exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(source / out, path)


def first_changed_stage(
    group: str, key: str, base: Path, known_digests: dict[str, str], overrides: list[str]
) -> str | None:
    """Return the first stage whose output a changed parameter changes; None if there is none.

    Up to four other values are tried. base: folder with the outputs, which stay; known_digests: of
    each stage's outputs with the present value; overrides: the other parameters.
    """
    stages = [stage for stage in reading_stages(group) if stage in known_digests]
    if not stages:
        return None
    value = yaml.safe_load((base / "params.yaml").read_text())[group][key]
    option = next(kind for kind in variants(group).values() if key in get_type_hints(kind))
    hint = get_type_hints(option, include_extras=True)[key]
    tries, name = 0, f"{group}.{key}"
    for value_to_try in [OTHER[name]] if name in OTHER else other_values(hint, value):
        if value_to_try == value or tries == 4:
            continue
        with contextlib.suppress(Exception):
            write_params(base, [*overrides, f"{name}={format_override(value_to_try)}"])
            tries += 1
            for stage in stages:
                move_outputs(stage, base, base / "kept")
                digest = run_stage(base, stage)
                move_outputs(stage, base / "kept", base)
                if digest not in (None, known_digests[stage]):
                    return stage
    return None


def main() -> None:
    """Try every parameter; write benchmarks/parameters.csv."""
    wanted = sys.argv[1:] or [word for word in WORDS if word != "report"]
    all_stages = [stage for stage in load_stages() if stage not in ("code", "params")]
    rows: list[dict[str, str]] = []
    with tempfile.TemporaryDirectory() as scratch:
        base = Path(scratch) / "film"
        bases = [(base, run_unchanged(base, FILM, all_stages), FILM)]
        for name, (more_overrides, stages) in MORE.items():
            folder, overrides = Path(scratch) / name.replace(" ", "-"), [*FILM, *more_overrides]
            shutil.copytree(base, folder, symlinks=True)
            bases.append((folder, run_unchanged(folder, overrides, stages), overrides))
        values = yaml.safe_load((bases[0][0] / "params.yaml").read_text())
        for group in wanted:
            for key in values[group]:
                if key == "source":
                    continue
                changed_stage = None
                for folder, known, overrides in bases:
                    if changed_stage := first_changed_stage(group, key, folder, known, overrides):
                        break
                name = f"{group}.{key}"
                condition = "" if changed_stage else when_it_acts(name)
                rows.append(
                    {"parameter": name, "acts_on": changed_stage or "", "else_for": condition}
                )
                print(json.dumps(rows[-1], ensure_ascii=False), flush=True)
    table = pd.DataFrame(rows)
    if not sys.argv[1:]:
        table.to_csv(Path(__file__).with_suffix(".csv"), index=False)
    dead = table.loc[(table[["acts_on", "else_for"]] == "").all(axis=1), "parameter"].tolist()
    print(f"{len(table)} parameters, {len(dead)} of them change nothing: {', '.join(dead) or '-'}")
    sys.exit(bool(dead))


if __name__ == "__main__":
    main()
