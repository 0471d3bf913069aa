"""The library's verbs: ten lines make what the pipeline's stages make."""

import contextlib
import re
import sys
from types import SimpleNamespace

import av
import numpy as np
import pandas as pd
import pytest
from conftest import ROOT, TINY_CARP
from tiny_run import stage_run
from toy_swim import MIRROR, RATE, random_swimmer, unseen

import finloop
from finloop import verbs
from finloop.base.errors import FinloopError
from finloop.edit.schema import EDIT
from finloop.io.table import load_table
from finloop.jumps.film import FilmJumps

EXAMPLE = ROOT / "examples/ten_lines.py"
STEERED = ("tracks", "reel", "model", "similar", "loops", "jumps", "gateways", "poses")


def changes(word):
    """What TINY_CARP changes of a stage word, as keywords."""
    own = [one.split(".", 1)[1].split("=") for one in TINY_CARP if one.startswith(f"{word}.")]
    return {key: {"true": True, "false": False}.get(value, number(value)) for key, value in own}


def number(text):
    with contextlib.suppress(ValueError):
        return int(text)
    return float(text) if text[0].isdigit() else text


@pytest.fixture
def tiny(monkeypatch):
    """Verbs with the parameters of TINY_CARP where the caller gives none."""
    real = verbs.settings

    def tiny_settings(word, **own):
        return real(word, **({} if own.get("source") == "file" else changes(word)) | own)

    monkeypatch.setattr(verbs, "settings", tiny_settings)


animate_run = stage_run("animate")


def test_the_ten_lines_make_what_the_stages_make(animate_run, tiny, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wanted = load_table(animate_run / "data/animate/hybrid.parquet", EDIT)
    assert wanted["time_s"].iloc[-1] == pytest.approx(2, abs=0.1)  # animate.seconds of the tiny run

    monkeypatch.setattr(sys, "argv", ["ten_lines.py"])
    text = EXAMPLE.read_text(encoding="utf-8")
    names = {}
    exec(text.replace("frames=750", "").replace(", seconds=20.0", ""), names)
    # px and degrees: last bits of a product may differ with where its numbers lie in memory
    pd.testing.assert_frame_equal(names["edit"], wanted, rtol=0, atol=0.05)
    with av.open("fish.mp4") as video:
        frames = [frame.to_ndarray(format="gray") for frame in video.decode(video=0)]
    assert len(frames) == len(wanted)
    assert frames[0].shape == names["film"].arena.shape
    # The tank lives: a film of it beside the tracks is the stage's, and the video has its grain.
    kept = animate_run / "data/extract/grain.mp4"
    assert names["tracks"].tank_pictures.read_bytes() == kept.read_bytes()
    finloop.write_video(
        "still.mp4", *(names[one] for one in ("edit", "tracks", "reel", "poses")), tank="still"
    )
    with av.open("still.mp4") as video:
        still = [frame.to_ndarray(format="gray") for frame in video.decode(video=0)]
    assert np.median(np.std(still, axis=0)) < 0.5 < np.median(np.std(frames, axis=0))
    made = [names[one] for one in STEERED]
    for mode in ("crawl", "nn"):
        with pytest.raises(FinloopError, match=f"mode '{mode}'") as refused:
            verbs.steer(*made, mode=mode)
        assert all(one in refused.value.wanted for one in verbs.GROUPS_OF)
    with pytest.raises(FinloopError, match=r"hybrid\.path: unknown; it is matching\.path now"):
        verbs.steer(*made, path="way.csv")
    with pytest.raises(FinloopError, match=r"the argument school_rule of steer\(\) now"):
        verbs.steer(*made, mode="matching", shoaling=None)
    company = {"mode": "matching", "fish": 2, "rule": "zones", "seconds": 1.0}
    with pytest.raises(FinloopError, match="no zones for fish in a school"):
        verbs.steer(*made, **company)
    with pytest.warns(UserWarning, match="Couzin"):
        school_rule = verbs.find_zones(names["features"], names["film"])
    edit = verbs.steer(*made, school_rule=school_rule, **company)
    assert set(edit["fish"]) == {0, 1} and "company" in set(edit["goal"])
    given = names["features"], names["poses"], names["jumps"], names["film"].rate_hz
    with pytest.raises(FinloopError, match="rows with a past"):
        verbs.train_forecast(*given)
    again = finloop.open_film(names["film"].folder / "clip.mp4", end_s=1.0)
    assert (again.facts.width_px, again.facts.frames) == (320, len(list(again)))


@pytest.mark.parametrize("sides", [1, 2])
def test_a_forecast_has_mirror_images_if_the_jumps_have(sides):
    features, codes = random_swimmer(count=400)
    poses = SimpleNamespace(codes=codes, shapes=SimpleNamespace(mirror_matrix=MIRROR))
    look = np.zeros((sides * len(features), 1), np.float32)
    jumps = FilmJumps(pd.DataFrame(), look, unseen, {})
    forecast = verbs.train_forecast(features, poses, jumps, RATE, epochs=1, hidden_units=4)
    assert len(forecast.states) == sides * len(features)
    image = forecast.states[-399:] * ([-1, 1, 1, -1, -1] if sides == 2 else 1)
    assert np.allclose(forecast.states[1:400], image)


def test_a_guide_shows_the_example():
    page = (ROOT / "docs/packages.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    code = EXAMPLE.read_text(encoding="utf-8").partition("import sys\n\n")[2]
    assert blocks == [code]
