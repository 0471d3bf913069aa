"""The pipeline as DVC sees it: its graph is true, and every way to run it, or to stop it, works."""

import ast
import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pandas as pd
import psutil
import pytest
import yaml
from browser import chromium, visit
from conftest import PATIENCE_S, TINY_CARP, Copy, alive, wait_for
from playwright.sync_api import expect
from scratch import content
from tiny_run import plot_sources

from benchmarks.pipeline import does_read
from finloop.base.settings import GROUPS, WORDS
from finloop.edit.modes import MODES
from finloop.report.figures import CHAPTERS
from stages import code
from stages.origins import note_origins, output_paths, paths_to_note
from stages.previews import choose_mode, draw_previews
from stages.settings import FILES

ROOT = Path(__file__).parents[1]
PIPELINE = yaml.safe_load((ROOT / "dvc.yaml").read_text())
SHIPPED = ("data/drawings", "data/gaits")  # of data/, what no stage makes
STAGES: dict[str, Any] = PIPELINE["stages"]
PLOTS = [stage for stage in STAGES if stage.startswith("plots-")]
PLAYED = [f"modes-{mode}" for mode in MODES]
FIRST = ("code", "params")  # of no words of their own


# --- dvc.yaml against the code


@cache
def files(stage: str) -> set[str]:
    """The files of the program that a stage runs."""
    return {line.split()[1] for line in code.file_list_text(stage).splitlines()}


def names(entries: list[Any]) -> dict[str, dict[str, Any]]:
    """dvc.yaml's `path` or `path: {flags}` as path → flags."""
    flat: dict[str, dict[str, Any]] = {}
    for entry in entries:
        flat |= entry if isinstance(entry, dict) else {entry: {}}
    return flat


def outputs(word: str) -> dict[str, dict[str, Any]]:
    stage = STAGES[word]
    return names([*stage.get("outs", []), *stage.get("metrics", []), *stage.get("plots", [])])


DRAWN = {stage: import_module(code.stage_module(stage)).MODULES for stage in PLOTS}
"""What stages that draw run in processes of their own."""


@pytest.mark.parametrize("word", STAGES)
def test_a_stage_depends_on_its_checked_parameters_and_the_files_that_it_runs(word):
    deps = STAGES[word]["deps"]
    assert outputs("params").keys() == {"data/params"}
    first = {"code": ["finloop", "stages"], "params": ["data/code"]}
    first_of_word = first.get(word, [f"data/params/{word}.yaml"])
    assert deps[: len(first_of_word)] == first_of_word
    assert len(deps) == len(set(deps)), "twice under deps"
    assert {"stages/run.py", f"stages/{word.replace('-', '/')}.py"} <= files(word)


@cache
def waited_for(word: str, mode: str) -> set[str]:
    """The paths that a stage's `deps` stand for, with all that is noted in them.

    mode: the one that it shows, as `${render.mode}` in a path.
    """
    first = {output_paths(stage)[0]: stage for stage in STAGES.values()}
    todo = [re.sub(r"\$\{.*\}", mode, path) for path in STAGES[word]["deps"]]
    found = set[str]()
    while todo:
        found.add(path := todo.pop())
        inside = [out for out in first if does_read(path, out) and out.startswith(path)]
        found |= {*inside}
        todo += {one for out in inside for one in paths_to_note(first[out])} - found
    return found


@cache
def members_used(file: str) -> set[str]:
    """The members of a `project` that a file uses."""
    return code._members_of(ast.parse((ROOT / file).read_text()), "project")


def loaded_words(word: str) -> set[str]:
    """The stages whose folders a stage loads, by the members of `Project` that it uses."""
    members, mine = code.project_members(), [one for one in files(word) if one.endswith(".py")]
    todo = set().union(*map(members_used, mine)) & members.keys()
    used = set[str]()
    while todo:
        used.add(name := todo.pop())
        todo |= (code._members_of(members[name], "self") & members.keys()) - used
    texts = {
        node.value for name in used for node in ast.walk(members[name])
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }  # fmt: skip
    return {text.partition("/")[0] for text in texts if text.partition("/")[0] in WORDS}


