"""Figs. 3 and 4 of the fish paper: side branches of a thinned fish, their numbers, what is kept.

Plain background subtraction counts every pixel above the noise as fish. Thinned, open fins become
side branches. finloop thins the silhouette instead, without pale pixels, and weights the steps of a
path by the width of the fish. The picture shows both.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
import skimage
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure, SubFigure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy import ndimage

from finloop.base.arrays import Floats, Ints, Mask, Picture
from finloop.extract.backbone import close_notches, find_longest_path, trace_backbone
from finloop.extract.background import Scene
from finloop.extract.samples import TypicalFish
from finloop.extract.segment import Silhouette
from finloop.extract.settings import ExtractSettings
from finloop.plots.extract import judge_silhouettes
from finloop.plots.parts import crop_with_edge_repeated, draw_message

_KEPT, _PAPER, _BACKBONE = "#0072B2", "#D55E00", "#009E73"  # Okabe-Ito
_HALO = [withStroke(linewidth=2.5, foreground="white")]
_MARGIN = 6  # px of tank around a fish


class SkeletonBranch(NamedTuple):
    """A branch of a skeleton: its m pixels, and their numbers from the start of the skeleton.

    path (m, 2): x, y px, from the joint with an earlier branch to the end. numbers (m,): rise by 1.
    """

    path: Ints
    numbers: Ints


class ThinnedFish(NamedTuple):
    """One fish, thinned to a skeleton together with every pixel above the noise around it.

    Places are px of `film`, (h, w) or (h, w, 3), the part of the frame with the fish. label: film
    and frame. body (h, w): the silhouette. whole (h, w): every pixel above the noise. skeleton (h,
    w): `whole` thinned. half_width (h, w): px to the edge of `whole`. branches: of the skeleton, by
    the paper's rule, its backbone first. kept (m, 2): x, y of the skeleton's path with the greatest
    sum of length × width. backbone (n, 2): x, y, as finloop traces it in the silhouette; None if
    the silhouette has none. body_ends: ends of the thinned silhouette, 2 without side branches.
    """

    label: str
    film: Picture
    body: Mask
    whole: Mask
    skeleton: Mask
    half_width: NDArray[np.float32]
    branches: list[SkeletonBranch]
    kept: Ints
    backbone: Floats | None
    body_ends: int

    @property
    def side_branches(self) -> list[SkeletonBranch]:
        """Return the side branches that are longer than half the fish's width at their joint."""
        joints = [branch.path[0] for branch in self.branches[1:]]
        return [
            branch
            for branch, (x, y) in zip(self.branches[1:], joints, strict=True)
            if len(branch.path) - 1 > self.half_width[y, x]
        ]

    @property
    def difference_px(self) -> int:
        """Return how many pixels of the paper's and finloop's path lie over 1 px off the other one.

        The paper's path is the first branch, finloop's is `kept`.
        """
        # (m, k): how far each pixel of one path is from each of the other, along x or y.
        distances = np.abs(self.branches[0].path[:, None] - self.kept).max(-1)
        return int((distances.min(0) > 1).sum() + (distances.min(1) > 1).sum())


def number_pixels(skeleton: Mask, start: tuple[int, int]) -> Ints:
    """Return for each pixel (h, w) of a skeleton its number of steps from a start, as in Fig. 4.

    The start (x, y) has 0, any other pixel one more than its lowest neighbour. So at a joint all
    branches continue with the same number. Pixels that no path joins to the start have −1.
    """
    # A path costs 1 for each of its pixels; −1 means that no path leads through a pixel.
    paths = skimage.graph.MCP(np.where(skeleton, 1.0, -1.0))
    costs, _ = paths.find_costs([start[::-1]])
    return np.where(np.isfinite(costs), costs - 1, -1).astype(np.int64)


def _find_ends(skeleton: Mask) -> list[tuple[int, int]]:
    """Return the ends (x, y) of a skeleton (h, w): pixels with at most one neighbour."""
    pixels = skeleton.astype(np.uint8)
    around = cv2.filter2D(pixels, -1, np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT)
    neighbours = around - pixels
    return [(int(x), int(y)) for y, x in np.argwhere(skeleton & (neighbours <= 1))]


