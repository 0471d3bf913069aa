"""README and guides against the program: values, files, metrics, links and pictures are real."""

import ast
import builtins
import re
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from scratch import prepare

from docs.draw.flow import svg
from docs.hooks import anchors
from finloop.base.settings import GROUPS, variants
from finloop.edit.schema import EDIT
from finloop.io.numbers import load_numbers

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PICTURES = DOCS / "pictures"
GUIDES = [ROOT / "README.md", *(one for one in DOCS.glob("*.md") if one.stem != "equations")]
PARAMETERS = DOCS / "parameters.md"  # generated: names files of any film, in conf/'s own words
ADDED = {"new-mode": "smooth", "new-exporter": "positions", "new-stage": "rest"}
"""What those who follow a page for developers add."""
STAGES = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
VALUE = re.compile(rf"\b((?:{'|'.join(GROUPS)})\.\w+)=([^\s`\"]+)")


def values(text: str) -> list[tuple[str, str]]:
    """Every `group.key=value` of a text that is whole, and those of its YAML."""
    blocks = map(yaml.safe_load, re.findall(r"```yaml\n(.*?)```", text, re.DOTALL))
    return [
        (f"{word}.{key}", str(value))
        for block in blocks
        for word, group in block.items()
        if word in GROUPS
        for key, value in group.items()
    ] + [
        (key, one)
        for key, value in VALUE.findall(text)
        if "…" not in value and "interval(" not in value  # which Optuna takes values from
        for one in (value.split(",") if value[0].isdigit() else [value])  # those of a sweep
    ]


def outputs() -> set[str]:
    kinds = ("outs", "metrics", "plots")
    listed = [out for stage in STAGES.values() for kind in kinds for out in stage.get(kind, [])]
    return {name for out in listed for name in (out if isinstance(out, dict) else [out])}


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_every_value_that_is_advised_is_allowed(guide, tmp_path):
    added = ADDED.get(guide.stem, " ")
    advised = set(values(guide.read_text(encoding="utf-8")))
    left = sorted((key, one) for key, one in advised if added not in f"{key}={one}")
    while left:  # together what does not name a key twice: composing takes a while
        now = dict(left)
        left = [one for one in left if one not in now.items()]
        now |= {"clip.path": "film.mp4"}
        prepare(tmp_path, "clip=file", *(f"{key}={value}" for key, value in sorted(now.items())))
        composed = yaml.safe_load((tmp_path / "params.yaml").read_text(encoding="utf-8"))
        for key, value in now.items():
            group, name = key.split(".")
            assert composed[group][name] == yaml.safe_load(value), key


@pytest.mark.parametrize(
    "guide", [one for one in GUIDES if one != PARAMETERS], ids=lambda path: path.stem
)
def test_every_file_that_is_named_is_made(guide):
    made = outputs()
    named = set(re.findall(r"`((?:data|reports)/[\w./-]+)`", guide.read_text(encoding="utf-8")))
    named -= {"data/", "reports/", "data/drawings/", "data/gaits/"}  # the last two are given
    named -= {"reports/compare.html", "reports/fixture/"}  # by `make sweep`, `make ci-fixture`
    named -= {"reports/study.html", "reports/study.csv"}  # by `make study`
    named -= {"reports/blind/index.html"}  # by `make blind`
    for name in (one for one in named if ADDED.get(guide.stem, " ") not in one):
        folders = {str(folder) for folder in [Path(name), *Path(name).parents]}
        assert folders & made or any(out.startswith(name) for out in made), name


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_every_link_and_stage_is_there(guide):
    text = guide.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)]+)\)", text):
        path, _, place = link.partition("#")
        page = guide.parent / path if path else guide
        assert "://" in link or page.exists(), link
        assert not place or place in anchors(page.read_text("utf-8")), link
    pictures = re.findall(r"!\[([^\]]*)\]", text)
    assert all(len(words) > 10 for words in pictures)  # for those who cannot see them
    assert set(re.findall(r"dvc repro (?:--force )?([a-z][\w-]*)", text)) <= set(STAGES)


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_every_command_is_there(guide):
    text = guide.read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert set(re.findall(r"(?:^|`)make ([a-z-]+)", text, re.MULTILINE)) <= targets
    for module in re.findall(r"python -m ((?:finloop|stages|benchmarks|docs)[\w.]*)", text):
        path = ROOT / module.replace(".", "/")
        is_there = path.with_suffix(".py").is_file() or (path / "__main__.py").is_file()
        is_written = f"`{module.replace('.', '/')}.py` (new) |" in text  # by those who follow it
        assert is_there or is_written, module


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_every_import_of_a_guide_is_there(guide):
    text = guide.read_text(encoding="utf-8")
    for module, listed in re.findall(
        r"^from ((?:finloop|stages)[\w.]*) import (\([^)]*\)|[^(\n#]+)", text, re.MULTILINE
    ):
        imported = re.findall(r"\w+", listed)
        if f"`{module.replace('.', '/')}.py` (new) |" in text:  # by those who follow the guide
            assert all(re.search(rf"^(?:def|class) {one}\b", text, re.M) for one in imported), (
                module
            )
        else:
            there = import_module(module)
            missing = [one for one in imported if not hasattr(there, one)]
            assert not missing, (module, missing)


