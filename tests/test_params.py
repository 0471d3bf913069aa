"""Parameters: what is refused, by which name, when; and params.yaml is the composition of conf/."""

import ast
import os
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import chdir
from dataclasses import dataclass, fields, is_dataclass
from fractions import Fraction
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import numpy as np
import pytest
import yaml
from dvc.exceptions import DvcException
from dvc.utils.hydra import compose_and_dump
from hydra.core.override_parser.overrides_parser import OverridesParser
from pydantic import Field
from scratch import A_FILM, write_frames

import stages.stamps
from finloop.base.errors import FinloopError
from finloop.base.parameter_help import list_parameters
from finloop.base.settings import GONE, GROUPS, check_values, read_conf_values, settings, variants
from finloop.edit.modes import MODES
from finloop.io.movie import VideoWriter
from finloop.io.parameters import refusal_error
from finloop.report.headlines import HEADLINES
from stages import settings as door
from stages.compose import (
    compose_params,
    quoting_error,
    refuse_wrong_values,
    require_composed_params,
)
from stages.conflicts import find_conflicts
from stages.experiment import FOLDER
from stages.parameters import parameters_page, terminal_table
from stages.settings import LOCAL, STAMP, conf_stamp, list_problems, load_settings
from stages.stamps import file_stamp

ROOT = Path(__file__).parents[1]
TO_GIVE = {("clip", "file"): [f"clip.path={A_FILM}"]}  # what has no value in conf/
VARIANTS = {word: variants(word) for word in GROUPS}
EVERY = [(word, option) for word, options in VARIANTS.items() for option in options]


@dataclass(frozen=True)
class Toy:
    """A group small enough to see through."""

    size_px: Annotated[float, Field(gt=0)]
    fish: Annotated[int, Field(ge=1)]
    polarity: Literal["auto", "dark"]
    arena: list[float] | None
    start_s: float
    end_s: float

    def __post_init__(self) -> None:
        if self.end_s < self.start_s:
            raise ValueError("end_s should not be before start_s")


TOY: dict[str, Any] = {
    "size_px": 3, "fish": 1, "polarity": "auto", "arena": None, "start_s": 0.0, "end_s": 1.0,
}  # fmt: skip


def toy(**changed: Any) -> list[str]:
    return check_values("toy", {"default": Toy}, TOY | changed)[1]


@pytest.fixture(autouse=True)
def in_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def test_good_values_become_the_dataclass():
    group, none = check_values("toy", {"default": Toy}, TOY | {"arena": [1, 2.5]})
    assert none == []
    assert isinstance(group, Toy)
    assert (group.size_px, group.arena) == (3.0, [1.0, 2.5])


@pytest.mark.parametrize(
    ("changed", "problem"),
    [
        ({"size_px": -1.0}, "toy.size_px: should be greater than 0, got -1.0"),
        ({"size_px": float("nan")}, "toy.size_px: should be a finite number, got nan"),
        ({"size_px": float("inf")}, "toy.size_px: should be a finite number, got inf"),
        ({"size_px": "3"}, "toy.size_px: should be a valid number, got '3'; type toy.size_px=3"),
        ({"size_px": None}, "toy.size_px: should be a valid number, got None"),
        ({"fish": 2.0}, "toy.fish: should be a valid integer, got 2.0; type toy.fish=2"),
        ({"fish": True}, "toy.fish: should be a valid integer, got True"),
        ({"polarity": "drak"}, "toy.polarity: should be 'auto' or 'dark', got 'drak'; type toy.polarity=dark"),
        ({"fihs": 1}, "toy.fihs: unknown; did you mean toy.fish?"),
        ({"zzz": 1}, "toy.zzz: unknown; toy has " + ", ".join(TOY)),
        ({"start_s": 2.0}, "toy: end_s should not be before start_s"),
        ({"end_s": "???"}, "toy.end_s: has no value"),
    ],
)  # fmt: skip
def test_one_wrong_value_is_one_problem(changed, problem):
    assert toy(**changed) == [problem]


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("animate.path", "it is matching.path now"),
        ("animate.join", "it is network.join, loops.join, hybrid.join or matching.join now"),
        ("hybrid.path", "it is matching.path now"),
        ("matching.seconds", "it is animate.seconds now"),
        ("matching.from", "it is matching.uses now"),
        ("animate.sprites", "the modes network, loops and hybrid are the paper's; matching.uses "),
        ("export.shadow_darkness", "did you mean render.shadow_darkness?"),
    ],
)
def test_a_parameter_of_another_group_is_answered_by_its_name_there(name, told):
    word, _, key = name.partition(".")
    whole = made_values()[word]
    (problem,) = check_values(word, VARIANTS[word], whole | {key: 1})[1]
    assert problem.startswith(f"{name}: unknown; {told}")