@pytest.mark.parametrize("word", [word for word in STAGES if word not in FIRST])
def test_a_stage_reads_only_what_it_waits_for(word):
    own = {Path(out).parts[1] for out in outputs(word)} | {word}
    loaded = loaded_words(word) - own - {"animate", *MODES}
    for mode in (*MODES, "retarget"):
        waits = waited_for(word, mode)
        for other in loaded:
            assert any(path.startswith(f"data/{other}") for path in waits), (other, mode)


def test_what_a_folder_was_made_from_is_noted_in_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    notes = []
    for number in (1, 2):
        for path in ("data/features/a.txt", "data/pose/b.txt", "reports/pose/metrics.json"):
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            Path(path).write_text(str(number * path.startswith("data/features")))
        note_origins("features")
        note_origins("pose")
        notes.append(Path("data/pose/finloop-checksums.yaml").read_text())
    first, second = map(yaml.safe_load, notes)
    assert first["files"] == second["files"]
    assert {*first["files"]} == {"b.txt", "../../reports/pose/metrics.json"}
    assert {*first["made_from"]} == {"../features/finloop-checksums.yaml"}
    assert first["made_from"] != second["made_from"]
    note_origins("no stage")  # a program beside the pipeline notes nothing


def test_dvc_lock_stays_short():
    """Of a stage it has four lines, of each file four, of each folder five: 30 on average."""
    paths = [path for word in STAGES for path in (*STAGES[word]["deps"], *outputs(word))]
    lines = 2 + 4 * len(STAGES) + sum(4 if Path(path).suffix else 5 for path in paths)
    assert lines <= 30 * len(STAGES)


def test_a_stage_has_six_places_and_a_mode_two():
    """Those that docs/new-stage.md and docs/new-mode.md list."""

    def places(page: str, begin: str, end: str) -> list[str]:
        part = (ROOT / "docs" / page).read_text().partition(begin)[2].partition(end)[0]
        return re.findall(r"^\| `([\w./-]+)` \|", part, re.MULTILINE)

    of_stage = places("new-stage.md", "## The six places", "```yml")
    assert len(of_stage) == 6
    assert all(re.search(r"\bgateways\b", (ROOT / one).read_text()) for one in of_stage)
    of_mode = places("new-mode.md", "## 3. Add the mode", "```yml")
    assert len(of_mode) == 2 and all("matching" in (ROOT / one).read_text() for one in of_mode)


def test_files_of_a_stage_are_those_that_it_imports_by_imports_inside_functions_and_by_name():
    assert "finloop/io/table.py" in code.imported_files("stages/run.py")  # inside a function
    assert {"stages/__init__.py", "stages/run.py"} == code.module_files("stages.run")
    assert {"stages/plots/bpn.py", "finloop/plots/bpn.py"} <= files("plots-motion")  # by a string
    assert {"finloop/drawn/carp/settings.py", "finloop/edit/modes.py"} <= files("params")
    assert "finloop/report/report.html.j2" in files("report")
    assert "finloop/verbs.py" not in files("loops")


def test_another_digest_of_a_file_is_another_list(monkeypatch):
    before = code.file_list_text("loops")
    monkeypatch.setattr(code, "hash_file", lambda file: file[-5:-3])
    assert code.file_list_text("loops") != before


def test_a_changed_search_for_loops_reruns_no_stage_that_shows_none():
    users = {word for word in STAGES if "finloop/loops/search.py" in files(word)}
    assert users - {*PLAYED} == {"loops", "plots-motion"}
    assert users & {"modes-network", "modes-matching"} == set()
    penalty = {word for word in STAGES if "finloop/plan/search.py" in files(word)}
    assert penalty & {"render", "tank", "export", "report", "realism"} == set()


def test_no_module_is_loaded_that_is_not_in_the_list():
    """In a process of its own, which imports the stage: of `Project`, only what it uses."""
    program = "import sys, stages.export\nfor one in [*sys.modules.values()]: print(getattr(one, '__file__', None))"
    text = subprocess.check_output([sys.executable, "-c", program], cwd=ROOT, text=True)
    lines = [line for line in text.splitlines() if line.startswith(str(ROOT))]
    ours = {Path(line).relative_to(ROOT).as_posix() for line in lines}
    loaded = {path for path in ours if path.startswith(("finloop/", "stages/"))}
    assert len(loaded) > 10 and loaded <= files("export")


