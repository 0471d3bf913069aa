"""Speed of drawing a frame in another pose, against `cv2.remap` of the same size in the same run.

`python -m benchmarks.puppet` prints the table and writes benchmarks/puppet.csv. Frames of the
zebrafish and of a drawn carp in colour, 110 px pictures, random rows in poses of others, one core.
`cv2.remap` gets the same frames with precomputed maps; the table names its filter.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import tempfile
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from benchmarks.pipeline import prepare_folder, run_stage, write_table
from benchmarks.speed import time_pairs
from finloop.base.cutout import Cutout
from finloop.base.settings import settings
from finloop.distance.picture import SPAN
from finloop.features.table import USED, measure_features
from finloop.project import Project
from finloop.puppet import Pose, draw_in_pose, poses_from_features

SIZE, ROWS, LEAST_HZ, MOST_RATIO = 110, 300, 3000, 4
FILMS = {
    "zebrafish, grey": ["clip=zebrafish", "clip.parts=A"],
    "drawn carp, colour": ["clip=carp", "clip.frames=300"],
}
FILTERS = {"linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC}


def random_frames(folder: Path, overrides: list[str]) -> tuple[list[Cutout], list[Pose]]:
    """Return random frames of a film, and their poses."""
    prepare_folder(folder, overrides)
    for word in ("clip", "extract"):
        run_stage(folder, word)
    with Project(folder) as project:
        tracks, rate = project.tracks(USED), project.rate_hz
        poses = poses_from_features(*measure_features(tracks, rate, settings("features")))
        rows = np.random.default_rng(0).integers(len(poses), size=ROWS).tolist()
        return [project.cutouts[row] for row in rows], [poses[row] for row in rows]


def draw_frames(
    cutouts: list[Cutout], own_poses: list[Pose], target_poses: list[Pose], sharp: bool
) -> None:
    """Draw every frame in the pose of its target."""
    for cutout, pose, target in zip(cutouts, own_poses, target_poses, strict=True):
        draw_in_pose(cutout, pose, target, (SIZE, SIZE), sharp=sharp)


def remap_frames(cutouts: list[Cutout], maps: tuple[np.ndarray, np.ndarray], flag: int) -> None:
    """Remap as many pictures of the same size with cv2.remap alone."""
    for cutout in cutouts:
        cv2.remap(cutout.pixels, *maps, flag)


def main() -> None:
    """Time drawing and cv2.remap; print and write the table."""
    cv2.setNumThreads(1)
    results = []
    middle = (SIZE - 1) / 2
    v, u = np.indices((SIZE, SIZE), np.float32) * np.float32(0.7)
    for name, overrides in FILMS.items():
        with tempfile.TemporaryDirectory() as folder:
            cutouts, own = random_frames(Path(folder), overrides)
        targets = [pose.move_to(middle, middle, 0, SIZE / SPAN) for pose in own[1:] + own[:1]]
        for our_filter, peer_filter in (("linear", "linear"), ("cubic", "linear"), ("cubic",) * 2):
            mine, theirs, ratio, _ = time_pairs(
                partial(draw_frames, cutouts, own, targets, our_filter == "cubic"),
                partial(remap_frames, cutouts, (u, v), FILTERS[peer_filter]),
            )
            what = f"{name}, {our_filter} / cv2.remap, {peer_filter}"
            results.append((what, ROWS / mine, ROWS / theirs, ratio))
    table = pd.DataFrame(results, columns=["what", "pictures_per_s", "remaps_per_s", "time_ratio"])
    table = table.round({"pictures_per_s": 0, "remaps_per_s": 0, "time_ratio": 2})
    write_table(__file__, table)
    print(f"wanted: {LEAST_HZ} pictures/s, ratio {MOST_RATIO} at most")


if __name__ == "__main__":
    main()