@pytest.mark.parametrize("mode", ["nn", "fly", ["network"]])
def test_a_mode_that_there_is_not_is_answered_by_those_that_there_are(mode):
    values = made_values()["render"] | {"mode": mode}
    (problem,) = check_values("render", VARIANTS["render"], values)[1]
    assert all(f"'{one}'" in problem for one in MODES)
    assert problem.endswith("which is network now") == (mode == "nn")


def test_no_text_names_a_parameter_by_a_group_that_lacks_it():
    """What messages and docstrings advise can be taken as it is written; numbers are no advice."""
    keys = {
        word: {field.name for one in options.values() for field in fields(one)}
        | {headline.name for headline in HEADLINES.get(word, [])}
        for word, options in VARIANTS.items()
    }
    every, wrong = set().union(*keys.values(), GONE), []
    name = re.compile(rf"(?<![\w./-])({'|'.join(GROUPS)})\.([a-z_]+)(?=[^\w.]|\.?$|\. )")
    files = [*(ROOT / "finloop").rglob("*.py"), *(ROOT / "stages").rglob("*.py")]
    for path in files:
        for node in ast.walk(ast.parse(path.read_text())):
            # A word alone, such as a key in stages/experiment.py, is no advice.
            if isinstance(node, ast.Constant) and " " in str(node.value):
                wrong += [
                    f"{path.relative_to(ROOT)}: {word}.{key}"
                    for word, key in name.findall(str(node.value))
                    if key in every - keys[word]
                ]
    assert wrong == []


def test_every_problem_is_told_at_once():
    found = toy(size_px=-1, fish=0, polarity=3, arena=["x"], new=1)
    assert len(found) == 5
    message = str(refusal_error(found))
    assert message.startswith("5 parameters are refused:")
    assert all(problem in message for problem in found)


@pytest.mark.parametrize(
    ("options", "values", "problem"),
    [
        (["default"], 3, "toy: should be a group of parameters, got 3"),
        (["a", "b"], TOY, "toy.source: should be one of a, b, got None"),
        (["a", "b"], TOY | {"source": "c"}, "toy.source: should be one of a, b, got 'c'"),
    ],
)
def test_a_group_is_a_group_and_its_source_one_of_its_options(options, values, problem):
    assert check_values("toy", dict.fromkeys(options, Toy), values)[1] == [problem]


# --- the real groups


@cache  # composing takes Hydra a sixth of a second
def compose(*overrides: str) -> str:
    return compose_params(["~local", *overrides])


@cache
def made_values(*overrides: str) -> dict[str, Any]:
    return yaml.load(compose(*overrides), yaml.CSafeLoader)


def composed_values(word: str, option: str) -> dict[str, Any]:
    """Of a group; composed together with options of the other groups."""
    usual = yaml.load((ROOT / "conf/config.yaml").read_text(), yaml.CSafeLoader)["defaults"]
    others: dict[str, list[str]] = {}
    for one, other in EVERY:
        if {one: other} not in usual:
            others.setdefault(one, []).append(other)
    at = others[word].index(option) if option in others.get(word, ()) else None
    asked = [] if at is None else [(one, of[at]) for one, of in others.items() if at < len(of)]
    given = [(f"{one}={of}", *TO_GIVE.get((one, of), [])) for one, of in asked]
    return made_values(*chain.from_iterable(given))[word]