def test_a_stage_depends_on_the_parts_of_a_project_that_it_uses(tmp_path):
    use = "from finloop.project import Project\n"

    def rooms(number: int, text: str) -> set[str]:
        path = tmp_path / f"{number}.py"  # another one each time, for what is found is kept
        path.write_text(use + text)
        found = code.imported_files(str(path)) - {code.PROJECT, code.LAZY}
        return {file.split("/")[1] for file in found}

    assert rooms(0, "") == rooms(1, "project.rate_hz, project.other, p.size") == set()
    assert rooms(2, "project.features") == rooms(3, "Project().features") == {"features"}
    assert rooms(4, "a.project.poses") == {"features", "pose"}  # one uses the other
    forecast = rooms(5, "project.forecast_sampler")
    assert "forecast" in forecast and "bpn" not in forecast
    assert rooms(6, "project.gallery(drawn)") == {"edit", "render"}


def test_a_project_is_called_project_wherever_dependencies_are_read():
    every = {file for word in STAGES for file in files(word) if file.endswith(".py")}
    users = {file for file in every if code.PROJECT in code.imported_files(file)}
    assert "stages/animate.py" in users
    for file in users - {code.PROJECT}:
        assert names_of_projects(ast.parse((ROOT / file).read_text())) <= {"project"}, file
    text = "a = Project()\nwith Project() as b: pass\ndef f(c: Project, d=Project()): pass"
    assert names_of_projects(ast.parse(text)) == {"a", "b", "c"}


def names_of_projects(tree: ast.AST) -> set[str]:
    """What a file calls its projects: in assignments, `with` statements and arguments."""

    def is_project(node: ast.AST | None) -> bool:
        node = node.func if isinstance(node, ast.Call) else node
        return isinstance(node, ast.Name) and node.id == "Project"

    found = set()
    for node in ast.walk(tree):
        bound: list[ast.AST | None] = []
        if isinstance(node, ast.Assign | ast.NamedExpr) and is_project(node.value):
            bound = [*node.targets] if isinstance(node, ast.Assign) else [node.target]
        elif isinstance(node, ast.withitem) and is_project(node.context_expr):
            bound = [node.optional_vars]
        elif isinstance(node, ast.arg | ast.AnnAssign) and is_project(node.annotation):
            bound = [node]
        for one in filter(None, bound):
            found.add(ast.unparse(one).partition(":")[0])
    return found


def test_a_project_imports_only_files_at_its_top_and_rooms_inside_its_members():
    at_top = code.imported_files(code.PROJECT)
    assert {file.split("/")[1] for file in at_top - {code.LAZY}} == {"base", "io"}
    tree = ast.parse((ROOT / code.PROJECT).read_text())
    top = [node for node in tree.body if not isinstance(node, ast.If)]
    everywhere = {one for node in top for one in code.files_of_imports([*ast.walk(node)])}
    members = code.project_members().values()
    inside = {one for member in members for one in code.files_of_imports([*ast.walk(member)])}
    assert everywhere == at_top | inside  # top: without the imports of type checkers


def test_a_changed_picture_computes_nothing_anew_and_is_drawn_by_one_stage():
    draws = ("finloop/plots/parts.py", "finloop/plots/bpn.py", "stages/plots/bpn.py")
    assert {word for word in STAGES if files(word) & {*draws}} == {*PLOTS}
    for stage in PLOTS:
        (folder,) = outputs(stage)
        words = {module.rpartition(".")[2] for module in DRAWN[stage]}
        words -= {"findings"}  # they stand beside their sentences
        shown = [Path(one.path).parts for chapter in CHAPTERS for one in chapter.figures]
        drawn = {parts[1] for parts in shown if parts[0] == Path(folder).name}
        assert drawn == words
    drawn = [module.rpartition(".")[2] for stage in PLOTS for module in DRAWN[stage]]
    modules = {path.stem for path in (ROOT / "stages/plots").glob("*.py")}
    others = {"__init__", "__main__", "draw", *(stage.removeprefix("plots-") for stage in PLOTS)}
    assert sorted(drawn) == sorted(modules - others)  # each is drawn by one stage


