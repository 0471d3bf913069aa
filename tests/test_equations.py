"""docs/equations.md against the code: what its rows name exists, is tested there, and is complete."""

import ast
import importlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENT = (ROOT / "docs/equations.md").read_text(encoding="utf-8")
HEADER = ["in the paper", "what it is", "function", "test"]


class Row(NamedTuple):
    """A row of a table of equations; what stands in backquotes in its last two cells."""

    paper: str
    what: str
    functions: list[str]
    tests: list[str]


def tables(text: str) -> list[list[Row]]:
    """The rows of every table of equations; a row that is torn is refused."""
    found: list[list[Row]] = []
    inside = False
    for number, line in enumerate(text.splitlines(), 1):
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if cells == HEADER:
            found.append([])
            inside = True
        elif not cells:
            inside = False
        elif inside and set(line) - set("|-: "):
            assert len(cells) == len(HEADER), f"docs/equations.md:{number}: {len(cells)} cells"
            quoted = [re.findall(r"`([^`]+)`", cell) for cell in cells[2:]]
            found[-1].append(Row(cells[0], cells[1], *quoted))
    return found


TABLES = tables(DOCUMENT)
ROWS = [row for table in TABLES for row in table]


def homes(names: list[str]) -> Iterator[tuple[str, str | None]]:
    """Each name with its module's; a name without dots is of the last module that was named."""
    module = None
    for name in names:
        if name.endswith((".py", ".yaml")):
            yield name, None  # a file
            continue
        if "." in name:
            module, name = split(name)
        assert module is not None, f"`{name}`: of which module?"
        yield name, module


def split(name: str) -> tuple[str, str]:
    """`bpn.MotionModel.predict` as its module and what is in it."""
    parts = name.split(".")
    for depth in range(len(parts) - 1, 0, -1):
        for package in ("finloop.", ""):
            module = package + ".".join(parts[:depth])
            if package and (ROOT / module.replace(".", "/")).with_suffix(".py").is_file():
                return module, ".".join(parts[depth:])
    return ".".join(parts[:-1]), parts[-1]


@cache
def defined(module: str) -> frozenset[str]:
    """What a module of ours defines: functions, classes, their methods, constants."""
    tree = ast.parse((ROOT / module.replace(".", "/")).with_suffix(".py").read_text())
    found = set()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            inner = (one.name for one in node.body if isinstance(one, ast.FunctionDef))
            found |= {f"{node.name}.{name}" for name in inner}
        for target in getattr(node, "targets", [getattr(node, "target", None)]):
            if isinstance(target, ast.Name):
                found.add(target.id)
    return frozenset(found)


def wrong(row: Row) -> Iterator[str]:
    """All that is wrong with a row."""
    tested = ""
    for test in row.tests:
        path = ROOT / "tests" / test
        if path.is_file():
            tested += path.read_text(encoding="utf-8")
        else:
            yield f"there is no tests/{test}"
    for name, module in homes(row.functions):
        if module is None:
            if not (ROOT / name).is_file():
                yield f"there is no {name}"
        elif not module.startswith("finloop."):
            if not hasattr(importlib.import_module(module), name):
                yield f"{module} has no {name}"
        elif name not in defined(module):
            yield f"{module} defines no {name}"
        elif row.tests and not named(name.rpartition(".")[2], tested):
            yield f"{name} is named in none of {', '.join(row.tests)}"


def named(name: str, text: str) -> bool:
    """Whether a test names a function: as itself, as a method ("runge-kutta"), as its picture."""
    names = {name, name.replace("_", "-"), re.sub(r"^figure(\d+)$", r"fig\1", name)}
    return any(re.search(rf"(?<!\w){re.escape(one)}(?!\w)", text) for one in names)


def told(paper: str, word: str) -> set[int]:
    """The numbers that a cell tells after a word: "Figs. 3–5, 7" → {3, 4, 5, 7}."""
    found = set()
    for run in re.findall(rf"\b{word}s?\.? ([\d–, ]+)", paper):
        for first, last in re.findall(r"(\d+)(?:–(\d+))?", run):
            found |= set(range(int(first), int(last or first) + 1))
    return found


def numbered(paper: str) -> set[tuple[int, int]]:
    """The equations that a cell tells: "(2.7)–(2.9)" → {(2, 7), (2, 8), (2, 9)}."""
    found = set()
    for part, first, last in re.findall(r"\((\d)\.(\d+)\)(?:–\(\d\.(\d+)\))?", paper):
        found |= {(int(part), n) for n in range(int(first), int(last or first) + 1)}
    return found


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.paper}: {row.what}")
def test_the_functions_and_tests_of_a_row_exist_and_belong_together(row):
    assert row.functions and not list(wrong(row))


def test_every_equation_figure_and_table_of_the_fish_paper_has_a_row():
    fish = [row.paper for row in TABLES[0]]
    assert set().union(*(told(cell, "Eq") for cell in fish)) == set(range(1, 9))
    assert set().union(*(told(cell, "Fig") for cell in fish)) == set(range(1, 20))
    assert set().union(*(told(cell, "Table") for cell in fish)) == {1, 2}


def test_every_equation_and_figure_of_the_curve_paper_has_a_row():
    curve = [row.paper for row in TABLES[1]]
    counts = {2: 12, 3: 16, 4: 1}
    wanted = {(part, n) for part, count in counts.items() for n in range(1, count + 1)}
    assert set().union(*map(numbered, curve)) == wanted
    assert set().union(*(told(cell, "Fig") for cell in curve)) >= set(range(1, 15))
    assert set().union(*(told(cell, "Table") for cell in curve)) == {1, 2}


def test_a_row_that_is_not_true_is_found():
    good = Row(
        "(1)",
        "",
        ["bpn.model.MotionModel.predict", "bpn.back_propagation.unit_output", "train"],
        ["test_bpn.py"],
    )
    assert not list(wrong(good))
    assert not list(wrong(Row("", "", ["skimage.morphology.skeletonize", "dvc.yaml"], [])))
    for functions, tests in [
        (["bpn.model.MotionModel.fly"], ["test_bpn.py"]),
        (["bpn.model.foretell"], ["test_bpn.py"]),
        (["bpn.back_propagation.unit_output", "predict"], ["test_bpn.py"]),  # of another module
        (["bpn.model.MotionModel"], ["test_none.py"]),
        (["bpn.model.MotionModel"], ["test_tracks.py"]),  # tests something else
        (["benchmarks/none.py"], []),
        (["skimage.morphology.skeleton_of"], []),
    ]:
        assert list(wrong(Row("", "", functions, tests))), functions
    with pytest.raises(AssertionError, match="of which module"):
        list(wrong(Row("", "", ["forward"], [])))
    head = f"| {' | '.join(HEADER)} |\n|---|---|---|---|\n"
    assert tables(head + "| Eq. 1 | x | `a.b`, `c` | `t.py` |\n\nText\n| a | b |") == [
        [Row("Eq. 1", "x", ["a.b", "c"], ["t.py"])]
    ]
    with pytest.raises(AssertionError, match=r"equations.md:3: 3 cells"):
        tables(head + "| Eq. 1 | x | `a.b` |")
    assert told("§3.1, Figs. 3–5, 7; Eq. 2", "Fig") == {3, 4, 5, 7}
    assert numbered("(2.7)–(2.9), (4.1)") == {(2, 7), (2, 8), (2, 9), (4, 1)}