@pytest.mark.parametrize(("word", "option"), EVERY)
def test_every_option_composes_and_every_parameter_is_wanted_typed_and_finite(word, option):
    values = composed_values(word, option)
    group, none = check_values(word, VARIANTS[word], values)
    assert none == [] and isinstance(group, VARIANTS[word][option])
    hints = get_type_hints(VARIANTS[word][option])
    keys = {field.name for field in fields(VARIANTS[word][option])} - {"source"}
    numbers = {key for key in keys if hints[key] in (int, float)}
    without = {name: value for name, value in values.items() if name not in keys}
    found = check_values(word, VARIANTS[word], without)[1]
    assert sorted(found) == sorted(f"{word}.{key}: has no value" for key in keys)
    for wrong, of in (({"a": "group"}, keys), (float("nan"), keys), ("text", numbers)):
        found = check_values(word, VARIANTS[word], values | dict.fromkeys(of, wrong))[1]
        refused = {re.match(rf"{word}\.(\w+)", problem)[1] for problem in found}
        assert refused == of, f"{word} takes {wrong!r} for {of - refused}"


@pytest.mark.parametrize(("word", "option"), EVERY)
def test_a_group_is_flat_and_its_values_stand_in_conf_alone(word, option):
    declared = fields(VARIANTS[word][option])
    for field in declared:
        assert not is_dataclass(field.type)
        assert repr(field.default) == repr(field.default_factory), f"{field.name} has a default"
    assert sorted(read_conf_values(word, option)) == sorted(field.name for field in declared)


def test_every_value_in_conf_has_its_meaning_and_range_above_it():
    for entry in list_parameters():
        name = f"conf/{entry.word}/{entry.option}.yaml: {entry.name}"
        assert entry.meaning, f"{name} has no meaning; write a sentence above it"
        wanted = f"[unit, {entry.range}]"
        assert entry.brackets.endswith(entry.range), f"{name} should end with {wanted}"


def test_parameters_are_few():
    """On average of a group; of `clip` some stand in several variants.

    So a stage and a mode may bring their own. What switches an exporter on is free.
    """
    names = {(one.word, one.name) for one in list_parameters()}
    switches = {
        (one.word, one.name) for one in list_parameters()
        if one.word == "export" and one.range == "true or false"
    }  # fmt: skip
    assert len(names - switches) <= 8.5 * len(GROUPS)
    assert sum(word == "sprites" for word, _ in names) <= 12
    assert sum(word == "matching" for word, _ in names) <= 35


def test_a_table_of_parameters_has_value_range_and_meaning(capsys):
    text = terminal_table("gateways", 60)
    assert "gateways.distance_threshold=" in text and "[natural steps, > 0]" in text
    assert max(map(len, text.splitlines())) <= 90
    with pytest.raises(FinloopError, match="no group of parameters gatways"):
        terminal_table("gatways", 60)
    assert (ROOT / "docs/parameters.md").read_text(encoding="utf-8") == parameters_page(
        list_parameters()
    )


def test_old_names_are_answered_by_the_new_ones():
    """And a parameter that is a constant now says so; no new name is a name that has gone."""
    for word, option in EVERY:
        group = VARIANTS[word][option]
        now = {field.name for field in fields(group)}
        for old, new in getattr(group, "RENAMED", {}).items():
            is_phrase = " " in new
            assert old not in now and hasattr(group, new) | (new in now) | is_phrase, (word, old)
            values = composed_values(word, option) | {old: 1}
            (problem,) = check_values(word, VARIANTS[word], values)[1]
            constant = f"it is a constant now, {group.__name__}.{new}"
            told = new if is_phrase else f"it is {word}.{new} now" if new in now else constant
            assert problem == f"{word}.{old}: unknown; {told}"
    whole = composed_values("sprites", "default") | {"drift_deg": 6.0}
    (problem,) = check_values("sprites", VARIANTS["sprites"], whole)[1]
    assert problem.endswith("it is a constant now, SpritesSettings.drift_deg")