@pytest.mark.parametrize("word", STAGES)
def test_a_stage_is_one_word_everywhere(word):
    stage = STAGES[word]
    assert stage["cmd"] == f"exec python -m {code.stage_module(word)}"  # exec: see stages/run.py
    if word in (*PLOTS, *FIRST):
        return
    groups = [group.partition(".")[0] for group in stage["meta"]["params"]]
    own, *others = groups  # others: of stages whose work it does again, or it works for
    if word in PLAYED:
        mode = word.removeprefix("modes-")
        assert own == mode or mode not in WORDS
        assert {f"data/animate/{mode}", f"data/animate/{mode}.parquet"} == set(outputs(word))
        return
    assert own == word
    assert {*others} - {*FILES} <= {*list(WORDS)[: WORDS.index(word)]}
    assert word in WORDS
    made = "reports/index.html" if word == "report" else f"data/{word}"
    assert made in {"/".join(Path(out).parts[:2]) for out in outputs(word)}
    assert f"reports/{word}/metrics.json" in outputs(word)


@pytest.mark.parametrize("word", STAGES)
def test_a_stage_enters_and_leaves_by_the_door(word):
    path = ROOT / code.stage_module(word).replace(".", "/")
    tree = ast.parse(path.with_suffix(".py").read_text())
    imports = (node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom))
    assert ast.unparse(next(imports)).startswith("from stages.run import ")
    end = tree.body[-1]
    assert isinstance(end, ast.If) and ast.unparse(end.test) == "__name__ == '__main__'"
    assert ast.unparse(end.body[-1]) == "run(main)"


def test_every_group_belongs_to_a_stage_a_mode_may_have_one_and_the_cluster_has_none():
    own = set(STAGES) - {*FIRST, *PLOTS, *PLAYED}
    assert own <= set(WORDS) <= own | set(MODES)
    assert {*PLAYED} == {stage for stage in STAGES if stage.startswith("modes-")}
    metas = [stage.get("meta", {}) for stage in STAGES.values()]
    listed = {group for meta in metas for group in meta.get("params", [])}
    assert {*GROUPS} - {*WORDS} == {"cluster"} and "cluster" not in listed


@pytest.mark.parametrize("word", STAGES)
def test_numbers_go_to_git_and_footage_to_the_cache(word):
    same = word != "realism"  # its numbers are not the same on every processor
    for out, flags in outputs(word).items():
        in_git = same and Path(out).suffix in (".json", ".csv")
        assert flags.get("cache", True) != in_git, out
    # With an output that is not in the cache DVC's run cache leaves the stage out.
    assert all(not flags for flags in names(STAGES[word].get("outs", [])).values())


def test_metrics_and_plots_show_what_stages_make():
    made = {out for word in STAGES for out in outputs(word)}
    reports = {out for out in made if out.endswith("metrics.json")}
    assert reports == {one for word in STAGES for one in names(STAGES[word].get("metrics", []))}
    for plot in PIPELINE["plots"]:
        # Not a file in a folder of outputs: without the cache, as in a fresh clone, DVC cannot
        # look into the folder, and every experiment fails with "failed to load directory".
        assert made >= plot_sources(plot), plot


# --- running


def test_a_run_leaves_only_numbers_to_git(first_run: Copy):
    repo = first_run  # nothing to put back
    tracked = repo.git("ls-files", "data", "reports", "dvc_plots").split()
    assert tracked
    made = [name for name in tracked if not name.startswith(SHIPPED)]
    assert {Path(name).suffix for name in made} <= {".json", ".csv"}
    assert repo.git("status", "--porcelain") == ""
    assert repo.git("ls-files", ".dvc/plots_page.html")  # a temporary experiment has it too
    for word in {*WORDS} & {*STAGES}:
        headlines = json.loads(repo.text(f"reports/{word}/metrics.json"))
        numbers = {row["number"]: row["value"] for row in headlines.pop("numbers")}
        assert headlines or word == "forecast"  # it is not assessed in a film as short as this
        assert headlines.items() <= numbers.items() and numbers


