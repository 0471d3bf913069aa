"""Several films as one motion base: which they are, one count of frames, fish of one size, light."""

import json
import shutil
from collections import Counter
from fractions import Fraction

import cv2
import numpy as np
import pandas as pd
import pytest
from scratch import content, prepare, write_frames
from toy_fish import line, outline, polygon_mask

import stages.clip
import stages.extract
import stages.plots.extract
from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.base.settings import settings
from finloop.extract.join_films import (
    FishScaling,
    find_fish_scaling,
    join_extractions,
    match_cutout,
)
from finloop.extract.settings import ExtractSettings
from finloop.extract.table import tracks_schema
from finloop.io.cutouts import open_cutouts
from finloop.io.footage import list_films, unique_film_names
from finloop.io.movie import VideoWriter
from finloop.io.numbers import load_numbers
from finloop.io.several import frames_at_rate, load_readable_films
from finloop.io.table import load_table, save_table
from finloop.io.video import VideoFacts, load_facts

FRAMES, BODY = 24, 24.0
POINTS = ExtractSettings.points
SIZE = (90, 160)


# --- which films


def touch(folder, *paths):
    for path in paths:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).touch()
    return folder


def test_a_folder_of_films_gives_each_in_natural_order(tmp_path):
    home = touch(
        tmp_path, "a10.mp4", "a2.AVI", ".hidden.mp4", "notes.txt", "pages/1.png", "x/y.txt"
    )
    assert [path.name for path in list_films(str(home))] == ["a2.AVI", "a10.mp4", "pages"]
    pages = touch(tmp_path / "film", "1.png", "2.png")  # a folder of pictures is a film
    assert list_films(str(pages)) == [pages]


def test_a_pattern_gives_what_it_fits(tmp_path):
    home = touch(tmp_path, "b 2.mp4", "b 10.mp4", "deep/b 1.mp4", "c[1].mp4")
    assert [path.name for path in list_films(f"{home}/b*.mp4")] == ["b 2.mp4", "b 10.mp4"]
    assert len(list_films(f"{home}/**/b*.mp4")) == 3
    assert list_films(f"{home}/c[1].mp4") == [home / "c[1].mp4"]  # a file of that very name
    assert list_films(f"{home}/gone.mp4") == [home / "gone.mp4"]
    with pytest.raises(FinloopError, match="matches no file"):
        list_films(f"{home}/z*.mp4")


def test_names_are_all_different_and_plain(tmp_path):
    paths = [tmp_path / one for one in ("a/Tank 1.mp4", "b/tank_1.avi", "b/tank 1.avi", "'ü'.mov")]
    made = unique_film_names(paths)
    assert made == ["Tank-1", "tank_1", "tank-1-2", "-ü-"]
    assert unique_film_names(paths[:2]) == made[:2]  # a further film renames none


def test_a_film_that_is_named_twice_is_taken_once(tmp_path, capsys):
    """As itself, by its folder and by a link; but two parts of it are two films."""
    home = touch(tmp_path, "films/a.mp4", "films/b.mp4") / "films"
    (home / "c.mp4").symlink_to(home / "a.mp4")
    a = str(home / "a.mp4")
    films = stages.clip.settings_of_films(settings("clip", source="file", path=(str(home), a)))
    assert [film.film.name for film in stages.clip.drop_repeated_films(films)] == ["a.mp4", "b.mp4"]
    said = capsys.readouterr().err
    assert f"c.mp4 is named twice as {a}" in said and f"{a} is named twice, and" in said
    part = {"path": a, "start_s": 2.0}
    films = stages.clip.settings_of_films(settings("clip", source="file", path=(a, part, part)))
    assert [film.start_s for film in stages.clip.drop_repeated_films(films)] == [0.0, 2.0]


# --- one count of frames