def test_a_library_gets_its_parameters_without_hydra_and_params_yaml(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    usual = settings("extract")
    (other,) = {settings("extract", noise_sigmas=6).noise_sigmas} - {usual.noise_sigmas}
    assert other == 6.0 and type(other) is float
    carp = settings("clip", source="carp", frames=50)
    assert type(carp) is VARIANTS["clip"]["carp"] and carp.frames == 50
    for wrong, named in (({"nois_sigmas": 1.0}, "did you mean extract.noise_sigmas"),
                         ({"min_track_frames": 3.5}, "extract.min_track_frames: should be a valid integer")):  # fmt: skip
        with pytest.raises(FinloopError, match=named):
            settings("extract", **wrong)
    with pytest.raises(FinloopError, match=r"clip\.source: should be"):
        settings("clip", source="goldfish")


def test_conf_holds_the_options_and_no_others_and_params_yaml_is_its_composition():
    found = {(path.parent.name, path.stem) for path in (ROOT / "conf").glob("*/*.yaml")}
    assert {pair for pair in found if pair[0] not in (FOLDER, "local")} == set(EVERY)
    require_composed_params([])


def test_the_whole_must_be_there_and_nothing_else():
    whole = dict(made_values())
    assert list_problems(whole) == []
    assert list_problems(whole | {"xyz": {"key": 1}}) == ["xyz: unknown"]
    del whole["extract"]
    assert all(problem.startswith("extract.") for problem in list_problems(whole))


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("clip=typo", "clip/typo"),
        ("clpi=carp", "clpi"),
        ("+clip.nosuch=1", "clip.nosuch: unknown"),
        ("+experiment=paper", "experiment/paper"),
        ("+new.key=1", "new: unknown"),
        ("~extract", "extract."),
        ("clip=file", "clip.path: has no value"),
        ("clip=carp clip.seed=abc", "clip.seed"),
        ("clip=carp clip.frame_rate_hz=-1e9", "clip.frame_rate_hz: should be"),
        ("clip=[", "clip=[ is no `key=value`"),
    ],
)
def test_an_override_is_refused_by_name_while_composing(override, named):
    with pytest.raises(FinloopError) as refusal:
        compose_params(override.split())
    assert named in refusal.value.came
    assert "raised while" not in refusal.value.came  # it is our message, not one about it
    assert "To append" not in refusal.value.came  # Hydra's advice would be refused as well


def test_dvc_prints_a_refusal_as_it_is(tmp_path):
    arguments = str(Path("conf").absolute()), None, "config", str(Path.cwd()), ["bpn.epochs=many"]
    with pytest.raises(DvcException) as caught:  # any other error is unexpected to DVC
        compose_and_dump(str(tmp_path / "params.yaml"), *arguments)
    assert str(caught.value).startswith("a parameter is refused:\n    bpn.epochs: should be")
    assert caught.value.__cause__ is None  # DVC would print its text, too


# --- params.yaml against conf/


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """A folder with conf/ and its params.yaml, and it is the current one."""
    shutil.copytree(ROOT / "conf", tmp_path / "conf")
    (tmp_path / LOCAL).unlink(missing_ok=True)
    (tmp_path / "params.yaml").write_text(compose())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_an_edited_conf_is_never_passed_over(elsewhere):
    with (elsewhere / "conf/config.yaml").open("a") as file:
        file.write("# edited\n")
    with pytest.raises(FinloopError, match="make params"):
        load_settings("extract")


def test_load_lists_the_problems_of_its_group(elsewhere):
    path = elsewhere / "params.yaml"
    values = yaml.safe_load(path.read_text())
    values["extract"] |= {"new": 1, "other": 2}
    path.write_text(yaml.safe_dump(values))
    with pytest.raises(FinloopError, match=r"2 parameters are refused:\s+extract.new: unknown"):
        load_settings("extract")


@pytest.mark.parametrize("text", [None, "", "- 1\n", "a: [", "\x00\xff"])
def test_a_broken_params_yaml_is_one_message(elsewhere, text):
    path = elsewhere / "params.yaml"
    if text is None:
        path.unlink()
    else:
        path.write_text(text, encoding="latin-1")
    with pytest.raises(FinloopError, match=r"params.yaml (cannot be read|holds no parameters)"):
        door.read_params()


def test_the_stamp_sees_names_and_contents_but_no_line_ends_and_no_experiments(tmp_path):
    conf = tmp_path / "conf"
    conf.mkdir()
    (conf / "a.yaml").write_bytes(b"x: 1\ny: 2\n")
    first = conf_stamp(conf)
    (conf / "notes.txt").write_text("not configuration")
    (conf / FOLDER).mkdir()
    (conf / FOLDER / "new.yaml").write_text("x: 3")
    (conf / "a.yaml").write_bytes(b"x: 1\r\ny: 2\r\n")
    assert conf_stamp(conf) == first
    (conf / "b.yaml").write_bytes(b"")
    second = conf_stamp(conf)
    (conf / "b.yaml").rename(conf / "c.yaml")
    third = conf_stamp(conf)
    (conf / "a.yaml").write_bytes(b"x: 1\ny: 3\n")
    assert len({first, second, third, conf_stamp(conf)}) == 4