def test_another_number_of_orientations_goes_all_the_way(first_run: Copy):
    data = first_run.root / "data"
    sprites = pd.read_parquet(data / "sprites/sprites.parquet")
    assert set(sprites["orientations"]) == {20}
    names = json.loads((data / "sprites/atlas-0.json").read_text())["animations"]
    assert {name.split("/")[1] for name in names} == {f"{one:02d}" for one in range(1, 21)}
    table1 = pd.read_csv(first_run.root / "reports/features/table1.csv")
    assert table1["orientation"].tolist() == list(range(1, 21))
    edit = pd.read_parquet(data / "animate/network.parquet")
    assert set(edit["kind"]) == {"sprite"}
    assert edit["rotation_deg"].abs().between(0, 9).all() and edit["orientation"].nunique() > 1
    edit = edit[edit["pose"].isna()]  # a sprite in a pose is turned on with it
    off = (edit["orientation"].astype(int) - 1) * 18 + edit["rotation_deg"] - edit["heading_deg"]
    assert ((off + 180) % 360 - 180).abs().max() < 1e-3
    shown = pd.read_parquet(data / "export/hybrid.parquet")["atlas"].dropna()
    assert len(shown) and set(shown) <= {frame for frames in names.values() for frame in frames}


QUICK = {
    "title": "t", "why": "w", "seen": "s",
    "params": {"features.turn_end_threshold": "0.4, 0.5, 7.0"},
    "measures": ["features.straight_pct"],
}  # fmt: skip


def add_sweep(repo: Copy) -> Path:
    """Give a repository the sweep `quick`."""
    experiment = {"defaults": [{"override /hydra/sweeper": "finloop"}], "hydra": {"sweeper": QUICK}}
    path = repo.root / "conf/experiment/quick.yaml"
    path.write_text("# @package _global_\n" + yaml.safe_dump(experiment))
    return path


def test_with_nothing_to_do_no_stage_runs_and_a_new_sweep_is_nothing_to_do(first_run: Copy):
    sweep = add_sweep(first_run)
    text = first_run.dvc("repro")
    assert text.count("didn't change, skipping") == len(STAGES)
    sweep.unlink()


def test_an_edited_conf_stops_a_plain_repro(front: Copy):
    with (front.root / "conf/extract/default.yaml").open("a") as file:
        file.write("# edited\n")
    text = front.dvc("repro", fails=True)
    assert "make params" in text
    assert "Running stage 'extract'" not in text
    front.compose()
    text = front.dvc("repro", "extract")
    assert "Stage 'extract' didn't change" in text  # a comment is no new value


def test_refused_overrides_leave_everything_as_it_was(front_run: Copy):
    """By Hydra, and by our own check; tests/test_params.py has the others, without DVC."""
    repo = front_run  # nothing to put back
    before = repo.text("params.yaml")
    for override, named in {"clip=typo": "clip/typo", "+clip.new=1": "clip.new: unknown"}.items():
        text = repo.dvc("exp", "run", "-S", "clip=carp", "-S", override, fails=True)
        assert named in text and "Traceback" not in text and "Running stage" not in text
    assert repo.text("params.yaml") == before
    assert repo.git("status", "--porcelain") == ""


@pytest.fixture(scope="module")
def shorter(front_run: Copy) -> str:
    """The name of an experiment in which turns are shorter.

    It runs in a temporary copy that has what git tracks; a queued experiment is made in the same
    way. That one runs in the workspace, a sweep's in its clones show.
    """
    before, changed = front_run.text("params.yaml"), "features.turn_end_threshold=1"
    changes = [word for value in (*TINY_CARP, changed) for word in ("-S", value)]
    text = front_run.dvc("exp", "run", "--temp", "--name", "shorter", *changes, "features")
    assert "Ran experiment(s): shorter" in text
    ran = re.findall(r"Running stage '([\w-]+)'", text)
    assert ran == ["params", "features"]  # DVC's run cache has the rest
    assert front_run.text("params.yaml") == before
    assert front_run.git("status", "--porcelain") == ""
    return "shorter"


