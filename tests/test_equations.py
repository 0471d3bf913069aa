"""docs/equations.md against the code: what its rows name exists, is tested there, and is complete.

The pages in docs/equations/ against the table: each row's page holds the row's equations and figures.
"""

import ast
import importlib
import re
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

from docs.hooks import anchors
from finloop.base.settings import GROUPS, variants

ROOT = Path(__file__).parents[1]
DOCUMENT = (ROOT / "docs/equations.md").read_text(encoding="utf-8")
PAGES = {path.name: path.read_text(encoding="utf-8") for path in ROOT.glob("docs/equations/*.md")}
HEADER = ["paper", "where", "what it is", "page", "function", "test"]


class Row(NamedTuple):
    """A row of the table of equations; what stands in backquotes in its last two cells."""

    paper: str  # fish, curve, or finloop
    where: str
    what: str
    page: str  # a name in docs/equations/
    functions: list[str]
    tests: list[str]


def table(text: str) -> list[Row]:
    """Return the rows of the table of equations; a row that is torn is refused."""
    found: list[Row] = []
    inside = False
    for number, line in enumerate(text.splitlines(), 1):
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if cells == HEADER:
            inside = True
        elif not cells:
            inside = False
        elif inside and set(line) - set("|-: "):
            assert len(cells) == len(HEADER), f"docs/equations.md:{number}: {len(cells)} cells"
            page = re.fullmatch(r"\[[^]]+\]\(equations/([\w-]+\.md)\)", cells[3])
            assert page, f"docs/equations.md:{number}: {cells[3]}"
            quoted = [re.findall(r"`([^`]+)`", cell) for cell in cells[4:]]
            found.append(Row(*cells[:3], page[1], *quoted))
    return found


ROWS = table(DOCUMENT)


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
def definitions(module: str) -> frozenset[str]:
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
        elif name not in definitions(module):
            yield f"{module} defines no {name}"
        elif row.tests and not names_function(name.rpartition(".")[2], tested):
            yield f"{name} is named in none of {', '.join(row.tests)}"


def names_function(name: str, text: str) -> bool:
    """Whether a test names a function: as itself, as a method ("runge-kutta"), as its picture."""
    names = {name, name.replace("_", "-"), re.sub(r"^figure(\d+)$", r"fig\1", name)}
    return any(re.search(rf"(?<!\w){re.escape(one)}(?!\w)", text) for one in names)


def numbers_after(paper: str, word: str) -> set[int]:
    """The numbers that a cell tells after a word: "Figs. 3–5, 7" → {3, 4, 5, 7}."""
    found = set()
    for run in re.findall(rf"\b{word}s?\.? ([\d–, ]+)", paper):
        for first, last in re.findall(r"(\d+)(?:–(\d+))?", run):
            found |= set(range(int(first), int(last or first) + 1))
    return found


def equation_numbers(paper: str) -> set[tuple[int, int]]:
    """The equations that a cell tells: "(2.7)–(2.9)" → {(2, 7), (2, 8), (2, 9)}."""
    found = set()
    for part, first, last in re.findall(r"\((\d)\.(\d+)\)(?:–\(\d\.(\d+)\))?", paper):
        found |= {(int(part), n) for n in range(int(first), int(last or first) + 1)}
    return found


def tag_numbers(page: str) -> set[tuple[int, int]]:
    """Return the numbers of the curve paper's equations that a page shows."""
    return {(int(part), int(n)) for part, n in re.findall(r"\\tag\{(\d)\.(\d+)\}", page)}


PARAMETERS = {
    group: {field.name for variant in variants(group).values() for field in fields(variant)}
    for group in GROUPS
}
DECLARED = {
    base.__name__: base
    for group in GROUPS
    for option in variants(group).values()
    for base in option.__mro__
}
"""The classes that declare parameters, those they inherit from too, by name."""


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.paper} {row.where}: {row.what}")
def test_what_a_row_names_is_there_and_its_page_has_its_equations_and_figures(row):
    assert row.functions and not list(wrong(row))
    page = PAGES[row.page]
    if row.paper != "finloop":
        for word in ("Eq", "Fig", "Table"):
            assert numbers_after(page, word) >= numbers_after(row.where, word)
        assert tag_numbers(page) >= equation_numbers(row.where)