# --- stamps of films and tracks


def film_stamp(clip):
    return file_stamp("film_stamp", {"clip": clip})


def tracks_stamp(clip, extract):
    return file_stamp("tracks_stamp", {"clip": clip, "extract": extract})


def path_stamp(matching):
    return file_stamp("path_stamp", {"matching": matching})


def test_a_film_or_tracks_that_have_changed_have_another_stamp(elsewhere):
    folder = elsewhere / "films"
    folder.mkdir()
    clip = {"source": "file", "path": str(folder)}
    tracks = {"tracks_path": "{folder}/{name}.h5"}
    assert film_stamp({"source": "carp"}) is None
    assert film_stamp(clip | {"path": str(folder / "none.mp4")}) is None
    seen = []
    for name, content in (("a", b"1"), ("b", b"2"), ("b", b"22")):
        (folder / f"{name}.mp4").write_bytes(content)
        (folder / f"{name}.h5").write_bytes(content)
        seen.append(film_stamp(clip))
    assert len({*seen}) == 3 and None not in seen
    several = clip | {"path": [str(folder / "a.mp4"), {"path": str(folder / "b.mp4")}]}
    assert film_stamp(several) == film_stamp(clip) == seen[-1]
    before = tracks_stamp(several, tracks)
    (folder / "b.h5").write_bytes(b"333")
    assert tracks_stamp(several, tracks) != before
    assert tracks_stamp(several, {"tracks_path": None}) is None


def test_a_mask_that_was_drawn_anew_has_another_stamp(elsewhere):
    film, mask = elsewhere / "a.mp4", elsewhere / "mask.png"
    film.write_bytes(b"1")
    clip = {"source": "file", "path": str(film), "arena": str(mask)}
    seen = [film_stamp(clip)]  # there is no mask
    for content in (b"1", b"22"):
        mask.write_bytes(content)
        seen += [film_stamp(clip), film_stamp(clip | {"path": [clip], "arena": None})]
    assert seen[0] is None and seen[1] == seen[2] != seen[3] == seen[4]
    assert film_stamp(clip | {"arena": [1.0, 2.0, 3.0]}) == film_stamp(clip | {"arena": None})


def test_a_path_that_has_changed_has_another_stamp(elsewhere):
    file = elsewhere / "way.csv"
    seen = []
    for text in ("x,y\n", "x,y\n1,2\n"):
        file.write_text(text)
        seen.append(path_stamp({"path": str(file)}))
    assert None not in seen and len({*seen}) == 2
    for none in (None, "track:8", str(elsewhere / "none.svg")):
        assert path_stamp({"path": none}) is None
    with chdir(ROOT):
        whole = yaml.safe_load(compose_params(["~local", f"matching.path={file}"]))
    assert whole["path_stamp"] == seen[-1]


def test_the_stamp_in_params_yaml_is_renewed_and_nothing_else(elsewhere):
    film, params = elsewhere / "film.mp4", elsewhere / "params.yaml"
    film.write_bytes(b"1")
    values = yaml.safe_load(params.read_text()) | {"clip": {"source": "file", "path": str(film)}}
    values["matching"] |= {"path": str(film)}
    params.write_text(yaml.safe_dump(values, sort_keys=False))
    stages.stamps.main()
    once = yaml.safe_load(params.read_text())
    stamps = {
        "film_stamp": film_stamp(values["clip"]),
        "path_stamp": path_stamp(values["matching"]),
    }
    assert None not in stamps.values() and once == values | stamps
    film.write_bytes(b"22")
    stages.stamps.main()
    assert yaml.safe_load(params.read_text())["film_stamp"] not in (None, once["film_stamp"])
    before = params.read_text()
    film.unlink()
    with pytest.raises(FinloopError, match=f"nothing at {film}") as refusal:
        stages.stamps.main()
    assert "dvc repro" in refusal.value.do and params.read_text() == before


