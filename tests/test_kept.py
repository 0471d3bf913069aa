"""Results that a stage keeps for its next run: exact, found by content alone, few."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from finloop.realism.auc import Auc, Scores
from finloop.realism.compare import Verdict
from stages import kept


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which DVC has checked the parameters of `realism`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))
    Path("data/params").mkdir(parents=True)
    Path("data/params/realism.yaml").write_text("a")
    Path("data/clip").mkdir()
    return tmp_path


def open_kept(**own: str) -> kept.KeptResults:
    return kept.open_kept("realism", [Path("data/clip")], own)


def test_a_mode_is_made_again_only_if_its_own_or_common_inputs_differ(folder):
    first = open_kept(loops="1", hybrid="1")
    for mode in ("loops", "hybrid"):
        first.save_values(mode, [mode])
    again = open_kept(loops="1", hybrid="2")
    assert again.load_values("loops") == ["loops"]
    assert again.load_values("hybrid") is None
    Path("data/clip/film.txt").write_text("another film")
    assert open_kept(loops="1").load_values("loops") is None
    Path("data/params/realism.yaml").unlink()  # started by hand
    by_hand = open_kept(loops="1")
    by_hand.save_values("loops", [1])
    assert by_hand.load_values("loops") is None


def test_kept_numbers_are_exact(folder):
    results, rng = open_kept(), np.random.default_rng(0)
    frames = [pd.DataFrame({"x": rng.normal(size=n), "n": np.int16(n)}) for n in (3, 0, 2)]
    frames[0].loc[1, "x"] = np.nan
    results.save_frames("film", frames)
    back = results.load_frames("film", 3)
    for old, new in zip(frames, back, strict=True):
        pd.testing.assert_frame_equal(old, new, check_exact=True)
    scores = Scores(*map(np.array, ([0.1, np.nan], [True, False], [0, 1], [3, -1])))
    verdict = Verdict(Auc(1 / 3, 0.1, 0.9), {"speed": Auc(0.5, 0.2, 0.8)}, {"speed": 1e-17}, scores)
    results.save_values("loops", verdict.to_values())
    found = Verdict.from_values(results.load_values("loops"))
    assert found.whole == verdict.whole and found.importance == verdict.importance
    assert found.alone == verdict.alone
    for old, new in zip(verdict.scores, found.scores, strict=True):
        assert old.dtype == new.dtype
        np.testing.assert_array_equal(old, new)


def test_results_that_were_not_used_for_long_are_dropped(folder, monkeypatch):
    monkeypatch.setattr(kept, "MOST", 2)
    results = open_kept()
    for name in ("a", "b", "c"):
        results.save_values(name, name)
    (home,) = folder.glob("data/.realism.kept")
    assert len(list(home.iterdir())) == 2