def find_branches(skeleton: Mask) -> list[SkeletonBranch]:
    """Return the branches of a skeleton (h, w) by the paper's rule (§2.2.1), greatest number first.

    The numbering starts at the pixel that is farthest along the skeleton from its first pixel. The
    first branch, to the greatest number, is the paper's backbone. Every other end has a branch,
    which starts at its joint with an earlier branch.
    """
    first_y, first_x = np.argwhere(skeleton)[0].tolist()
    distance = number_pixels(skeleton, (first_x, first_y))
    start_y, start_x = np.unravel_index(distance.argmax(), distance.shape)
    start = int(start_x), int(start_y)
    number = number_pixels(skeleton, start)
    # From each end, the one with the greatest number first, back to a pixel of an earlier branch.
    ends = [end for end in _find_ends(skeleton & (number >= 0)) if end != start]
    ends.sort(key=lambda end: -number[end[1], end[0]])
    taken = np.zeros(skeleton.shape, bool)
    taken[start[1], start[0]] = True
    branches = []
    for x, y in ends or [start]:  # a ring or a single pixel has no other end
        path = [(x, y)]
        while not taken[y, x]:
            taken[y, x] = True
            x, y = _previous_pixel(number, x, y)
            path.append((x, y))
        xy = np.array(path[::-1])
        branches.append(SkeletonBranch(xy, number[xy[:, 1], xy[:, 0]]))
    return branches


def _previous_pixel(number: Ints, x: int, y: int) -> tuple[int, int]:
    """Return the neighbour (x, y) of a skeleton pixel whose number is one lower.

    A neighbour at a side is preferred to one at a corner. number (h, w): from `number_pixels`.
    """
    steps = ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))
    height, width = number.shape
    for right, down in steps:
        new_x, new_y = x + right, y + down
        if 0 <= new_x < width and 0 <= new_y < height and number[new_y, new_x] == number[y, x] - 1:
            return new_x, new_y
    raise ValueError("the numbers of a skeleton fall by 1 towards its start")


def thin_fish(
    frame: Picture, label: str, scene: Scene, typical: TypicalFish, arena: Picture,
    settings: ExtractSettings,
) -> Iterator[ThinnedFish]:  # fmt: skip
    """Yield every isolated fish of a frame (h, w) or (h, w, 3), thinned to a skeleton.

    Its pale pixels, such as fins, are thinned with it. label: film and frame, for the figure.
    scene, typical, arena: as in `judge_silhouettes`.
    """
    for silhouette, verdict in judge_silhouettes(frame, scene, typical, arena, settings, "all"):
        if verdict == "fish":
            yield _thin_silhouette(
                silhouette, frame, label, settings.points, scene.threshold, typical.limbs
            )


def _thin_silhouette(
    silhouette: Silhouette, frame: Picture, label: str, points: int, floor: float, limbs: bool
) -> ThinnedFish:
    """Thin a silhouette together with the pale pixels around it, such as fins.

    label: film and frame. points: number of the backbone's points. floor: a smaller difference from
    the empty tank is noise, grey levels. limbs: whether the animal has limbs, which are cut off
    before its backbone is traced.
    """
    body, whole, left, top = _masks_with_pale_pixels(silhouette)
    skeleton = skimage.morphology.skeletonize(whole)
    half_width = cv2.distanceTransform(whole.astype(np.uint8), cv2.DIST_L2, 3)
    # What finloop makes of the silhouette alone, without pale pixels.
    backbone = trace_backbone(silhouette.mask, silhouette.field, points, floor, limbs)
    alone, _ = close_notches(silhouette.mask, silhouette.field)
    corner = np.array([silhouette.x0 - left, silhouette.y0 - top])
    film = crop_with_edge_repeated(frame, left, top, whole.shape[1], whole.shape[0])
    return ThinnedFish(
        label=label, film=film, body=body, whole=whole, skeleton=skeleton,
        half_width=half_width, branches=find_branches(skeleton),
        kept=find_longest_path(skeleton, half_width).astype(np.int64),
        backbone=None if backbone is None else backbone.points_px + corner,
        body_ends=len(_find_ends(skimage.morphology.skeletonize(alone))),
    )  # fmt: skip


def _masks_with_pale_pixels(silhouette: Silhouette) -> tuple[Mask, Mask, int, int]:
    """Return a silhouette's masks (h, w) without and with pale pixels, and their place x, y px.

    The second mask is one piece without holes. The place is that of the masks' upper left in the
    frame.
    """
    # Both masks in the box of the pale pixels, with a margin.
    pale = silhouette.pale or silhouette
    left, top = pale.x0 - _MARGIN, pale.y0 - _MARGIN
    size = pale.mask.shape[0] + 2 * _MARGIN, pale.mask.shape[1] + 2 * _MARGIN
    body = _paste_mask(silhouette.mask, silhouette.x0 - left, silhouette.y0 - top, size)
    whole = body | _paste_mask(pale.mask, _MARGIN, _MARGIN, size)
    pieces, _ = ndimage.label(whole, np.ones((3, 3)))
    whole = ndimage.binary_fill_holes(pieces == pieces[body].max())
    # The box around what is left, with a margin.
    rows, columns = (
        slice(max(side.start - _MARGIN, 0), side.stop + _MARGIN)
        for side in ndimage.find_objects(whole.astype(int))[0]
    )
    return body[rows, columns], whole[rows, columns], left + columns.start, top + rows.start