# --- conf/local/: one's own film and settings


COMPOSE = """
import shutil, sys
from stages.compose import main
for argument in ([], ["--check"], ["~local"]):
    sys.argv[1:] = argument
    main()
    if not argument:
        shutil.copyfile("params.yaml", "own.yaml")
"""


@pytest.fixture(scope="module")
def own_params(tmp_path_factory) -> str:
    """params.yaml of a repository in which the example of conf/local/ is in use."""
    root = tmp_path_factory.mktemp("own")
    for name in ("conf", "hydra_plugins"):
        shutil.copytree(ROOT / name, root / name)
    (root / "data").symlink_to(ROOT / "data")
    example = (ROOT / f"{LOCAL}.example").read_text(encoding="utf-8")
    (root / LOCAL).write_text(example.replace("/some/where.mp4", str(A_FILM)), encoding="utf-8")
    # A process of its own: the plugin that is loaded here looks at the repository's own conf/.
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-c", COMPOSE], cwd=root, env=env, check=True)
    text = (root / "own.yaml").read_text()
    made = yaml.safe_load((root / "params.yaml").read_text())
    assert made | {STAMP: 0} == yaml.safe_load(compose()) | {STAMP: 0}
    return text


@pytest.fixture
def own_folder(own_params, elsewhere):
    """The same conf/ and params.yaml, for this process."""
    example = Path(f"{LOCAL}.example").read_text(encoding="utf-8")
    LOCAL.write_text(example.replace("/some/where.mp4", str(A_FILM)), encoding="utf-8")
    (elsewhere / "params.yaml").write_text(own_params)
    return elsewhere


def test_ones_own_film_and_settings_are_composed_every_time(own_folder):
    clip, extract = load_settings("clip"), load_settings("extract")
    assert (clip.source, clip.path) == ("file", str(A_FILM))
    assert extract == settings("extract", noise_sigmas=6.0)
    assert not subprocess.run(["git", "check-ignore", "-q", LOCAL], cwd=ROOT).returncode


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("clip: {seed: 5}", "begin with the line: # @package _global_"),
        ("# @package _global_\nclip: carp", "local/default.yaml has 'carp' where a group"),
        ("# @package _global_\nclip.seed: 5", "in a file write clip: {seed: value}"),
        ("# @package _global_\nclop: {seed: 5}", "did you mean clip?"),
        ("# @package _global_\ndefaults: [/clip: carp]", "'- override /clip: carp' below `def"),
        ("clip: [5", "local/default.yaml, line 1, column 9: expected ',' or ']'"),
        (
            "clip: !!python/object:os.system {}",
            "default.yaml, line 1, column 7: could not determine",
        ),
        ("clip: " + "[" * 100_000, "local/default.yaml: it is nested more than 50 levels deep"),
    ],
)
def test_a_mistake_in_ones_own_settings_is_answered_by_what_to_write(own_folder, text, answer):
    LOCAL.write_text(text)
    with pytest.raises(FinloopError) as refusal:
        compose_params([])
    assert answer in str(refusal.value)


def test_settings_in_another_coding_are_named(own_folder):
    LOCAL.write_bytes("# Größe\n".encode("latin-1"))
    with pytest.raises(FinloopError, match=r"local/default\.yaml: 'utf-8' codec can't decode"):
        compose_params([])


def test_a_conf_that_is_no_yaml_is_named_before_anything_is_composed(tmp_path):
    for name in ("conf", "finloop", "stages"):  # of a working copy
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "conf/config.yaml").write_text("defaults: [\n")
    (tmp_path / "dvc.yaml").touch()
    done = subprocess.run(
        [sys.executable, "-m", "stages.clip"], cwd=tmp_path, text=True, capture_output=True,
        env=os.environ | {"PYTHONPATH": ""},
    )  # fmt: skip
    assert done.returncode == 1 and "conf/config.yaml, line 2, column 1: " in done.stderr
    assert "Traceback" not in done.stderr and "  wanted: YAML" in done.stderr


def test_an_edit_of_ones_own_settings_is_never_passed_over(own_folder):
    LOCAL.write_text(LOCAL.read_text().replace("6.0", "7.0"))
    for change in (lambda: None, LOCAL.unlink):
        change()
        with pytest.raises(FinloopError, match="make params"):
            load_settings("extract")


