"""The tutorial and troubleshooting against the program: values, files, metrics and links are real."""

import json
import re
from pathlib import Path

import pytest
import yaml
from scratch import prepare

from finloop.settings import WORDS

ROOT = Path(__file__).parents[1]
GUIDES = [ROOT / "docs" / name for name in ("tutorial.md", "troubleshooting.md")]
STAGES = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
VALUE = re.compile(rf"\b((?:{'|'.join(WORDS)})\.\w+)=([^\s`\"]+)")


def values(text: str) -> list[tuple[str, str]]:
    """Every `group.key=value` of a text that is whole."""
    return [(key, value) for key, value in VALUE.findall(text) if "…" not in value]


def outputs() -> set[str]:
    """The files and folders that the stages write."""
    listed = [
        out
        for stage in STAGES.values()
        for kind in ("outs", "metrics", "plots")
        for out in stage.get(kind, [])
    ]
    return {name for out in listed for name in (out if isinstance(out, dict) else [out])}


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_every_value_that_is_advised_is_allowed(guide, tmp_path):
    left = sorted(set(values(guide.read_text(encoding="utf-8"))))
    assert len(left) > 8
    circle = {"clip.arena_x_px": "9", "clip.arena_y_px": "9", "clip.arena_radius_px": "9"}
    while left:  # together what does not name a key twice: composing takes a while
        now = dict(left)
        left = [one for one in left if one not in now.items()]
        now |= {"clip.path": "film.mp4"} | (circle if now.get("clip.arena") == "circle" else {})
        if "clip.arena" not in now:
            now = {key: value for key, value in now.items() if key not in circle}
        prepare(tmp_path, "clip=file", *(f"{key}={value}" for key, value in sorted(now.items())))


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_every_file_that_is_named_is_made(guide):
    made = outputs()
    named = set(re.findall(r"`((?:data|reports)/[\w./-]+)`", guide.read_text(encoding="utf-8")))
    assert named
    for name in named:
        folders = {str(folder) for folder in [Path(name), *Path(name).parents]}
        assert folders & made or any(out.startswith(name) for out in made), name


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_every_link_and_stage_is_there(guide):
    text = guide.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)]+)\)", text) if "://" not in link]
    assert links and all((guide.parent / link).is_file() for link in links)
    pictures = re.findall(r"!\[([^\]]*)\]", text)
    assert pictures and all(len(words) > 20 for words in pictures)  # for those who cannot see them
    assert set(re.findall(r"dvc repro (?:--force )?(\w+)", text)) <= set(STAGES)


def test_metrics_that_are_named_exist():
    """Those kept in git, of the default film."""
    known: set[str] = set()
    for path in ROOT.glob("reports/*/metrics.json"):
        known |= set(json.loads(path.read_text()))
    if "hybrid_seam_ratio_median" not in known:
        pytest.skip("reports/ holds no metrics of a whole run")
    ending = r"_(?:pct|frames|grey|median|fish|pale|sd|s|first|repeated|missing|hz)"
    for guide in GUIDES:
        text = guide.read_text(encoding="utf-8")
        for name in set(re.findall(rf"`(\w+{ending})`", text)):
            assert name in known, name
