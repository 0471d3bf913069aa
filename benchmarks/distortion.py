"""Distortion of shapes in between: how far a morph is from moving its shape as a rigid body.

`python -m benchmarks.distortion` compares the linear, physical and fold-free morphs and flubber on
the pairs of glyphs of `benchmarks.morph`, prints the table and writes benchmarks/distortion.csv.
flubber comes from npm: `npm install --prefix FOLDER flubber@0.4.2`, and NODE_PATH is
FOLDER/node_modules. Without it, its row is left out. flubber knows no holes, so all methods are
judged by the outer contour. The fold-free morph moves the holes along.

Two energies of the shape at the share τ of the way, both means over the area, averaged over
τ = 1/6 … 5/6, (1 − τ) times seen from the first shape plus τ times seen from the second:

- deviation: ‖J − R ((1 − τ) I + τ S)‖², J the Jacobian of the map to the shape in between, S the
  stretch to the other shape, R the best rotation: how far the shape is from the one that is as
  rigid as possible (Alexa, Cohen-Or and Levin, "As-rigid-as-possible shape interpolation", 2000).
  It judges the motion, given which points correspond.
- strain: ‖J − R‖² (Sorkine and Alexa, "As-rigid-as-possible surface modeling", 2007). It judges
  which points correspond, too: most of it is the difference between the two shapes. It is least for
  shapes that shrink at once and grow late, so less is not always better.

A morph gives the map on the contour alone; inside, it is the map of least energy.
"""

import os  # isort: skip

os.environ["FINLOOP_THREADS"] = "1"
import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import json
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import scipy
from skimage.measure import points_in_poly as points_inside

from benchmarks.morph import FRAMES, PHYSICS, POINTS, random_regions
from benchmarks.pipeline import write_table
from finloop.base.arrays import Complex, Floats, Points
from finloop.curve.contour import signed_area
from finloop.morph.folds import ContourLayout, count_contour_folds, count_polygon_folds
from finloop.morph.layers import linear_morph, physical_morph
from finloop.morph.simple import morph_regions_without_folds

SHARES = np.arange(1, 6) / 6  # of the way, at which shapes are judged
OUTLINE = 192  # points of a contour in its mesh
ROUNDS, SETTLED = 60, 1e-3  # of finding the map of least energy; relative change that ends it


def main() -> None:
    """Morph all pairs by every method; print and write the table."""
    pairs = random_regions()
    outer = [[max(side, key=lambda c: abs(signed_area(c))) for side in pair] for pair in pairs]
    regions = [morph_regions_without_folds(a, b, FRAMES, POINTS) for a, b in pairs]
    morphs: dict[str, list[Points]] = {
        "linear": [linear_morph(a, b, FRAMES, POINTS) for a, b in outer],
        "physical": [physical_morph(a, b, FRAMES, POINTS, PHYSICS) for a, b in outer],
        "flubber": flubber_morphs([stacks[0][[0, -1]] for stacks in regions]),
        "fold-free": [stacks[0] for stacks in regions],
    }
    morphs = {name: stacks for name, stacks in morphs.items() if stacks}
    values = np.array([[morph_energies(stack) for stack in stacks] for stacks in morphs.values()])
    rows = [
        energy_row(measure, name, values[k, :, number], values[:, :, number].min(axis=0))
        | {"folds_percent": 100 * np.mean([count_polygon_folds(s).any() for s in morphs[name]])}
        for number, measure in enumerate(("deviation", "strain"))
        for k, name in enumerate(morphs)
    ]
    write_table(__file__, pd.DataFrame(rows).round(4))
    folded = sum(
        bool(count_contour_folds(np.concatenate(stacks, axis=1), layout(stacks)).any())
        for stacks in regions
    )
    print(f"regions of the fold-free morph with a fold or a crossing: {folded} of {len(regions)}")


def energy_row(measure: str, method: str, energy: Floats, lowest: Floats) -> dict[str, object]:
    """Return a row of the table: a method's energies (pairs,), and the lowest of all methods."""
    low, median, high = np.percentile(energy, [25, 50, 75])
    return {
        "measure": measure, "method": method, "pairs": len(energy), "quartile_1": low,
        "median": median, "quartile_3": high, "mean": energy.mean(),
        "lowest_percent": 100 * (energy <= lowest + 1e-9).mean(),
        "within_5_percent": 100 * (energy <= 1.05 * lowest + 1e-9).mean(),
    }  # fmt: skip


def layout(stacks: Sequence[Points]) -> ContourLayout:
    """Return how the contours of a region lie one after the other."""
    return ContourLayout(tuple(stack.shape[1] for stack in stacks))


def flubber_morphs(ends: Sequence[Points]) -> list[Points]:
    """Return flubber's morphs (FRAMES, n, 2) between two contours (2, n, 2) each; [] without it."""
    node = shutil.which("node")
    given = [
        [*pair.tolist(), float(np.hypot(*np.diff(pair[0], axis=0).T).sum()) / POINTS]
        for pair in ends
    ]
    script = Path(__file__).with_name("flubber.cjs")
    if node is None:
        print("no node: flubber is left out")
        return []
    done = subprocess.run([node, script], input=json.dumps(given), text=True, capture_output=True)
    if done.returncode:
        print(f"flubber is left out: {done.stderr.strip().splitlines()[-1:]}")
        return []
    tau = np.linspace(0, 1, FRAMES)[:, None, None]
    found = [np.asarray(pair) for pair in json.loads(done.stdout)]
    return [(1 - tau) * first + tau * second for first, second in found]