def test_a_colleague_without_ones_own_settings_is_told_to_copy_the_file(own_folder):
    LOCAL.unlink()
    with pytest.raises(FinloopError, match=r"(?s)which is not here.*copy it") as refusal:
        load_settings("extract")
    assert str(LOCAL) in refusal.value.came


def test_a_temporary_experiment_has_ones_own_settings_without_the_file(own_folder, monkeypatch):
    LOCAL.unlink()
    monkeypatch.setenv("DVC_ROOT", str(ROOT))
    assert load_settings("extract").noise_sigmas == 6.0
    with (own_folder / "conf/config.yaml").open("a") as file:
        file.write("# edited\n")
    with pytest.raises(FinloopError, match="make params"):
        load_settings("extract")


def test_where_the_file_is_not_its_values_are_checked(own_folder, capsys):
    LOCAL.unlink()
    require_composed_params([])
    assert str(LOCAL) in capsys.readouterr().err
    path = own_folder / "params.yaml"
    path.write_text(path.read_text().replace("noise_sigmas: 6.0", "noise_sigmas: -6.0"))
    with pytest.raises(FinloopError, match=r"extract\.noise_sigmas: should be greater"):
        require_composed_params([])


# --- what cannot work together


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("clip=carp clip.frames=5", "clip.frames: 5 frames, and a track has at least 10"),
        ("clip=file clip.path=/gone.mp4", "clip.path: there is nothing at /gone.mp4"),
        ("clip=file clip.path=/gone/*.mp4", "matches no file"),
        ("clip=file clip.path=README.md", "README.md is text, not a film"),
        (f"clip=file clip.path={A_FILM} clip.arena=/gone.png", "clip.arena: there is nothing"),
        ("matching.path=/gone.csv", "matching.path: there is nothing at /gone.csv"),
        ("matching.path=[track:1,track:2]", "matching.path: 2 paths for 1 fish"),
        ("matching.follow_pairs=[[2,1]]", "[2, 1] names fish 2 of 1"),
        ("matching.fish=2 matching.follow_pairs=[[2,1],[1,2]]", "fish 2 follows fish 1 follows fish 2"),
        ("animate.goals=[[20,30]]", "type animate.goal_unit=px"),
        ("animate.goals=[[0,1,0]]", "animate.goals: [0, 1, 0] is not [x, y]"),
        ("extract.tracks_path=gone.h5", "extract.tracks_path: there is nothing at"),
        ("morph.last_drawing=gone.svg", "morph.last_drawing: there is nothing"),
        ("gait.regions=gone gait.regions_rate_hz=30", "gait.regions: there is nothing"),
        ("render.mode=retarget", "render.mode: retarget shows retarget.tracks, which names none"),
    ],
)  # fmt: skip
def test_what_cannot_work_is_refused_before_a_stage_runs(override, named):
    values = values_with(override)
    assert list_problems(values) == []  # each value alone is right
    assert any(named in problem for problem in find_conflicts(values))
    if "clip=" not in override:  # a sweep's run is refused alike, without composing it
        with pytest.raises(FinloopError, match=re.escape(named)):
            refuse_wrong_values(made_values(), override.split())


def test_a_run_of_a_sweep_is_refused_without_composing_it_unless_it_names_no_parameter():
    values = made_values()
    refuse_wrong_values(values, ["bpn.epochs=3", "features.turn_threshold_deg=auto"])
    with pytest.raises(FinloopError, match=r"bpn\.epochs: should be greater"):
        refuse_wrong_values(values, ["bpn.epochs=-3"])
    looked_up = "bpn.epochs=${bpn.seed}"
    for override in ("bpn.epohcs=3", "clip=file", "+bpn.new=3", "nobody.epochs=3", looked_up):
        with pytest.raises(KeyError):
            refuse_wrong_values(values, [override])
    assert values == made_values() and values["bpn"]["epochs"] == 200


