"""The stage `gait`, end to end in a folder of its own: a drawn dog and two toy fish."""

import shutil
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import ROOT, TINY_CARP
from scratch import content, prepare, put_clip
from tiny_run import stage_run

import stages.gait
from finloop.base.errors import FinloopError
from finloop.drawn.dog.draw import dog_frames, limb_masks
from finloop.drawn.dog.walk import DogFilm
from finloop.extract.table import OUTLINE_POINTS, SceneFacts, tracks_schema
from finloop.features.table import FEATURES
from finloop.gait.settings import GaitSettings
from finloop.gait.tool import load_gait
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture
from finloop.io.record import save_record
from finloop.io.regions import save_masks
from finloop.io.table import save_table

RATE = 25
BEAT_HZ = 2.0
SMALL = tuple(one for one in TINY_CARP if one.startswith("gait."))


def toy_fish(frames: int, beats: bool) -> tuple[np.ndarray, np.ndarray]:
    """Backbones (frames, 33, 2), head first, and outlines of a fish that swims to the right."""
    s = np.linspace(0, 1, 33)
    time = np.arange(frames)[:, None] / RATE
    side = 6.0 * s**2 * np.cos(2 * np.pi * (BEAT_HZ * time - 0.7 * s)) * beats
    ahead = 100 - 60 * s + 40 * time
    backbone = np.stack([ahead, 80 + side], -1)
    width = 5 * np.sin(np.pi * s**0.7) + 0.3
    upper, lower = backbone - [[0, 1]] * width[:, None], backbone + [[0, 1]] * width[:, None]
    ring = np.concatenate([upper, lower[:, ::-1]], axis=1)
    picked = np.linspace(0, ring.shape[1], OUTLINE_POINTS, endpoint=False)
    at = np.arange(66)
    outline = [[np.interp(picked, at, one[:, c], period=66) for c in range(2)] for one in ring]
    return backbone, np.transpose(outline, (0, 2, 1))