def _paste_mask(mask: Mask, x: int, y: int, size: tuple[int, int]) -> Mask:
    """Return a mask of a size (h, w) with a smaller mask in it, whose upper left is at x, y."""
    pasted = np.zeros(size, bool)
    pasted[y : y + mask.shape[0], x : x + mask.shape[1]] = mask
    return pasted


def choose_fish_to_draw(fish: Iterable[ThinnedFish]) -> tuple[list[ThinnedFish], str]:
    """Return at most two fish to draw, and a sentence on how many fish have side branches.

    The first has the most side branches; of equals, the longest ones. The second is the one among
    the others whose two paths, by the paper's rule and by finloop's, differ most, if any differ.
    """
    count = branched = differing = alone = 0
    most_branched: list[ThinnedFish] = []
    most_different: list[ThinnedFish] = []

    def branch_order(thinned: ThinnedFish) -> tuple[int, int]:
        """Return a sort key: fish with more side branches first; of equals, with longer ones."""
        branches = thinned.side_branches
        return -len(branches), -sum(len(branch.path) for branch in branches)

    for thinned in fish:  # fish may be many: only those that may be drawn are kept
        count += 1
        branched += bool(thinned.side_branches)
        differing += thinned.difference_px > 0
        alone += thinned.body_ends > 2  # its silhouette alone has a side branch
        most_branched = sorted([*most_branched, thinned], key=branch_order)[:1]
        # Two, as one of them may be the most branched one.
        candidates = [*most_different, thinned]
        most_different = sorted(candidates, key=lambda thinned: -thinned.difference_px)[:2]
    others = [thinned for thinned in most_different if thinned is not most_branched[0]]
    second = [thinned for thinned in others if thinned.difference_px]
    words = (
        f"{count} fish, thinned with every pixel above the noise: {branched} have a side branch "
        f"that leaves the fish, the two rules differ for {differing}.\n"
        f"Their silhouettes alone, which finloop thins: {alone} have a side branch."
    )
    return [*most_branched, *second[:1]], words


def figure3_4(fish: Sequence[ThinnedFish], headline: str) -> Figure:
    """Draw Figs. 3 and 4 of the fish paper: each fish, thinned, numbered and pruned.

    headline: the sentence above the pictures, from `choose_fish_to_draw`.
    """
    if not fish:
        return draw_message("Figs. 3, 4: no isolated fish in the examined frames.")
    fish = [turn_horizontal(thinned) for thinned in fish]
    # Two rows of panels, each 6 inches wide, and their titles.
    heights = [2 * 6 * thinned.film.shape[0] / thinned.film.shape[1] + 1.1 for thinned in fish]
    figure = Figure(figsize=(12.5, sum(heights) + 0.5), layout="constrained")
    figure.suptitle(headline, fontsize=10)
    parts = np.atleast_1d(np.asarray(figure.subfigures(len(fish), 1, height_ratios=heights)))
    for part, thinned in zip(parts, fish, strict=True):
        last_panel = _draw_fish(part, thinned)
    parts[-1].legend(
        handles=last_panel.get_legend_handles_labels()[0], loc="outside lower center", ncols=3,
        frameon=False, fontsize=9,
    )  # fmt: skip
    return figure


def turn_horizontal(fish: ThinnedFish) -> ThinnedFish:
    """Return a fish, with all its pictures and points, turned by 90° if it is higher than wide."""
    height, width = fish.whole.shape
    if height <= width:
        return fish

    def turn_points(xy: Any) -> Any:
        """Return points (m, 2), x and y in px, turned by 90° as `np.rot90` turns the pictures."""
        return np.column_stack([xy[:, 1], width - 1 - xy[:, 0]])

    pictures = ("film", "body", "whole", "skeleton", "half_width")
    return fish._replace(
        label=f"{fish.label}, turned by 90°",
        **{name: np.rot90(getattr(fish, name)) for name in pictures},
        branches=[SkeletonBranch(turn_points(path), numbers) for path, numbers in fish.branches],
        kept=turn_points(fish.kept),
        backbone=None if fish.backbone is None else turn_points(fish.backbone),
    )