def test_a_range_of_time_is_in_the_film_and_pictures_have_a_rate(tmp_path):
    film, pictures = tmp_path / "film.avi", tmp_path / "pictures"
    write_frames(VideoWriter(film, 32, 32, Fraction(10)), np.zeros((30, 32, 32), np.uint8))
    shutil.copytree(ROOT / "docs/pictures", pictures)
    for typed, named in {
        f"clip.path={film} clip.start_s=5": "clip.start_s: 5 s, and",
        f"clip.path={film} clip.end_s=0.5": "5 frames, and a track has at least 10",
        f"clip.path={pictures}": "give it: clip.frame_rate_hz=25",
    }.items():
        (problem,) = find_conflicts(values_with(f"clip=file {typed}"))
        assert named in problem
    with pytest.raises(FinloopError, match=r"clip\.start_s: 5 s, and"):  # composing looks for them
        compose_params(["~local", "clip=file", f"clip.path={film}", "clip.start_s=5"])


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (["animate.goals=[[0.1,", "0.2]]"], "-S 'animate.goals=[[0.1, 0.2]]'"),
        (["matching.path=/a b/c=d.csv"], "-S 'matching.path=\"/a b/c=d.csv\"'"),
        (["clip=file", "clip.path=/a(1).mp4"], """S="'clip=file' 'clip.path=\\"/a(1).mp4\\"'\""""),
        (["clip=file", "clip.path=/my", "film.mp4", "bpn.epochs=3"],
         "-S 'clip=file' -S 'clip.path=/my film.mp4' -S 'bpn.epochs=3'"),
        (["bpn.hidden_units=5,10"], 'make sweep S="bpn.hidden_units=5,10"'),
        (["bpn.learning_rate=0,5"], "for a decimal point: bpn.learning_rate=0.5"),
        (["bpn.epochs", "=", "3"], "-S 'bpn.epochs=3'"),
        (["bpn=3"], "`make params S=help=bpn` prints"),
        (["clip=my.mp4"], "type clip=file clip.path=my.mp4"),
        (["clip=crap"], "type clip=carp"),
        (["bp.epochs=3"], "make params S=help=bpn"),
    ],
)  # fmt: skip
def test_the_line_to_type_is_named_where_quotes_are_missing(typed, said):
    with pytest.raises(FinloopError) as refusal:
        compose_params(typed)
    assert said in refusal.value.do


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("features.turn_threshold_deg=25deg", "type features.turn_threshold_deg=25"),
        ("features.turn_threshold_deg=None", "type features.turn_threshold_deg=auto"),
        ("animate.seconds=2min", "type animate.seconds=120"),
        ("animate.seconds=1:30", "type animate.seconds=90"),
        ("animate.goals=[0.2,0.3]", "type 'animate.goals=[[0.2,0.3]]'"),
        ("extract.min_contrast_ratio=30%", "type extract.min_contrast_ratio=0.3"),
        ("extract.min_contrast_ratio=30", "type extract.min_contrast_ratio=0.3"),
        ("matching.fish=3.0", "type matching.fish=3"),
        ("render.mode=Hybrid", "type render.mode=hybrid"),
        ("distance.max_distance_steps=none", "type distance.max_distance_steps=null"),
        ("clip=carp clip.colour=yes", "type clip.colour=true"),
        ("clip.path=/a.mp4", "type clip=file clip.path=/a.mp4"),
    ],
)
def test_a_mistyped_value_is_answered_by_the_line_to_type(typed, said):
    (problem,) = list_problems(values_with(typed))
    assert problem.endswith(said) and compose_is_right(said.removeprefix("type "))


def values_with(typed: str) -> dict[str, Any]:
    """Composed values with others laid over them: one composition of conf/ for many tests."""
    options, plain = [], []
    for one in typed.split():
        (plain if "." in one.partition("=")[0] else options).append(one)
    given = [f"clip.path={A_FILM}"] if "clip=file" in options else []
    values = dict(made_values(*options, *given))
    for override in plain:
        parsed = OverridesParser.create().parse_override(override)
        word, _, key = parsed.key_or_group.partition(".")
        values[word] = {**values[word], key: parsed.value()}
    return values


def compose_is_right(line: str) -> bool:
    """Whether a line to type is `key=value` in each of its words."""
    return quoting_error(shlex.split(line)) is None


def test_a_whole_number_is_a_number():
    values = yaml.safe_load(compose_params(["retarget.scale=25", "render.webp_seconds=2"]))
    assert (values["retarget"]["scale"], values["render"]["webp_seconds"]) == (25, 2)