def put_fish(folder: Path, *beats: bool, frames: int = 50) -> None:
    """What the stages before make of fish that beat their tails or are stiff."""
    put_clip(folder, [np.zeros((16, 16), np.uint8)] * 2, RATE)
    facts = SceneFacts("dark", 1, 5, 300, 60, 50, "all", 33)
    save_record(folder / "data/extract/scene.json", facts)
    tracks, features = [], []
    for number, beating in enumerate(beats):
        backbone, outline = toy_fish(frames, beating)
        lists = {f"outline_{c}_px": list(outline[..., k].astype("f4")) for k, c in enumerate("xy")}
        lists |= {
            f"backbone_{c}_px": list(backbone[..., k].astype("f4")) for k, c in enumerate("xy")
        }
        lists["half_width_px"] = lists["backbone_x_px"]
        ids = {"track_id": number, "frame": np.arange(frames)}
        head = {"head_x_px": backbone[:, 0, 0], "head_y_px": backbone[:, 0, 1]}
        tracks.append(pd.DataFrame(ids | lists))
        features.append(pd.DataFrame(ids | head))
    for path, schema, parts in (
        ("data/extract/tracks.parquet", tracks_schema(33), tracks),
        ("data/features/features.parquet", FEATURES, features),
    ):
        table = pd.concat(parts, ignore_index=True)
        table = table.assign(**{c.name: 1 for c in schema.columns if c.name not in table})
        for column in schema.columns:
            if column.length is None:
                table[column.name] = table[column.name].astype(column.dtype)
        save_table(folder / path, table[[c.name for c in schema.columns]], schema)


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    for name in ("drawings", "gaits"):
        shutil.copytree(ROOT / "data" / name, tmp_path / "data" / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def no_figures(monkeypatch) -> None:
    monkeypatch.setattr(stages.gait, "draw_gait_figures", lambda *_: iter(()))


gait_run = stage_run("gait")


TABLES = {"by_contour.csv", "by_scale.csv", "gamma.csv", "not_monotone.csv", "tracks.csv"}
FIGURES = {f"fig{number}" for number in range(8, 15)} | {
    f"fig11_{sharing}" for sharing in ("scale", "coefficient", "coordinate")
}


DRAWN = {f"{n}{e}" for n in ("dog", "fish") for e in (".svg", ".webp", ".mp4", ".lottie.json")}
MADE = TABLES | DRAWN | {"dog_film.mp4", "regions", "limbs.json"}


@pytest.mark.usefixtures("no_figures")
def test_stage_makes_what_dvc_expects_the_same_each_time(gait_run, folder):
    shutil.copytree(gait_run, folder, dirs_exist_ok=True)
    first = content(folder / "data/gait") | content(folder / "reports/gait")
    stage = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]["gait"]
    named = [next(iter(o)) if isinstance(o, dict) else o for o in stage["outs"] + stage["metrics"]]
    for out in named:
        assert (folder / out).exists(), out
    made_here = {path.name for path in (folder / "data/gait").iterdir()}
    assert made_here - {"outline.json"} == MADE
    for name in FIGURES:
        assert load_picture(folder / f"reports/gait/figures/limbs/{name}.png").std() > 5
    numbers = load_numbers(folder / "reports/gait")
    assert numbers["dog_gamma_error_exact_pct"] < 2
    assert numbers["dog_gamma_error_film_pct"] < 20  # a quarter of the usual picture
    assert numbers["limbs_rms_limb_pct"] < 0.8 * numbers["limbs_rms_linear_pct"]
    assert numbers["limbs_rms_gamma_pct"] == numbers["limbs_rms_coordinate_pct"]
    assert numbers["limbs_rms_gamma_pct"] < numbers["limbs_rms_coefficient_pct"]
    turning = pd.read_csv(folder / "data/gait/not_monotone.csv")
    assert len(turning) == numbers["limbs_coordinates_not_monotone"] > 0
    assert (turning["gamma"].abs() > 1).all()
    assert np.shape(load_gait(folder / "data/gait/limbs.json").gamma["fore_left"]["A"])[1] == 2
    prepare(folder, *SMALL)
    stages.gait.main()
    again = content(folder / "data/gait") | content(folder / "reports/gait")
    assert again == {name: of for name, of in first.items() if "/fig" not in name}


@pytest.mark.usefixtures("no_drawing")  # painted they are above
def test_of_two_fish_the_one_that_beats_its_tail_has_a_gait(folder, monkeypatch):
    figures = stages.gait.draw_gait_figures
    monkeypatch.setattr(  # the dog's, of which it has pictures, are drawn above
        stages.gait, "draw_gait_figures", lambda *given: iter(()) if given[-1] else figures(*given)
    )
    prepare(folder, *SMALL)
    put_fish(folder, True, False)
    stages.gait.main()
    made_here = {path.name for path in (folder / "data/gait").iterdir()}
    assert made_here == {*MADE, "outline.json"}
    figures_here = {path.name for path in (folder / "reports/gait/figures/outline").iterdir()}
    assert figures_here == {f"{name}.png" for name in FIGURES}
    numbers = load_numbers(folder / "reports/gait")
    assert (numbers["tracks"], numbers["tracks_that_repeat"]) == (2, 1)
    assert numbers["outline_frequency_hz"] == pytest.approx(BEAT_HZ, rel=0.01)
    assert numbers["outline_rms_gamma_pct"] < min(2.0, numbers["outline_rms_linear_pct"])
    tracks = pd.read_csv(folder / "data/gait/tracks.csv")
    assert tracks["why_not"].notna().tolist() == [False, True]
    assert load_gait(folder / "data/gait/outline.json").symmetry == "mirror"