def test_an_experiment_is_applied_compared_and_charted_offline(front: Copy, shorter: str):
    front.dvc("exp", "apply", shorter)
    assert "up to date" in front.dvc("status", "features")
    changed = {"features.turn_end_threshold": {"old": 0.5, "new": 1, "diff": 0.5}}
    assert json.loads(front.dvc("params", "diff", "--json")) == {"params.yaml": changed}
    (diff,) = json.loads(front.dvc("metrics", "diff", "--json")).items()
    assert diff[0] == "reports/features/metrics.json"
    assert diff[1]["straight_pct"]["diff"] > 0  # turns are shorter
    commands = front.run("make", "-n", "runs").splitlines()
    shown = front.run("sh", "-c", next(line for line in commands if " exp show" in line))
    assert shorter in shown and "features.turn_end_threshold" in shown
    assert "held_out_area_rmse" not in shown and "straight_pct" not in shown  # none; not of the ten
    front.dvc("plots", "diff")
    page = front.text("dvc_plots/index.html")
    assert "vegaEmbed('" in page
    assert "<script src" not in page  # nothing to load from anywhere
    assert front.git("status", "--porcelain", "dvc_plots") == ""
    with chromium() as browser:
        seen = visit(browser, front.root / "dvc_plots/index.html")
        expect(seen.page.locator('[class="marks"]')).to_have_count(page.count("vegaEmbed('"))
        assert not [one for one in seen.bad if one.startswith("asks for")]


# --- stopping


def running(dvc: subprocess.Popen[str], word: str) -> psutil.Process:
    """Wait for the process of a stage that a DVC command has started, and that has loaded numpy."""

    def look() -> psutil.Process | None:
        if dvc.poll() is not None:
            raise AssertionError(f"{word} never ran: {dvc.communicate()[0]}")
        for child in psutil.Process(dvc.pid).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                if child.cmdline()[-2:] == ["-m", f"stages.{word}"] and any(
                    "_multiarray_umath" in file.path for file in child.memory_maps()
                ):
                    return child
        return None

    stage = wait_for(look, every=0.1)  # a look takes some ms
    assert stage is not None
    return stage


def blow_ctrl_c(dvc: subprocess.Popen[str], stage: psutil.Process) -> None:
    os.killpg(dvc.pid, signal.SIGINT)  # as a terminal does: to all


def blow_kill_stage(dvc: subprocess.Popen[str], stage: psutil.Process) -> None:
    stage.kill()


def blow_kill_dvc(dvc: subprocess.Popen[str], stage: psutil.Process) -> None:
    dvc.kill()
    assert wait_for(lambda: not alive(stage)), "the stage works on without DVC"


def lock(repo: Copy) -> Any:
    """dvc.lock, in whatever order its stages have run."""
    return yaml.safe_load(repo.text("dvc.lock"))


def stop(repo: Copy, word: str, blow: Any) -> None:
    """Stop a run while it is in the stage `word`."""
    with repo.start("dvc", "repro", "features") as dvc:
        stage = running(dvc, word)
        if word == "clip":  # a second run beside this one is refused, and says whom it waits for
            stage.suspend()
            text = repo.dvc("repro", "features", fails=True)
            assert "busy" in text and f"PID {dvc.pid}" in text
            stage.resume()
        blow(dvc, stage)
        text, _ = dvc.communicate(timeout=PATIENCE_S)
    assert dvc.returncode != 0
    assert "Traceback" not in text
    assert not alive(stage)


STOPS = {"clip": blow_kill_dvc, "extract": blow_ctrl_c, "features": blow_kill_stage}


