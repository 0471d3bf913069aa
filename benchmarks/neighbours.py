"""The 20 nearest neighbours of all rows of a film, against other libraries, at equal recall.

`python -m benchmarks.neighbours DATA …`, each a data/ folder in which `pose` has run (the film's
own; `python -m benchmarks.scale 100000 --stages features pose --keep DIR` makes a larger one).
hnswlib and pynndescent are no requirements of finloop: `pip install hnswlib pynndescent` first.

Every library has some settings, fastest first. The first with enough recall counts, building and
searching together. Recall is measured on 1,000 rows, against the exact answer.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import argparse
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import faiss
import hnswlib
import numpy as np
import pandas as pd
from pynndescent import NNDescent

from benchmarks.pipeline import ROOT, write_table
from finloop.base.arrays import Ints
from finloop.base.nearest import Nearest, Vectors
from finloop.base.parallel import Threads
from finloop.base.settings import settings
from finloop.base.stretches import spread_rows
from finloop.jumps.signature import InMemorySource, compute_signature_parts, compute_signatures
from finloop.project import Project
from stages.run import THREADS

NEAREST, TRIED, RECALL = 20, 1000, 0.99

Search = Callable[[Vectors], Ints]


def film_vectors(data_folder: Path) -> Vectors:
    """Return the vectors (n, d) by which the stage `jumps` compares rows."""
    p = settings("jumps")
    with Project(data_folder.parent) as project:
        source = InMemorySource.from_reel(project.film_reel, project.poses, p.look_px)
        made = compute_signature_parts(source, p, Threads(THREADS))
        return compute_signatures(made, project.film_reel.step_ends, p)[0].astype(np.float32)


def finloop_searches() -> Iterator[tuple[str, Search]]:
    """Yield finloop's search, which takes its settings from the vectors."""
    yield "cells or all", lambda v: Nearest.from_vectors(v).search(v, NEAREST + 1)


def exhaustive_searches() -> Iterator[tuple[str, Search]]:
    """Yield the search of faiss that compares all vectors."""

    def search(vectors: Vectors) -> Ints:
        index = faiss.IndexFlatL2(vectors.shape[1])
        index.add(vectors)
        return index.search(vectors, NEAREST + 1)[1]

    yield "IndexFlatL2", search


def hnsw_searches() -> Iterator[tuple[str, Search]]:
    """Yield the searches of hnswlib, a navigable graph."""

    def search(vectors: Vectors, links: int, built: int, wide: int) -> Ints:
        index = hnswlib.Index("l2", vectors.shape[1])
        index.init_index(len(vectors), M=links, ef_construction=built, random_seed=0)
        index.set_num_threads(THREADS)
        index.add_items(vectors)
        index.set_ef(wide)
        return index.knn_query(vectors, NEAREST + 1)[0].astype(np.int64)

    for links, built, wide in ((8, 40, 22), (12, 60, 25), (16, 100, 30), (16, 200, 60)):
        yield f"M {links}, ef {built}, {wide}", partial(search, links=links, built=built, wide=wide)


def descent_searches() -> Iterator[tuple[str, Search]]:
    """Yield the searches of pynndescent, by neighbours of neighbours."""

    def search(vectors: Vectors, count: int) -> Ints:
        made = NNDescent(vectors, n_neighbors=count, random_state=0, n_jobs=THREADS)
        return made.neighbor_graph[0].astype(np.int64)

    for count in (NEAREST + 1, 30, 45):
        yield f"{count} neighbours", partial(search, count=count)


LIBRARIES = {
    "finloop": finloop_searches,
    "faiss, flat": exhaustive_searches,
    "hnswlib": hnsw_searches,
    "pynndescent": descent_searches,
}


def measure_recall(found_rows: Ints, rows: Ints, true_rows: list[Ints]) -> float:
    """Return the share of the true neighbours of rows (k,) that are among the found (n, m)."""
    found = drop_own_row(found_rows[rows], rows)
    shares = [np.isin(true, near).mean() for true, near in zip(true_rows, found, strict=True)]
    return float(np.mean(shares))


def drop_own_row(nearest_rows: Ints, rows: Ints) -> list[Ints]:
    """Return the nearest (20,) of each row, from (k, 21 or more), without the row itself."""
    return [near[near != row][:NEAREST] for near, row in zip(nearest_rows, rows, strict=True)]


def measure_libraries(vectors: Vectors) -> pd.DataFrame:
    """Return one row per library: its setting, recall, seconds and processor seconds."""
    rows = spread_rows(np.arange(len(vectors)), TRIED)
    true = drop_own_row(faiss.knn(vectors[rows], vectors, NEAREST + 1)[1], rows)
    table = []
    for library, ways in LIBRARIES.items():
        for setting, search in ways():
            search(vectors[:500])  # compiles
            clock, work = time.perf_counter(), time.process_time()
            found = search(vectors)
            took, worked = time.perf_counter() - clock, time.process_time() - work
            share = measure_recall(found, rows, true)
            print(f"{len(vectors)} {library}, {setting}: {share:.4f} in {worked:.1f} s", flush=True)
            if share >= RECALL:
                break
        table.append({
            "pictures": len(vectors), "numbers": vectors.shape[1], "library": library,
            "setting": setting, "recall": share, "seconds": took, "processor_s": worked,
        })  # fmt: skip
    return pd.DataFrame(table).assign(
        to_fastest=lambda t: t["processor_s"] / t.loc[t["recall"] >= RECALL, "processor_s"].min()
    )


def main() -> None:
    """Time all libraries; print and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", nargs="*", type=Path, default=[ROOT / "data"])
    folders = parser.parse_args().data
    tables = [measure_libraries(film_vectors(folder.resolve())) for folder in folders]
    table = pd.concat(tables, ignore_index=True)
    write_table(__file__, table.round(3))


if __name__ == "__main__":
    main()