@pytest.mark.usefixtures("no_figures")
def test_own_regions_and_a_film_in_which_nothing_repeats(folder, capsys):
    dog = DogFilm(frames=36, cycles=1.9, width_px=160, height_px=107, trunk_px=57)
    masks = [limb_masks(picture) for picture in dog_frames(dog)]
    masks[5]["fore_right"][:] = False
    save_masks(folder / "own", masks)
    for path in sorted((folder / "own").glob("*/*.png"), reverse=True):
        path.rename(path.with_stem(f"{int(path.stem) + 1:04}"))
    prepare(folder, *SMALL, "gait.regions=own",
            "gait.regions_rate_hz=24", "gait.gamma=scale")  # fmt: skip
    put_fish(folder, False, frames=20)
    stages.gait.main()
    said = capsys.readouterr().out
    assert "fore_right is left out of frames 6: empty" in said  # as its file is called
    assert "no track of the clip has an outline that repeats" in said
    assert not (folder / "reports/gait/figures/outline").exists()
    assert not (folder / "data/gait/outline.json").exists()
    gait = load_gait(folder / "data/gait/limbs.json")
    assert np.ndim(gait.gamma["fore_left"]["A"]) == 1 < len(gait.gamma["fore_left"]["A"])
    numbers = load_numbers(folder / "reports/gait")
    assert numbers["limbs_rms_gamma_pct"] == numbers["limbs_rms_scale_pct"]
    assert gait.name == "own" and gait.frequency_hz == pytest.approx(dog.frequency_hz, rel=0.03)


GALLOP = [f"data/drawings/dog_gallop_{key}.svg" for key in (1, 2, 3, 4)]


@pytest.mark.usefixtures("no_drawing")
def test_one_cycle_of_a_gallop_is_fitted_and_moves_four_key_poses(folder, monkeypatch):
    monkeypatch.setattr(stages.gait, "ENDINGS", (".svg",))
    drawn = {}
    figures = stages.gait.draw_gait_figures
    monkeypatch.setattr(  # those that differ from a walk's
        stages.gait,
        "draw_gait_figures",
        lambda *given: drawn.update(islice(figures(*given), 4)) or iter(()),
    )
    prepare(folder, *SMALL, "gait.regions=data/gaits/horse",
            "gait.regions_rate_hz=30", "gait.regions_cycle_frames=15", "gait.symmetry=none",
            "gait.walker_drawings=[" + ",".join(GALLOP) + "]")  # fmt: skip
    put_fish(folder, False, frames=10)
    stages.gait.main()
    gait = load_gait(folder / "data/gait/limbs.json")
    assert (gait.symmetry, gait.frequency_hz, gait.confidence) == ("none", 2.0, None)
    shipped = load_gait(ROOT / "data/gaits/horse_gallop.json")
    assert gait.support == shipped.support
    assert set(drawn) == {"fig8", "fig9", "fig10", "fig11"}
    numbers = load_numbers(folder / "reports/gait")
    assert numbers["limbs_rms_gamma_pct"] < 2.5 < numbers["limbs_rms_linear_pct"]
    assert numbers["dog_feet_slide_after_pct"] < 1.2
    assert "limbs_confidence" not in numbers or numbers["limbs_confidence"] is None


@pytest.mark.usefixtures("no_figures")
@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("gait.contour_points=100",), "power of two"),
        (("gait.regions=data/gaits/horse",), "regions_rate_hz"),
        (("gait.symmetry=none",), "the drawn dog walks"),
        (("gait.walker_drawings=[" + ",".join(GALLOP) + "]",), "walker_drawings needs 2 key poses"),
        (("gait.walker_drawings=[data/drawings/dog_1.svg,data/drawings/fish_2.svg]",), "do not match"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_and_nothing_is_lost(folder, asked, said):
    (folder / "data/gait").mkdir(parents=True)
    (folder / "data/gait/kept.txt").write_text("kept")
    put_fish(folder, False, frames=10)
    with pytest.raises(FinloopError, match=said):
        prepare(folder, *SMALL, *asked)
        stages.gait.main()
    assert (folder / "data/gait/kept.txt").read_text() == "kept"


@pytest.mark.usefixtures("no_figures")
def test_a_film_with_less_than_a_step_is_refused(folder, monkeypatch):
    monkeypatch.setattr(GaitSettings, "dog_cycles", 0.4)
    prepare(folder, *SMALL)
    with pytest.raises(FinloopError, match="not periodic"):
        stages.gait.main()