@cache  # three pages ask
def names_of_program() -> set[str]:
    """What finloop, its stages and its tests define: functions, classes, fields, constants."""
    found = set[str]()
    for folder in ("finloop", "stages", "tests"):
        for path in (ROOT / folder).rglob("*.py"):
            found |= set(defined_names(path.read_text(encoding="utf-8"))) | {path.stem}
    return found


def defined_names(text: str) -> Iterator[str]:
    """The names that a module or a class defines, and what a function calls its variables."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


@pytest.mark.parametrize("page", ADDED)
def test_every_name_of_a_page_for_developers_is_there(page):
    """Those with an underscore or a capital: functions, classes, constants, fields, tests."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    known = names_of_program() | {*re.findall(r"(?:def|class) (\w+)", text)}
    known |= {*dir(builtins), *re.findall(r"(\w+):", (ROOT / "dvc.yaml").read_text())}
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    named = set(re.findall(r"`([A-Za-z]\w*)(?:\([\w, ]*\))?`", prose))
    missing = {one for one in named if "_" in one or one != one.lower()} - known
    assert not missing


def test_the_readme_is_short_and_the_map_names_every_room():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150
    text = (DOCS / "packages.md").read_text(encoding="utf-8").partition("## Map")[2]
    rooms = {path.parent.name for path in (ROOT / "finloop").glob("*/__init__.py")}
    assert rooms - set(STAGES) <= set(re.findall(r"`(\w+)`", text))


def test_the_picture_of_the_stages_is_that_of_the_pipeline():
    assert (PICTURES / "flow.svg").read_text(encoding="utf-8") == svg(
        (ROOT / "dvc.yaml").read_text(encoding="utf-8")
    ), "make pictures"


def test_every_picture_is_used_and_all_are_small():
    texts = "".join(guide.read_text(encoding="utf-8") for guide in GUIDES)
    pictures = list(PICTURES.iterdir())
    assert all(f"pictures/{path.name})" in texts for path in pictures)
    assert sum(path.stat().st_size for path in pictures) <= 6e6


def test_metrics_that_are_named_exist():
    """Those kept in git, of the default film; a name may also be a column or a parameter."""
    known = set(EDIT.names)
    for path in ROOT.glob("reports/*"):
        known |= set(load_numbers(path))
    if "hybrid_seam_ratio_median" not in known:
        pytest.skip("reports/ holds no metrics of a whole run")
    options = [option for group in GROUPS for option in variants(group).values()]
    known |= {field.name for option in options for field in fields(option)}
    ending = r"_(?:pct|frames|grey|median|fish|pale|sd|s|first|repeated|missing|hz)"
    for guide in (one for one in GUIDES if one.stem not in ADDED):  # those name functions
        text = guide.read_text(encoding="utf-8")
        for name in set(re.findall(rf"`(\w+{ending})`", text)):
            assert name in known, name