@pytest.mark.parametrize("rate", [Fraction(25), Fraction(30), Fraction(60), Fraction(500)])
def test_a_quicker_film_shows_its_frames_nearest_in_time(rate):
    common = Fraction(25)
    shown = frames_at_rate(101, rate, common)
    late_s = shown / float(rate) - np.arange(len(shown)) / float(common)
    assert np.abs(late_s).max() <= 0.5 / float(rate) + 1e-9
    assert (np.diff(shown) > 0).all()
    assert 100 - shown[-1] < rate / common
    nearly = frames_at_rate(50, rate * Fraction(2807, 2800), rate)  # then every frame is kept
    assert np.array_equal(nearly, np.arange(50))


# --- fish of one size, in one light


def blob(scale):
    """A cut-out of a soft round fish about the same place of a film that is `scale` as fine."""
    y, x = np.mgrid[:80, :90] + 0.0
    x0, y0 = round(30 * scale), round(20 * scale)
    middle = np.array([60.3, 44.8]) * scale - (x0, y0)
    alpha = 255 * np.exp(-((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / (2 * (6 * scale) ** 2))
    return Cutout(0, 0, x0, y0, np.dstack([0.4 * alpha, alpha]).round().astype(np.uint8))


def moments(one):
    alpha = one.pixels[..., -1].astype(float)
    y, x = np.mgrid[: alpha.shape[0], : alpha.shape[1]]
    middle = [(alpha * x).sum() / alpha.sum(), (alpha * y).sum() / alpha.sum()]
    return alpha.sum(), np.add(middle, (one.x0_px, one.y0_px))


@pytest.mark.parametrize("scale", [0.5, 0.8, 1.25])
def test_a_resized_cut_out_lies_where_its_fish_lies(scale):
    mass, middle = moments(blob(1.0))
    made = match_cutout(blob(1.0), FishScaling(scale))
    assert moments(made)[0] == pytest.approx(scale**2 * mass, rel=0.02)
    assert moments(made)[1] == pytest.approx(scale * middle, abs=0.05)
    assert (made.pixels[..., 0] <= made.pixels[..., 1]).all()
    for gain in (2.0, 3.0):  # light never exceeds alpha
        lit = match_cutout(blob(1.0), FishScaling(gains=(gain,))).pixels
        assert lit[..., 0].max() == pytest.approx(min(gain * 0.4, 1) * 255, abs=2)
        assert (lit[..., 0] <= lit[..., 1]).all()


def test_what_fish_of_one_film_differ_by_is_left():
    light = np.array([100.0])
    assert find_fish_scaling(60.0, 62.0, light, light * 1.03, drop_colour=False) == FishScaling()
    assert find_fish_scaling(60.0, 90.0, light, light, drop_colour=False).scale == 1.5
    assert find_fish_scaling(60.0, 60.0, light, light * 0.5, drop_colour=False).gains == (0.5,)


# --- the stages


def swimming(frames=FRAMES, scale=1.0, light=1.0, late=0.0):
    """A fish that swims through the picture, its tail beating; `scale`: of the whole picture."""
    made = []
    for k in range(frames):
        local = line(0.6 * np.sin(1.1 * (k + late))) * BODY / 60.0
        down = (local * (1, -1) + (34.0 + 4.5 * (k + late), 45.0)) * scale
        shape = tuple(int(side * scale) for side in SIZE)
        mask = polygon_mask(outline(down, scale * BODY * 0.1 * WIDE), shape) / 255.0
        made.append(np.rint(light * (180 - 120 * mask)).astype(np.uint8))
    return made


WIDE = np.sqrt(np.abs(np.sin(np.pi * np.linspace(0, 1, 33) ** 0.7))) + 0.1


def put_film(path, frames, rate=25):
    height, width = frames[0].shape
    facts = VideoFacts("file", width, height, len(frames), Fraction(rate), False, ())
    write_frames(VideoWriter.from_facts(path, facts), frames)
    return path


def films(folder):
    """A film; the same finer, darker and twice as fast; one that cannot be read."""
    put_film(folder / "1 first.mp4", swimming())
    quick = [
        f for k in range(FRAMES) for f in swimming(1, 1.5, 0.6, k) + swimming(1, 1.5, 0.6, k + 0.5)
    ]
    put_film(folder / "2 fine.mp4", quick, rate=50)
    (folder / "3 broken.mp4").write_bytes(b"no film")


@pytest.fixture(scope="module")
def joined_run(tmp_path_factory):
    """A folder in which clip and extract have run on a folder of films."""
    home = tmp_path_factory.mktemp("several")
    (home / "films").mkdir()
    films(home / "films")
    with pytest.MonkeyPatch.context() as patch:
        run(home, patch)
        stages.plots.extract.main()
    return home


def run(home, patch):
    prepare(home, "clip=file", "clip.path=films", *FEW)
    patch.chdir(home)
    stages.clip.main()
    stages.extract.main()


FEW = ["extract.min_track_frames=5"]


def table_of(home):
    return load_table(home / "data/extract/tracks.parquet", tracks_schema(POINTS))


def test_the_frames_of_all_films_are_one_count_at_the_lowest_rate(joined_run):
    facts = load_facts(joined_run / "data/clip/facts.json")
    assert facts.segments == ((0, FRAMES), (FRAMES, 2 * FRAMES))
    assert (facts.frames, facts.frame_rate, facts.width_px) == (2 * FRAMES, 25, SIZE[1])
    assert [part.name for part in load_readable_films(joined_run / "data/clip")] == [
        "1-first",
        "2-fine",
    ]
    picture = cv2.imread(str(joined_run / "reports/film/extract/detections.png"))
    assert picture.shape[0] > 2 * SIZE[0]  # it shows both


def test_the_second_fish_is_as_the_first_in_size_place_and_light(joined_run):
    table = table_of(joined_run)
    first, second = (table[table["track_id"] == k].set_index("frame") for k in (0, 1))
    second.index -= FRAMES
    both = first.index.intersection(second.index)
    assert len(both) > 15
    for name in ("x_px", "y_px", "length_px"):  # lengths of fish are measured to a few percent
        assert first.loc[both, name].to_numpy() == pytest.approx(second.loc[both, name], rel=0.06)
    with open_cutouts(joined_run / "data/extract/cutouts.arrow") as store:
        assert np.array_equal(store.index[["track_id", "frame"]], table[["track_id", "frame"]])
        shown = [
            np.median(one.pixels[..., 0][one.pixels[..., 1] > 250])
            for one in (store[int(table.index[table["track_id"] == k][5])] for k in (0, 1))
        ]
    assert shown[0] == pytest.approx(shown[1], abs=4)


def test_a_film_that_cannot_be_read_is_named_and_the_others_go_on(joined_run):
    numbers = load_numbers(joined_run / "reports/clip")
    assert (numbers["films"], numbers["films_left_out"]) == (2, 1)
    listed_ = json.loads((joined_run / "data/clip/films.json").read_text())
    assert [bool(one["error"]) for one in listed_] == [False, False, True]
    assert "3 broken.mp4" in listed_[2]["path"]
    assert not (joined_run / "data/clip/films/3-broken").exists()


def test_two_films_of_one_name_and_the_tank_are_told(tmp_path, monkeypatch, capsys):
    films = [tmp_path / "a/film.mp4", tmp_path / "b/film.mp4", tmp_path / "c/film.mp4"]
    for path in films:
        path.parent.mkdir()
        put_film(path, swimming())
    films[0].write_text("no film")
    prepare(tmp_path, "clip=file", f"clip.path=[{','.join(map(str, films))}]")
    monkeypatch.chdir(tmp_path)
    stages.clip.main()
    said = capsys.readouterr().err
    for name, path in zip(("film", "film-2", "film-3"), films, strict=True):
        assert f"{name} is {path}" in said
    assert "uses the tank of film-2" in said


def test_a_film_that_is_still_recorded_is_refused_as_such(tmp_path, monkeypatch):
    put_film(path := tmp_path / "film.mp4", swimming())
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    prepare(tmp_path, "clip=file", f"clip.path={path}")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FinloopError, match="still being recorded or copied"):
        stages.clip.main()


def test_adding_a_film_makes_that_film_alone(joined_run, tmp_path, monkeypatch, capsys):
    home = tmp_path / "home"
    shutil.copytree(joined_run, home, symlinks=True)
    before = {kind: content(home / "data" / kind / "films") for kind in ("clip", "extract")}
    put_film(home / "films/3 broken.mp4", swimming(late=0.3))
    made = Counter()
    for stage, verb in ((stages.clip, "make_clip"), (stages.extract, "extract_tracks")):
        whole = getattr(stage, verb)
        monkeypatch.setattr(
            stage, verb, lambda *a, whole=whole, verb=verb: (made.update([verb]), whole(*a))[1]
        )
    run(home, monkeypatch)
    assert made == {"make_clip": 1, "extract_tracks": 1}
    for kind, files in before.items():
        assert files.items() <= content(home / "data" / kind / "films").items()
    assert table_of(home)["track_id"].nunique() == 3
    run(home, monkeypatch)  # nothing has changed
    assert made == {"make_clip": 1, "extract_tracks": 1}


def test_a_film_without_a_fish_is_left_out_unless_it_is_the_first(tmp_path, monkeypatch, capsys):
    (tmp_path / "films").mkdir()
    put_film(tmp_path / "films/1.mp4", swimming())
    rng = np.random.default_rng(7)
    noise = [np.rint(rng.normal(128, 9, SIZE)).astype(np.uint8) for _ in range(FRAMES)]
    put_film(tmp_path / "films/2.mp4", noise)
    run(tmp_path, monkeypatch)
    assert set(table_of(tmp_path)["frame"] // FRAMES) == {0}
    assert "2.mp4 is left out" in capsys.readouterr().err
    told = pd.read_csv(tmp_path / "data/extract/films.csv", dtype={"film": str})
    assert told["film"].tolist() == ["1", "2"]
    assert "fish" in told["left_out_because"][1]
    put_film(tmp_path / "films/0.mp4", noise)
    with pytest.raises(FinloopError, match=r"0\.mp4, the first film, cannot be followed"):
        run(tmp_path, monkeypatch)


def test_a_film_whose_tracks_fall_between_the_common_frames_brings_none(joined_run, tmp_path):
    shutil.copytree(joined_run / "data", tmp_path / "data", symlinks=True)
    folder = tmp_path / "data/extract"
    of_film = folder / "films/2-fine/tracks.parquet"
    table = load_table(of_film, tracks_schema(POINTS))
    save_table(of_film, table[table["frame"] % 2 == 1], tracks_schema(POINTS))
    first, second = join_extractions(tmp_path / "data/clip", folder, {})
    assert (second.name, second.rows, second.tracks) == ("2-fine", 0, 0)
    assert len(table_of(tmp_path)) == first.rows > 0


def test_where_no_film_can_be_read_each_is_named(tmp_path, monkeypatch):
    (tmp_path / "films").mkdir()
    for name in ("a.mp4", "b.mp4"):
        (tmp_path / "films" / name).write_bytes(b"no film")
    with pytest.raises(FinloopError, match=r"(?s)none of the films.*a\.mp4.*b\.mp4"):
        run(tmp_path, monkeypatch)
    assert not (tmp_path / "data/clip").exists()


def test_a_film_that_grows_while_it_is_read_is_refused(tmp_path, monkeypatch):
    path = put_film(tmp_path / "films", swimming())
    whole = stages.clip.make_clip

    def growing(*args):
        with path.open("ab") as file:
            file.write(b"more")
        return whole(*args)

    monkeypatch.setattr(stages.clip, "make_clip", growing)
    with pytest.raises(FinloopError, match="has changed while it was read"):
        run(tmp_path, monkeypatch)
    assert not (tmp_path / "data/clip").exists()