def _draw_fish(subfigure: SubFigure, fish: ThinnedFish) -> Axes:
    """Draw a fish's silhouette, skeleton, branches and backbone; return the last panel's axes."""
    panels = subfigure.subplots(2, 2).ravel()
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
    # What lies below: the film, or the fish in grey.
    for axes in (film, kept):
        axes.imshow(fish.film, cmap="gray", vmin=0, vmax=255, interpolation="bicubic")
    for axes in (thinned, numbered):
        axes.imshow(np.where(fish.whole, 0.86, 1.0), cmap="gray", vmin=0, vmax=1)
    # Outlines, skeleton, numbers, and the paths that are kept.
    film.contour(fish.whole, [0.5], colors="white", linewidths=1)
    film.contour(fish.body, [0.5], colors=_BACKBONE, linewidths=1.2, linestyles="dashed")
    skeleton_xy = np.argwhere(fish.skeleton)[:, ::-1]
    _draw_pixels(thinned, skeleton_xy, "black")
    _draw_numbers(numbered, fish)
    _draw_pixels(kept, skeleton_xy, "white", alpha=0.6)
    kept.plot(*fish.branches[0].path.T, color=_PAPER, lw=5, alpha=0.7, label="the paper's rule")
    kept.plot(*fish.kept.T, color=_KEPT, lw=2.2, label="steps weighted by width, as in finloop")
    if fish.backbone is not None:
        kept.plot(
            *fish.backbone.T, color=_BACKBONE, lw=1.8, ls="--",
            label="the backbone in use: of the silhouette alone, centred, up to the outline",
        )  # fmt: skip
    return kept


def _draw_pixels(axes: Axes, xy: Ints, colour: str | Floats, alpha: float = 1.0) -> None:
    """Colour pixels xy (n, 2) of the axes: all in one colour, or each in its own, (n, 4) RGBA."""
    height, width = int(max(axes.get_ylim())) + 1, int(max(axes.get_xlim())) + 1
    picture = np.zeros((height, width, 4))
    picture[xy[:, 1], xy[:, 0]] = np.array(to_rgba(colour) if isinstance(colour, str) else colour)
    picture[..., 3] *= alpha
    axes.imshow(picture, interpolation="nearest")


def _draw_numbers(axes: Axes, fish: ThinnedFish) -> None:
    """Colour the branches' pixels by number, and write the numbers of ends and joints (Fig. 4)."""
    last = fish.branches[0].numbers[-1]
    for path, numbers in fish.branches:
        _draw_pixels(axes, path, colormaps["viridis"](numbers / max(last, 1)))
    # Labels should not hide the skeleton, nor each other: `_place_label` adds each to this.
    blocked = cv2.dilate(fish.skeleton.astype(np.uint8), np.ones((3, 3))).astype(float)
    # Labels: a pixel, its text, and whether it is an end. The paper's backbone leads from A to D.
    backbone = fish.branches[0]
    labels = [(backbone.path[0], f"A {backbone.numbers[0]}", True)]
    labels += [(backbone.path[-1], f"D {backbone.numbers[-1]}", True)]
    labels += [(branch.path[-1], f"{branch.numbers[-1]}", True) for branch in fish.branches[1:]]
    labels += [(branch.path[0], f"{branch.numbers[0]}", False) for branch in fish.side_branches]
    for (x, y), text, bold in labels:
        right, down = _place_label(blocked, x, y, 1.4 * len(text) + 1)
        axes.annotate(
            text, (x, y), (right, down), ha="center", va="center", fontsize=9, zorder=4,
            fontweight="bold" if bold else "normal", color="black" if bold else "0.35",
            path_effects=_HALO, arrowprops={"arrowstyle": "-", "lw": 0.5, "color": "0.5"},
        )  # fmt: skip


def _place_label(blocked: Floats, x: int, y: int, label_width: float) -> tuple[float, float]:
    """Return where to write the label of a pixel so that it hides least: its centre (x, y) [px].

    blocked (h, w): how much each pixel should stay visible; it is raised where the label lies.
    label_width: in px. The place is the pixel itself if there is no room around it.
    """
    least_cost, place, label_box = np.inf, (float(x), float(y)), np.s_[0:0, 0:0]
    height, width = blocked.shape
    for distance in (3.0, 4.0, 5.0, 6.5, 8.0):
        for angle in np.arange(0, 2 * np.pi, np.pi / 8):
            # Labels are wider than high, so they stand farther off sideways; they are 2.8 px high.
            centre = x + distance * np.cos(angle) * 1.3, y + distance * np.sin(angle)
            left, top = centre[0] - label_width / 2, centre[1] - 1.4
            right, bottom = left + label_width, top + 2.8
            if left < 0 or top < 0 or right > width or bottom > height:
                continue
            box = np.s_[int(top) : int(bottom) + 1, int(left) : int(right) + 1]
            cost = blocked[box].sum() + 0.3 * distance  # of equal places the nearer one
            if cost < least_cost:
                least_cost, place, label_box = cost, centre, box
    blocked[label_box] += 3  # later labels avoid this one more than the skeleton, which counts 1
    return place
