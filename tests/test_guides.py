"""README and guides against the program: values, files, metrics, links and pictures are real."""

import re
from dataclasses import fields
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
    left = sorted(set(values(guide.read_text(encoding="utf-8"))))
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
    for name in named:
        folders = {str(folder) for folder in [Path(name), *Path(name).parents]}
        assert folders & made or any(out.startswith(name) for out in made), name


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_every_link_and_stage_is_there(guide):
    text = guide.read_text(encoding="utf-8")
    for link in re.findall(r"\]\(([^)]+)\)", text):
        path, _, place = link.partition("#")
        assert "://" in link or (guide.parent / path).exists(), link
        assert not place or place in anchors((guide.parent / path).read_text("utf-8")), link
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
        is_written = f"| `{module.replace('.', '/')}.py` |" in text  # by those who follow the guide
        assert is_there or is_written, module


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
    for guide in GUIDES:
        text = guide.read_text(encoding="utf-8")
        for name in set(re.findall(rf"`(\w+{ending})`", text)):
            assert name in known, name