def morph_energies(stack: Points) -> tuple[float, float]:
    """Return deviation and strain of a morph (f, n, 2) of a contour, averaged over SHARES."""
    frames = stack[np.round(SHARES * (len(stack) - 1)).astype(int)]
    first = contour_energies(stack[0], np.concatenate([frames, stack[-1:]]), SHARES)
    second = contour_energies(stack[-1], np.concatenate([frames, stack[:1]]), 1 - SHARES)
    deviation, strain = ((1 - SHARES) * first + SHARES * second).mean(axis=1)
    return float(deviation), float(strain)


def contour_energies(rest: Points, frames: Points, tau: Floats) -> Floats:
    """Return least deviation and strain (2, k) of maps of a polygon's inside to shapes in between.

    rest (n, 2): the polygon. frames (k + 1, n, 2): the contours in between, and the other end. tau
    (k,): shares of the way. Vertex i goes to vertex i, and so do points between vertices.
    """
    edges = np.hypot(*(np.roll(rest, -1, axis=0) - rest).T)
    along = np.r_[0.0, np.cumsum(edges)]
    marks = np.arange(OUTLINE) / OUTLINE * along[-1]
    closed = np.concatenate([rest[None], frames])[:, [*range(len(rest)), 0]] @ [1, 1j]
    # points at equal distances on the polygon, and where the morph takes them
    shown = np.stack([np.interp(marks, along, contour) for contour in closed])
    inside = Inside(shown[0])
    strain, turning, mirroring = inside.solve(
        shown[1:].T, np.ones((1, 1)), np.zeros((1, 1), complex)
    )
    size = abs(turning[:, -1:])
    unturned = mirroring[:, -1:] * turning[:, -1:].conj() / np.maximum(size, 1e-300)
    deviation, _, _ = inside.solve(shown[1:-1].T, 1 - tau + tau * size, tau * unturned)
    return np.stack([deviation, strain[:-1]])


class Inside:
    """A mesh within a polygon, for maps of least energy whose edge is given."""

    def __init__(self, outline: Complex) -> None:
        """Build the mesh of a polygon (OUTLINE,)."""
        points, triangles = mesh_inside(outline)
        corners = points[triangles]  # (t, 3)
        across = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        u, w = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        self.areas: Floats = (u.conj() * w).imag / 2
        # The gradient on a triangle is Σ values × (edge across, turned) / 2 area.
        slopes = 1j * across / (2 * self.areas[:, None])
        rows = np.repeat(np.arange(len(triangles)), 3)
        self.gradients = scipy.sparse.csr_matrix(
            (slopes.ravel(), (rows, triangles.ravel())), shape=(len(triangles), len(points))
        )
        weights = scipy.sparse.diags(self.areas)
        stiffness = (self.gradients.conj().T @ weights @ self.gradients).real.tocsc()
        self.to_edge = stiffness[OUTLINE:, :OUTLINE]
        self.solve_inner = scipy.sparse.linalg.factorized(stiffness[OUTLINE:, OUTLINE:])

    def solve(
        self, edge: Complex, turning_goals: Floats, mirroring_goals: Complex
    ) -> tuple[Floats, Complex, Complex]:
        """Return the least energy (k,) of maps, and how they turn and mirror triangles, (t, k).

        edge (OUTLINE, k): where the polygon goes. goals: of (t, k) or all, up to a rotation.
        """
        pull = -(self.to_edge @ edge)
        inner = self.solve_inner(pull.real.copy()) + 1j * self.solve_inner(pull.imag.copy())
        before = np.full(edge.shape[1], np.inf)
        for _ in range(ROUNDS):
            places = np.concatenate([edge, inner])
            # J z = turning z + mirroring z̄
            turning, mirroring = self.gradients.conj() @ places / 2, self.gradients @ places / 2
            rotation = turning * turning_goals + mirroring * np.conj(mirroring_goals)
            rotation = rotation / np.maximum(abs(rotation), 1e-300)
            off = turning - rotation * turning_goals, mirroring - rotation * mirroring_goals
            energy = self.areas @ (2 * abs(off[0]) ** 2 + 2 * abs(off[1]) ** 2) / self.areas.sum()
            if (before - energy <= SETTLED * energy + 1e-9).all():
                break
            before = energy
            slope = self.gradients.T @ (self.areas[:, None] * off[0])
            slope = slope + self.gradients.conj().T @ (self.areas[:, None] * off[1])
            slope = slope[OUTLINE:]
            inner = inner - self.solve_inner(slope.real.copy())
            inner = inner - 1j * self.solve_inner(slope.imag.copy())
        return energy, turning, mirroring


def mesh_inside(outline: Complex) -> tuple[Complex, np.ndarray]:
    """Return points of a mesh of a polygon (n,), its own first, and triangles (t, 3)."""
    polygon = np.stack([outline.real, outline.imag], axis=1)
    edge = abs(np.diff(outline)).mean()
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    x, y = np.meshgrid(*(np.arange(a + edge / 2, b, edge) for a, b in zip(low, high, strict=True)))
    x[1::2] += edge / 2  # triangles of equal sides
    grid = np.stack([x.ravel(), y.ravel()], axis=1)
    grid = grid[points_inside(grid, polygon)]
    far = scipy.spatial.cKDTree(polygon).query(grid)[0] > 0.7 * edge
    points = np.concatenate([polygon, grid[far]])
    triangles = scipy.spatial.Delaunay(points).simplices
    triangles = triangles[points_inside(points[triangles].mean(axis=1), polygon)]
    z = points @ [1, 1j]
    corners = z[triangles]
    turned = (np.conj(corners[:, 1] - corners[:, 0]) * (corners[:, 2] - corners[:, 0])).imag
    triangles[turned < 0] = triangles[turned < 0][:, ::-1]
    return z, triangles[abs(turned) > 1e-9 * edge**2]


if __name__ == "__main__":
    main()