def test_a_run_stopped_again_and_again_goes_on_to_the_same_end(front: Copy):
    wanted = lock(front)  # the digest of every artifact of a run without a stop
    for word in STOPS:
        shutil.rmtree(front.root / "data" / word)
        shutil.rmtree(front.root / "reports" / word)
    shutil.rmtree(front.root / ".dvc/cache/runs")  # or DVC would fetch what it has made before
    stages = {word: stage for word, stage in wanted["stages"].items() if word not in STOPS}
    (front.root / "dvc.lock").write_text(yaml.safe_dump(wanted | {"stages": stages}))
    with front.alone():
        for word, blow in STOPS.items():
            stop(front, word, blow)
        assert "Running stage 'features'" in front.dvc("repro")
    assert lock(front) == wanted
    assert front.git("status", "--porcelain", "data", "reports/*.json", "reports/*.csv") == ""


def test_another_process_paints_the_same_pictures(first_run: Copy):
    painted = content(first_run.root / "reports/film")
    first_run.run("python", "-m", "stages.plots.film")
    assert painted and content(first_run.root / "reports/film") == painted


# --- sharing


def test_a_colleague_gets_results_and_experiments_and_runs_nothing(
    front: Copy, shorter: str, tmp_path: Path
):
    """By two remotes: a bare repository of Git, and a folder of DVC."""
    git_remote, clone = str(tmp_path / "git"), tmp_path / "clone"
    front.git("init", "--quiet", "--bare", git_remote)
    front.dvc("push", "--run-cache", "--remote", "lab")
    front.git("push", "--quiet", git_remote, "HEAD:refs/heads/main")
    front.dvc("exp", "push", "--remote", "lab", git_remote, shorter)
    front.git("clone", "--quiet", "--branch", "main", git_remote, str(clone))
    site = {"DVC_SITE_CACHE_DIR": str(tmp_path / "site")}
    colleague = Copy(clone, front.env | site, front.kept)
    colleague.git("config", "user.name", "colleague")
    colleague.git("config", "user.email", "colleague@example.org")
    colleague.run("python", "-m", "stages.pull", "--remote", "lab")
    for word in STOPS:  # as in a temporary experiment, where nothing is
        shutil.rmtree(clone / "data" / word)
    assert "Running stage" not in colleague.dvc("repro")
    colleague.dvc("exp", "pull", "--remote", "lab", "origin", shorter)
    colleague.dvc("exp", "apply", shorter)
    assert "up to date" in colleague.dvc("status", "features")
    assert "turn_end_threshold: 1" in colleague.text("params.yaml")


# --- sweeps and pull requests


def experiments_of_head(repo: Copy) -> str:
    """Where Git keeps the experiments of the present commit."""
    head = repo.git("rev-parse", "HEAD").strip()
    return f"refs/exps/{head[:2]}/{head[2:]}"


def test_a_sweep_makes_experiments_and_leaves_the_workspace_alone(front: Copy):
    """As in a new clone, where nobody has the results that the lock names.

    Two experiments are there: one with the present settings, one with other settings than its own.
    """
    add_sweep(front)
    front.git("add", "--all")
    front.git("commit", "--quiet", "--message", "a sweep of my own")
    (parameters,) = re.findall(r"path: data/params\n.*\n +md5: (\w+)\.dir", front.text("dvc.lock"))
    strange = front.text("dvc.lock").replace(parameters, "0" * 32)
    (front.root / "dvc.lock").write_text(strange)
    folder = experiments_of_head(front)
    for name in ("quick-0.4", "quick-0.5"):
        front.git("update-ref", f"{folder}/{name}", "HEAD")
    before = front.git("status", "--porcelain"), front.text("dvc.lock"), front.text("params.yaml")
    with front.alone():
        text = front.run("python", "-m", "stages.sweep", "quick", fails=True)
    assert "quick-7.0 failed" in text and "features.turn_end_threshold: should be" in text
    assert text.index("quick-7.0 failed") < text.index("runs: ")  # at once, not at the end
    assert "runs: 1 of 1" in text and "quick-0.4: made again" in text
    assert "quick-0.5" not in text.partition("made again")[0]  # it is there already
    assert "reports/compare.html compares them" in text
    after = front.git("status", "--porcelain"), front.text("dvc.lock"), front.text("params.yaml")
    assert before == after
    listed = front.git("for-each-ref", "--format=%(refname:lstrip=-1)", "refs/exps").split()
    assert {"quick-0.4", "quick-0.5"} <= set(listed) and "quick-7.0" not in listed
    ref = f"{folder}/quick-0.4"
    changed = set(front.git("diff", "--name-only", "HEAD", ref, "--", "*metrics.json").split())
    assert changed <= {"reports/features/metrics.json"}
    values = [yaml.safe_load(front.git("show", f"{one}:params.yaml")) for one in ("HEAD", ref)]
    assert values[0] != values[1]
    values[0]["features"]["turn_end_threshold"] = 0.4
    assert values[0] == values[1]  # nothing else has changed
    page = front.text("reports/compare.html")
    assert all(name in page for name in ("quick-0.4", "quick-0.5", "straight pct"))
    assert not list((front.root / ".dvc/tmp").glob("sweep-*"))


