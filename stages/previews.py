"""Draw a picture and a short film of each experiment's animation, for the comparison page.

What an experiment has made is taken from DVC's cache: no stage runs, and the workspace stays as it
is. Experiments with the same animation share one drawing.
"""

from stages.run import THREADS, report_progress  # isort: skip  (before numpy)

import json
from collections.abc import Mapping, Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pandas as pd
import yaml
from matplotlib.figure import Figure

from finloop.base.errors import FinloopError
from finloop.base.parallel import Processes, ordered_map, start_fork_server
from finloop.edit.modes import MODES
from finloop.io.movie import Mp4Writer
from finloop.plots.render import draw_trajectory
from finloop.project import Project
from finloop.render.gallery import fish_by_tick
from finloop.render.painter import Painter
from finloop.report.compare import Preview
from stages.repository import run_git

SECONDS, WIDTH_PX, CRF = 3.0, 320, 28  # of the film
MARGIN = 1.5  # around the route in the film, in lengths of the fish as it is drawn
SHRINK, DPI = 0.5, 96  # of the figure: small, so that its words stay legible
FOLDERS = ("clip", "extract", "features", "pose", "sprites")  # in data/, that drawing needs
Digests = tuple[tuple[str, str], ...]  # path, digest of its content in DVC's cache


def choose_mode(measures: Sequence[str]) -> str:
    """Return the mode that is named in most measures; hybrid if none is."""
    counts = {
        mode: sum(name.partition(".")[2].startswith(f"{mode}_") for name in measures)
        for mode in MODES
    }
    return max(counts, key=lambda mode: counts[mode]) if any(counts.values()) else "hybrid"


def draw_previews(commits: Mapping[str, str], mode: str) -> dict[str, Preview]:
    """Draw a preview of each experiment's animation; return experiment → preview.

    commits: experiment → its commit. mode: of the animation. An experiment is left out if DVC's
    cache lacks its results, or they cannot be drawn.
    """
    from dvc.repo import Repo  # not at the top: the import takes half a second

    digests_by_name = {name: _list_digests(commit, mode) for name, commit in commits.items()}
    jobs = list(dict.fromkeys(filter(None, digests_by_name.values())))  # equal results once
    with Repo() as repo:
        cache = Path(repo.cache.local.path)
    draw = partial(_draw_from_cache, cache=cache, mode=mode)
    start_fork_server([])  # a sweep has started it before its runs
    with report_progress("films", len(jobs), "films") as advance:
        drawn: dict[Digests, Preview | None] = {}
        workers = Processes(THREADS)
        for digests, preview in zip(jobs, ordered_map(draw, jobs, workers), strict=True):
            drawn[digests] = preview
            advance()
    previews = {name: drawn.get(digests) for name, digests in digests_by_name.items()}
    return {name: preview for name, preview in previews.items() if preview is not None}


def _list_digests(commit: str, mode: str) -> Digests:
    """Return path and digest of each result that drawing a mode's animation needs.

    commit: of the experiment that has the dvc.lock. The result is () if a stage has not run.
    """
    try:
        lock = yaml.load(run_git("show", f"{commit}:dvc.lock"), yaml.CSafeLoader)
    except FinloopError:  # there is no dvc.lock: no stage has run
        return ()
    digests = {
        out["path"]: str(out["md5"])
        for stage in lock["stages"].values()
        for out in stage.get("outs", ())
        if "md5" in out
    }
    paths = [f"data/{name}" for name in (*FOLDERS, f"animate/{mode}", f"animate/{mode}.parquet")]
    if not digests.keys() >= {*paths}:
        return ()
    return tuple((path, digests[path]) for path in paths)


def _draw_from_cache(digests: Digests, cache: Path, mode: str) -> Preview | None:
    """Return the preview of an animation, drawn from DVC's cache; None if that is impossible.

    digests: of all that drawing needs. cache: folder of DVC's cache. mode: of the animation.
    """
    with TemporaryDirectory() as folder:
        try:
            for path, digest in digests:
                _link_from_cache(cache, digest, Path(folder) / path)
            return draw_preview(Path(folder), mode)
        except (FileNotFoundError, FinloopError):
            return None


def _link_from_cache(cache: Path, digest: str, target: Path) -> None:
    """Make `target` a link to a file in DVC's cache, or a folder of such links.

    cache: its folder. digest: of the file's content, or of a folder's list of files (….dir).
    FileNotFoundError if the cache lacks one.
    """
    cached = (cache / digest[:2] / digest[2:]).resolve(strict=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    if not digest.endswith(".dir"):
        target.symlink_to(cached)
        return
    for file in json.loads(cached.read_text(encoding="utf-8")):
        _link_from_cache(cache, file["md5"], target / file["relpath"])


def draw_preview(root: Path, mode: str) -> Preview:
    """Return a preview of a mode's animation: its route, and a film of its first SECONDS.

    root: folder with data/ of a run; preview.mp4 stays in it.
    """
    with Project(root) as project:
        drawn = project.edit_with_sources(mode, "render")
        painter, rate = Painter(project.background), project.facts.frame_rate
        shown = drawn.edit[drawn.edit["tick"] < max(1, round(SECONDS * rate))]
        margin_px = MARGIN * project.drawn_scale(mode) * drawn.scene.typical_length_px
        part = _crop_to_route(shown, margin_px, painter.frame.shape)
        height, width = painter.frame[part].shape[:2]
        film_width = 2 * (min(WIDTH_PX, width) // 2)  # MP4 needs even sides
        size = film_width, 2 * max(1, round(height * film_width / width / 2))
        path = root / "preview.mp4"
        shape = size[1], size[0], *painter.frame.shape[2:]
        with Mp4Writer(path, shape, rate, CRF) as writer:
            for fish in fish_by_tick(shown, project.gallery(drawn)):
                painter.show(*fish)
                writer.write(cv2.resize(painter.frame[part], size, interpolation=cv2.INTER_AREA))
        figure = draw_trajectory(drawn.edit, project.goals(mode), project.background)
        return Preview(_encode_small(figure), path.read_bytes())


def _encode_small(figure: Figure) -> bytes:
    """Return a figure as the bytes of a small WebP, without key and axes."""
    figure.legends.clear()  # too wide; the full picture is in the experiment's report
    for axes in figure.axes:
        axes.set_axis_off()
    figure.set_size_inches(*(SHRINK * figure.get_size_inches()))
    picture = BytesIO()
    figure.savefig(picture, format="webp", dpi=DPI)
    return picture.getvalue()


def _crop_to_route(
    edit: pd.DataFrame, margin_px: float, shape: tuple[int, ...]
) -> tuple[slice, slice]:
    """Return the rows and columns (slices) of a picture that show a route with a margin.

    edit: the edit list. shape: (h, w, …) of the picture; the part has the same proportions.
    """
    place = edit[["y_px", "x_px"]].to_numpy(float)
    low, high = place.min(axis=0) - margin_px, place.max(axis=0) + margin_px
    full = np.array(shape[:2])
    share = min(1.0, float(((high - low) / full).max()))  # of both sides
    height, width = np.ceil(full * share).astype(int)
    middle_top_left = np.round((low + high - (height, width)) / 2).astype(int)
    top, left = np.clip(middle_top_left, 0, full - (height, width))
    return slice(top, top + height), slice(left, left + width)