def test_every_equation_figure_and_table_of_both_papers_has_a_row():
    cells = {
        paper: [row.where for row in ROWS if row.paper == paper] for paper in ("fish", "curve")
    }
    for paper, word, last in (
        ("fish", "Eq", 8), ("fish", "Fig", 19), ("fish", "Table", 2), ("curve", "Fig", 14),
        ("curve", "Table", 2),
    ):  # fmt: skip
        numbers = set().union(*(numbers_after(cell, word) for cell in cells[paper]))
        assert numbers == set(range(1, last + 1)), (paper, word)
    wanted = {(part, n) for part, last in {2: 12, 3: 16, 4: 1}.items() for n in range(1, last + 1)}
    assert set().union(*map(equation_numbers, cells["curve"])) == wanted


def test_every_page_is_in_the_table_and_in_the_list():
    listed = re.findall(r"equations/([\w-]+\.md)", DOCUMENT.partition("## Pages")[2])
    assert sorted(listed) == sorted(PAGES) == sorted({row.page for row in ROWS})


@pytest.mark.parametrize("name", sorted(PAGES))
def test_what_a_page_names_is_there(name):
    """Links, parameters with their values, constants, modules, and functions by dotted path."""
    page = PAGES[name]
    for link in re.findall(r"\]\(([^)]+)\)", page):
        path, _, place = link.partition("#")
        target = (ROOT / "docs/equations" / path).resolve()
        assert target.is_file(), link
        assert not place or place in anchors(target.read_text(encoding="utf-8")), link
    assert "](../equations.md)" in page
    for dotted in re.findall(r"`([a-z_]+(?:\.\w+)+)(?:=[^`]*)?`", page):
        group, _, key = dotted.partition(".")
        if dotted.endswith((".py", ".yaml", ".parquet")) or group == "finloop":
            continue
        module, inner = split(dotted)
        is_module = (ROOT / "finloop" / dotted.replace(".", "/")).with_suffix(".py").is_file()
        is_parameter = key in PARAMETERS.get(group, ())
        assert is_module or is_parameter or inner in definitions(module), dotted
    for group, constant in re.findall(r"`(\w+Settings)\.(\w+)`", page):
        assert hasattr(DECLARED[group], constant), f"{group}.{constant}"


def test_a_row_that_is_not_true_is_found():
    def row(functions: list[str], tests: list[str]) -> Row:
        return Row("", "", "", "", functions, tests)

    good = [
        "bpn.model.MotionModel.predict",
        "bpn.back_propagation.unit_output",
        "train_motion_model",
    ]
    assert not list(wrong(row(good, ["test_bpn.py"])))
    assert not list(wrong(row(["skimage.morphology.skeletonize", "dvc.yaml"], [])))
    for functions, tests in [
        (["bpn.model.MotionModel.fly"], ["test_bpn.py"]),
        (["bpn.model.predict_nothing"], ["test_bpn.py"]),
        (["bpn.back_propagation.unit_output", "predict"], ["test_bpn.py"]),  # of another module
        (["bpn.model.MotionModel"], ["test_none.py"]),
        (["bpn.model.MotionModel"], ["test_tracks.py"]),  # tests something else
        (["benchmarks/none.py"], []),
        (["skimage.morphology.skeleton_of"], []),
    ]:
        assert list(wrong(row(functions, tests))), functions
    with pytest.raises(AssertionError, match="of which module"):
        list(wrong(row(["forward"], [])))
    head = f"| {' | '.join(HEADER)} |\n{'|---' * len(HEADER)}|\n"
    line = "| fish | Eq. 1 | x | [p](equations/p.md) | `a.b`, `c` | `t.py` |"
    assert table(f"{head}{line}\n\nText\n| a | b |") == [
        Row("fish", "Eq. 1", "x", "p.md", ["a.b", "c"], ["t.py"])
    ]
    with pytest.raises(AssertionError, match=r"equations.md:3: 3 cells"):
        table(head + "| Eq. 1 | x | `a.b` |")
    assert numbers_after("§3.1, Figs. 3–5, 7; Eq. 2", "Fig") == {3, 4, 5, 7}
    assert equation_numbers("(2.7)–(2.9), (4.1)") == {(2, 7), (2, 8), (2, 9), (4, 1)}
    assert tag_numbers("x \\tag{3.15}") == {(3, 15)}