def test_an_animation_is_drawn_from_the_cache(first_run: Copy, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(first_run.root)
    commits = {"present": "HEAD", "again": "start", "before": "start~1"}  # that has no dvc.lock
    found = draw_previews(commits, "network")
    assert set(found) == {"present", "again"} and found["present"] is found["again"]
    assert found["present"].picture[8:12] == b"WEBP" and b"ftyp" in found["present"].film[:16]
    assert choose_mode(["bpn.train_rows", "animate.loops_film_pct"]) == "loops"
    assert choose_mode(["bpn.train_rows"]) == "hybrid"


def test_a_film_that_is_added_or_missing_touches_no_other_film_of_a_study(front: Copy):
    carp = {key: yaml.safe_load(value) for key, value in (one.split("=") for one in TINY_CARP)}
    films = {"one": carp, "two": carp | {"features.turn_end_threshold": 0.4}, "gone": "gone.mp4"}
    (front.root.parent / "study.yaml").write_text(yaml.safe_dump({"films": films}, sort_keys=False))
    head, folder = front.git("rev-parse", "HEAD").strip(), experiments_of_head(front)
    for name in ("one", "removed"):  # what has been run of this film is the commit itself
        front.git("update-ref", f"{folder}/study-{name}", head)
    front.dvc("remote", "add", "other", "../other")  # on which no result depends
    before = front.git("status", "--porcelain"), front.text("params.yaml")
    front.git("switch", "--quiet", "--detach")  # experiments belong to a commit, not to a branch
    with front.alone():
        text = front.run("env", "FILMS=../study.yaml", "python", "-m", "stages.study", fails=True)
    assert "nothing at" in text and "gone.mp4" in text and "runs: 1 of 1" in text
    table = pd.read_csv(front.root / "reports/study.csv").set_index("film")
    assert [*table.index] == ["one", "two", "gone"]
    assert table["extract.tracks"].notna().tolist() == [True, True, False]
    listed = front.git("for-each-ref", "--format=%(refname:lstrip=-1) %(objectname)", folder)
    made = dict(line.split() for line in listed.splitlines() if line.startswith("study-"))
    assert made.keys() == {"study-one", "study-two", "study-removed"}
    assert made["study-one"] == made["study-removed"] == head != made["study-two"]
    front.git("switch", "--quiet", "-")
    assert before == (front.git("status", "--porcelain"), front.text("params.yaml"))


def test_a_pull_request_shows_what_the_numbers_were_and_are(front: Copy, tmp_path: Path):
    steps = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"]["test"]["steps"]
    (step,) = [one for one in steps if "BASE" in one.get("env", {})]
    metrics = front.root / "reports/features/metrics.json"
    metrics.write_text(json.dumps(json.loads(metrics.read_text()) | {"straight_pct": 12345}))
    front.git("commit", "--quiet", "--all", "--message", "another number")
    given = "BASE=start", f"GITHUB_STEP_SUMMARY={tmp_path / 'summary.md'}"
    front.run("env", *given, "sh", "-e", "-c", step["run"])
    said = (tmp_path / "summary.md").read_text()
    assert "| reports/features/metrics.json | straight_pct |" in said and "12345" in said
    assert "## params: base against this pull request" in said
    assert "\n|" in said.partition("params")[2]
