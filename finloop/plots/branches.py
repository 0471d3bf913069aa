"""Figs. 3 and 4 of the fish paper: side branches of a thinned fish, their numbers, what is kept.

Plain background subtraction counts every pixel above the noise as fish. Thinned, open fins become
side branches. finloop thins the silhouette instead, without pale pixels, and weights the steps of a
path by the width of the fish. The picture shows both.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import cv2
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure, SubFigure
from matplotlib.patheffects import withStroke

from finloop.base.arrays import Floats, Ints
from finloop.plots.parts import message
from finloop.plots.thinned_fish import SkeletonBranch, ThinnedFish

_KEPT, _PAPER, _BACKBONE = "#0072B2", "#D55E00", "#009E73"  # Okabe-Ito
_HALO = [withStroke(linewidth=2.5, foreground="white")]


def choose_fish(fish: Iterable[ThinnedFish]) -> tuple[list[ThinnedFish], str]:
    """Return the one or two fish to draw, and a sentence on how many fish have side branches.

    The first has the most side branches; of equals, the longest ones. The second is the one of the
    others for which the two rules differ most, if they differ for any.
    """
    count = branched = differing = alone = 0
    most: list[ThinnedFish] = []
    different: list[ThinnedFish] = []
    for one in fish:
        count += 1
        branched += bool(one.side_branches)
        differing += one.difference_px > 0
        alone += one.body_ends > 2
        most = sorted([*most, one], key=_branch_order)[:1]
        different = sorted([*different, one], key=lambda fish: -fish.difference_px)[:2]
    second = [one for one in different if one.difference_px and one is not most[0]]
    words = (
        f"{count} fish, thinned with every pixel above the noise: {branched} have a side branch "
        f"that leaves the fish, the two rules differ for {differing}.\n"
        f"Their silhouettes alone, which finloop thins: {alone} have a side branch."
    )
    return [*most, *second[:1]], words


def _branch_order(fish: ThinnedFish) -> tuple[int, int]:
    branches = fish.side_branches
    return -len(branches), -sum(len(branch.path) for branch in branches)


def figure3_4(fish: Sequence[ThinnedFish], words: str) -> Figure:
    """Draw Figs. 3 and 4 of the fish paper: each fish, thinned, numbered and pruned.

    words: the sentence above the pictures, from `choose_fish`.
    """
    if not fish:
        return message("Figs. 3, 4: no isolated fish in the examined frames.")
    fish = [lie_down(one) for one in fish]
    heights = [2 * 6 * one.film.shape[0] / one.film.shape[1] + 1.1 for one in fish]
    figure = Figure(figsize=(12.5, sum(heights) + 0.5), layout="constrained")
    figure.suptitle(words, fontsize=10)
    parts = np.atleast_1d(np.asarray(figure.subfigures(len(fish), 1, height_ratios=heights)))
    for part, one in zip(parts, fish, strict=True):
        kept = _draw(part, one)
    parts[-1].legend(
        handles=kept.get_legend_handles_labels()[0], loc="outside lower center", ncols=3,
        frameon=False, fontsize=9,
    )  # fmt: skip
    return figure


def lie_down(fish: ThinnedFish) -> ThinnedFish:
    """Return a fish, with all its pictures and points, turned by 90° if it is higher than wide."""
    height, width = fish.whole.shape
    if height <= width:
        return fish

    def turn(xy: Any) -> Any:  # (m, 2), integer or float
        return np.column_stack([xy[:, 1], width - 1 - xy[:, 0]])

    return fish._replace(
        label=f"{fish.label}, turned by 90°",
        film=np.rot90(fish.film),
        body=np.rot90(fish.body),
        whole=np.rot90(fish.whole),
        skeleton=np.rot90(fish.skeleton),
        half_width=np.rot90(fish.half_width),
        branches=[SkeletonBranch(turn(path), numbers) for path, numbers in fish.branches],
        kept=turn(fish.kept),
        backbone=None if fish.backbone is None else turn(fish.backbone),
    )


def _draw(part: SubFigure, fish: ThinnedFish) -> Axes:
    panels = part.subplots(2, 2).ravel()
    titles = (
        f"3 (a) {fish.label}: every pixel above the noise, and the silhouette (dashed)",
        f"3 (b) thinned; {len(fish.branches) - 1} side branches",
        "4: pixels numbered from A on; numbers at the joints and the ends",
        "kept: the greatest number; the greatest sum of lengths × widths",
    )
    for axes, title in zip(panels, titles, strict=True):
        axes.set_title(title, fontsize=9)
        axes.axis("off")
        axes.set(xlim=(-0.5, fish.whole.shape[1] - 0.5), ylim=(fish.whole.shape[0] - 0.5, -0.5))
    film, thinned, numbered, kept = panels
    for axes in (film, kept):
        axes.imshow(fish.film, cmap="gray", vmin=0, vmax=255, interpolation="bicubic")
    film.contour(fish.whole, [0.5], colors="white", linewidths=1)
    film.contour(fish.body, [0.5], colors=_BACKBONE, linewidths=1.2, linestyles="dashed")
    for axes in (thinned, numbered):
        axes.imshow(np.where(fish.whole, 0.86, 1.0), cmap="gray", vmin=0, vmax=1)
    side = np.argwhere(fish.skeleton)[:, ::-1]
    _pixels(thinned, side, "black")
    _number(numbered, fish)
    _pixels(kept, side, "white", 0.6)
    kept.plot(*fish.branches[0].path.T, color=_PAPER, lw=5, alpha=0.7, label="the paper's rule")
    kept.plot(*fish.kept.T, color=_KEPT, lw=2.2, label="steps weighted by width, as in finloop")
    if fish.backbone is not None:
        kept.plot(
            *fish.backbone.T, color=_BACKBONE, lw=1.8, ls="--",
            label="the backbone in use: of the silhouette alone, centred, up to the outline",
        )  # fmt: skip
    return kept


def _pixels(axes: Axes, xy: Ints, colour: str | Floats, alpha: float = 1.0) -> None:
    picture = np.zeros((*(int(max(lim)) + 1 for lim in (axes.get_ylim(), axes.get_xlim())), 4))
    picture[xy[:, 1], xy[:, 0]] = np.array(to_rgba(colour) if isinstance(colour, str) else colour)
    picture[..., 3] *= alpha
    axes.imshow(picture, interpolation="nearest")


def _number(axes: Axes, fish: ThinnedFish) -> None:
    last = fish.branches[0].numbers[-1]
    for path, numbers in fish.branches:
        _pixels(axes, path, colormaps["viridis"](numbers / max(last, 1)))
    blocked = cv2.dilate(fish.skeleton.astype(np.uint8), np.ones((3, 3))).astype(float)
    ends = [(fish.branches[0].path[0], f"A {fish.branches[0].numbers[0]}", True)]
    ends += [
        (branch.path[-1], f"{name}{branch.numbers[-1]}", True)
        for name, branch in zip(["D ", *[""] * len(fish.branches)], fish.branches, strict=False)
    ]
    ends += [(one.path[0], f"{one.numbers[0]}", False) for one in fish.side_branches]
    for (x, y), text, bold in ends:
        right, down = _free_place(blocked, x, y, 1.4 * len(text) + 1)
        axes.annotate(
            text, (x, y), (right, down), ha="center", va="center", fontsize=9, zorder=4,
            fontweight="bold" if bold else "normal", color="black" if bold else "0.35",
            path_effects=_HALO, arrowprops={"arrowstyle": "-", "lw": 0.5, "color": "0.5"},
        )  # fmt: skip


def _free_place(blocked: Floats, x: int, y: int, wide: float) -> tuple[float, float]:
    """Return the centre of a pixel's label where it hides least, and block what it covers."""
    best, place, box = np.inf, (float(x), float(y)), np.s_[0:0, 0:0]
    height, width = blocked.shape
    for far in (3.0, 4.0, 5.0, 6.5, 8.0):
        for angle in np.arange(0, 2 * np.pi, np.pi / 8):
            right, down = x + far * np.cos(angle) * 1.3, y + far * np.sin(angle)
            left, top = right - wide / 2, down - 1.4
            if left < 0 or top < 0 or left + wide > width or top + 2.8 > height:
                continue
            window = np.s_[int(top) : int(top + 2.8) + 1, int(left) : int(left + wide) + 1]
            cost = blocked[window].sum() + 0.3 * far
            if cost < best:
                best, place, box = cost, (right, down), window
    blocked[box] += 3
    return place
