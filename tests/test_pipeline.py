"""The pipeline as DVC sees it: its graph is true, and every way to run it, or to stop it, works."""

import ast
import contextlib
import json
import os
import shutil
import signal
import subprocess
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pandas as pd
import psutil
import pytest
import yaml
from conftest import TINY_CARP, Copy, alive, wait_for

from finloop.base.settings import GROUPS, SETTINGS_AT, WORDS
from finloop.edit.modes import MODES
from stages.settings import FILES

ROOT = Path(__file__).parents[1]
PIPELINE = yaml.safe_load((ROOT / "dvc.yaml").read_text())
SHIPPED = ("data/drawings", "data/gaits")  # of data/, what no stage makes
STAGES: dict[str, Any] = PIPELINE["stages"]
EMPTY = {
    f"{package}/__init__.py"
    for package in ("finloop", "stages", "finloop/plots", "stages/modes", "stages/plots")
}
"""What an import of a module below runs too; the first one imports only what is asked for."""
PLOTS = [stage for stage in STAGES if stage.startswith("plots-")]
PLAYED = [f"modes-{mode}" for mode in MODES]
DRAWS_ITSELF = ("morph", "gait")


# --- dvc.yaml against the code


def module_files(name: str) -> set[str]:
    """The files that importing a module of ours runs: its own and its packages'."""
    parts = name.split(".")
    files = set()
    for depth in range(1, len(parts) + 1):
        path = Path(*parts[:depth])
        for candidate in (path / "__init__.py", path.with_suffix(".py")):
            if (ROOT / candidate).is_file():
                files.add(candidate.as_posix())
    return files


@cache
def imported(file: str) -> set[str]:
    """The files of ours that a file imports, at its top or inside a function.

    finloop/project.py, and run_files.py with the base of its class, are an exception. Each property
    and method of `Project` imports the rooms that it needs inside itself, so that a stage depends
    on what it uses and not on the whole pipeline:

    - these two count with the imports at their top alone, without those for type checkers;
    - a file that imports project.py also counts with the imports of those properties and methods
      that it uses, of an object called `project` or of `Project(…)`, and of those that these use.
    """
    tree = ast.parse((ROOT / file).read_text())
    if file in PARTS:
        return imports_in(tree.body)
    found = imports_in([*ast.walk(tree)])
    if PROJECT in found:
        for member in members_used(attributes(tree, "project")):
            found |= imports_in([*ast.walk(members()[member])])
    return found


PROJECT = "finloop/project.py"
PARTS = {PROJECT: "Project", "finloop/run_files.py": "RunFiles"}  # its class, and the base of that


@cache
def members() -> dict[str, ast.FunctionDef]:
    """The properties and methods of `Project` by name."""
    found = {}
    for file, name in PARTS.items():
        body = ast.parse((ROOT / file).read_text()).body
        (part,) = (one for one in body if isinstance(one, ast.ClassDef) and one.name == name)
        found |= {one.name: one for one in part.body if isinstance(one, ast.FunctionDef)}
    return found


def attributes(tree: ast.AST, of: str) -> set[str]:
    """The names after the dot of an object of this name: `of.x`, `other.of.x` or `Of(…).x`."""

    def called(node: ast.AST) -> str:
        if isinstance(node, ast.Call):
            return called(node.func).lower()
        return getattr(node, "id", getattr(node, "attr", ""))

    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    return {node.attr for node in nodes if called(node.value) == of}


def members_used(names: set[str]) -> set[str]:
    """Members of `Project` among these names, and those that they use themselves."""
    todo, seen = names & set(members()), set[str]()
    while todo:
        member = todo.pop()
        seen.add(member)
        todo |= (attributes(members()[member], "self") & set(members())) - seen
    return seen


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


def imports_in(nodes: list[Any]) -> set[str]:
    """The files of ours that the import statements among these nodes run."""
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {
        found
        for name in names
        if name.partition(".")[0] in ("finloop", "stages")
        for found in module_files(name)
    }


def closure(files: set[str]) -> set[str]:
    todo, seen = set(files), set()
    while todo:
        file = todo.pop()
        seen.add(file)
        todo |= imported(file) - seen
    return seen


def names(entries: list[Any]) -> dict[str, dict[str, Any]]:
    """dvc.yaml's `path` or `path: {flags}` as path → flags."""
    flat: dict[str, dict[str, Any]] = {}
    for entry in entries:
        flat |= entry if isinstance(entry, dict) else {entry: {}}
    return flat


def outputs(word: str) -> dict[str, dict[str, Any]]:
    stage = STAGES[word]
    return names([*stage.get("outs", []), *stage.get("metrics", []), *stage.get("plots", [])])


def folder(file: str) -> str:
    """How dvc.yaml names a file: by its package's folder, by itself if it is in none."""
    parts = Path(file).parts
    whole = len(parts) > 2 and (parts[0] == "finloop" or parts[1] == "plots")
    return "/".join(parts[:2]) if whole else file


def module(stage: str) -> str:
    """What the stage runs."""
    return f"stages.{stage.replace('-', '.')}"


def pictures(stage: str) -> list[str]:
    """What a stage that draws runs in processes of their own."""
    return import_module(module(stage)).MODULES if stage in PLOTS else []


@pytest.mark.parametrize("word", STAGES)
def test_deps_are_exactly_the_folders_that_a_stage_imports_from(word):
    files = closure(set().union(*map(module_files, [module(word), *pictures(word)])))
    wanted = {folder(file) for file in files - EMPTY}
    if word in DRAWS_ITSELF:  # by a few modules: the stages that draw need all of the room
        wanted = (wanted - {"finloop/plots"}) | {one for one in files - EMPTY if "/plots/" in one}
    if word == "params":  # looks at every declaration, by name
        wanted |= {f"finloop/{SETTINGS_AT.get(one, f'{one}/settings.py')}" for one in GROUPS}
        wanted.add("finloop/edit/modes.py")  # the modes that a declaration names
    deps = STAGES[word]["deps"]
    listed = {dep for dep in deps if dep.startswith(("finloop", "stages"))}
    assert sorted(wanted - listed) == [], "imported, but not under deps"
    assert sorted(listed - wanted) == [], "under deps, but not imported"
    assert len(deps) == len(set(deps)), "twice under deps"


def test_the_closure_sees_imports_of_imports_and_inside_functions():
    assert "finloop/base/errors.py" in closure({"stages/run.py"})
    assert {"stages/__init__.py", "stages/run.py"} == module_files("stages.run")
    assert "finloop/io/atomic.py" in imported("stages/run.py")


def test_a_stage_depends_on_the_parts_of_a_project_that_it_uses(tmp_path):
    use = "from finloop.project import Project\n"

    def rooms(number: int, text: str) -> set[str]:
        path = tmp_path / f"{number}.py"  # another one each time, for what is found is kept
        path.write_text(use + text)
        return {folder(file) for file in imported(str(path)) - EMPTY - {*PARTS}}

    assert rooms(0, "") == rooms(1, "project.rate_hz, project.other, p.size") == set()
    assert rooms(2, "project.features") == rooms(3, "Project().features") == {"finloop/features"}
    assert rooms(4, "a.project.poses") == {"finloop/features", "finloop/pose"}  # one uses the other
    forecast = rooms(5, "project.forecast")
    assert "finloop/forecast" in forecast and "finloop/bpn" not in forecast
    assert rooms(6, "project.gallery(drawn)") == {"finloop/edit", "finloop/render"}


def test_a_project_is_called_project_wherever_dependencies_are_read():
    files = {file for word in STAGES for file in closure(module_files(module(word)))}
    users = {file for file in files - {PROJECT} if PROJECT in imported(file)}
    assert "stages/animate.py" in users
    for file in users:
        assert names_of_projects(ast.parse((ROOT / file).read_text())) <= {"project"}, file
    text = "a = Project()\nwith Project() as b: pass\ndef f(c: Project, d=Project()): pass"
    assert names_of_projects(ast.parse(text)) == {"a", "b", "c"}


def test_a_project_imports_only_files_at_its_top_and_rooms_inside_its_members():
    at_top = {file for part in PARTS for file in imported(part)}
    rooms = {folder(file) for file in at_top - EMPTY - {*PARTS}}
    assert rooms == {"finloop/base", "finloop/io"}
    trees = [ast.parse((ROOT / part).read_text()) for part in PARTS]
    top = [node for tree in trees for node in tree.body if not isinstance(node, ast.If)]
    everywhere = {file for node in top for file in imports_in([*ast.walk(node)])}
    inside = {file for one in members().values() for file in imports_in([*ast.walk(one)])}
    assert everywhere == at_top | inside  # top: without the imports of type checkers


def test_a_changed_picture_computes_nothing_anew():
    assert {one for one in STAGES if "finloop/plots" in STAGES[one]["deps"]} == {*PLOTS}
    for stage in PLOTS:
        words = {one.rpartition(".")[2] for one in pictures(stage)}
        assert words == {Path(out).parts[1] for out in outputs(stage)}


def test_every_picture_is_drawn_by_one_stage():
    drawn = [one for stage in PLOTS for one in pictures(stage)]
    files = {path.stem for path in (ROOT / "stages/plots").glob("*.py")}
    others = {"__init__", "draw", *(stage.removeprefix("plots-") for stage in PLOTS)}
    assert sorted(drawn) == sorted(f"stages.plots.{one}" for one in files - others)


@pytest.mark.parametrize("word", STAGES)
def test_a_stage_is_one_word_everywhere(word):
    stage = STAGES[word]
    assert stage["cmd"] == f"exec python -m {module(word)}"  # exec: see stages/run.py
    if word in PLOTS:
        return
    if word == "params":
        return
    groups = [group.partition(".")[0] for group in stage["params"]]
    own, *others = groups  # others: of stages whose work it does again, or it works for
    if word in PLAYED:
        mode = word.removeprefix("modes-")
        assert own == mode
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
    path = ROOT / module(word).replace(".", "/")
    tree = ast.parse(path.with_suffix(".py").read_text())
    imports = (node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom))
    assert ast.unparse(next(imports)).startswith("from stages.run import ")
    end = tree.body[-1]
    assert isinstance(end, ast.If) and ast.unparse(end.test) == "__name__ == '__main__'"
    assert ast.unparse(end.body[-1]) == "run(main)"


def test_every_group_belongs_to_a_stage():
    assert set(WORDS) == set(STAGES) - {"params", *PLOTS, *PLAYED} | set(MODES)


def test_every_mode_has_a_stage_and_a_file():
    assert {*PLAYED} == {stage for stage in STAGES if stage.startswith("modes-")}
    for mode in MODES:
        assert (ROOT / f"stages/modes/{mode}.py").is_file()


def test_no_stage_runs_anew_where_the_work_is_done_elsewhere():
    listed = {group for stage in STAGES.values() for group in stage.get("params", [])}
    assert {*GROUPS} - {*WORDS} == {"cluster"} and "cluster" not in listed


def test_nothing_runs_before_the_parameters_are_checked():
    (checked,) = outputs("params")
    made = {out: word for word in STAGES for out in outputs(word)}

    def waits(word: str) -> bool:
        deps = STAGES[word]["deps"]
        return checked in deps or any(dep in made and waits(made[dep]) for dep in deps)

    assert [word for word in STAGES if word != "params" and not waits(word)] == []


@pytest.mark.parametrize("word", STAGES)
def test_numbers_go_to_git_and_footage_to_the_cache(word):
    same = word != "realism"  # its numbers are not the same on every processor
    for out, flags in outputs(word).items():
        in_git = same and Path(out).suffix in (".json", ".csv")
        assert flags.get("cache", True) != in_git, out


def test_metrics_and_plots_show_what_stages_make():
    made = {out for word in STAGES for out in outputs(word)}
    reports = {out for out in made if out.endswith("metrics.json")}
    assert set(PIPELINE["metrics"]) == reports
    for plot in PIPELINE["plots"]:
        for name, shape in plot.items() if isinstance(plot, dict) else [(plot, None)]:
            sources = shape["y"] if shape and "y" in shape else [name]
            # Not a file in a folder of outputs: without the cache, as in a fresh clone, DVC cannot
            # look into the folder, and every experiment fails with "failed to load directory".
            assert made >= set(sources), name


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
        assert json.loads(repo.text(f"reports/{word}/metrics.json"))


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
    "title": "t",
    "why": "w",
    "seen": "s",
    "params": {"features.release": "0.4, 0.5, 7.0"},
    "measures": ["features.straight_pct"],
}


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
    for override, named in {
        "clip=typo": "clip/typo",
        "+clip.new=1": "clip.new: unknown",
        "animate.sprites=paper": "animate.sprites: unknown; the modes network, loops and hybrid",
    }.items():
        text = repo.dvc("exp", "run", "-S", "clip=carp", "-S", override, fails=True)
        assert named in text
        assert "Traceback" not in text
        assert "Running stage" not in text
    assert repo.text("params.yaml") == before
    assert repo.git("status", "--porcelain") == ""


def overrides(*own: str) -> list[str]:
    return [word for value in (*TINY_CARP, *own) for word in ("-S", value)]


def test_an_experiment_runs_apart_is_applied_compared_and_charted_offline(front: Copy):
    """In a temporary copy that has what git tracks; a queued experiment is made in the same way.

    That one runs in the workspace, a sweep's in its clones show.
    """
    before = front.text("params.yaml")
    changes = overrides("features.release=1")
    text = front.dvc("exp", "run", "--temp", "--name", "shorter", *changes, "features")
    assert "Ran experiment(s): shorter" in text
    assert front.text("params.yaml") == before
    assert front.git("status", "--porcelain") == ""
    front.dvc("exp", "apply", "shorter")
    assert "up to date" in front.dvc("status", "features")
    changed = json.loads(front.dvc("params", "diff", "--json"))
    assert set(changed) == {"params.yaml"} and set(changed["params.yaml"]) == {"features.release"}
    shorter = changed["params.yaml"]["features.release"]
    assert (shorter["old"], shorter["new"]) == (0.5, 1)
    diff = json.loads(front.dvc("metrics", "diff", "--json"))
    assert set(diff) == {"reports/features/metrics.json"}
    assert diff["reports/features/metrics.json"]["straight_pct"]["diff"] > 0  # turns are shorter
    front.dvc("plots", "diff")
    page = front.text("dvc_plots/index.html")
    assert "vegaEmbed('" in page
    assert "<script src" not in page  # nothing to load from anywhere
    assert front.git("status", "--porcelain", "dvc_plots") == ""
    charts, drawn = page.count("vegaEmbed('"), drawn_offline(front.root / "dvc_plots/index.html")
    assert drawn in (None, charts)


def drawn_offline(page: Path) -> int | None:
    """How many charts a browser without network draws; None where there is no browser."""
    browser = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
    if browser is None:
        return None
    options = ("--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=9000")
    no_network = "--host-resolver-rules=MAP * ~NOTFOUND"
    profile = f"--user-data-dir={page.parent}/browser"
    command = [browser, *options, no_network, profile, "--dump-dom", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    return done.stdout.count('class="marks"')


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

    stage = wait_for(look, 120, every=0.1)  # a look takes some ms
    assert stage is not None
    return stage


def blow_ctrl_c(dvc: subprocess.Popen[str], stage: psutil.Process) -> None:
    os.killpg(dvc.pid, signal.SIGINT)  # as a terminal does: to all


def blow_kill_stage(dvc: subprocess.Popen[str], stage: psutil.Process) -> None:
    stage.kill()


def blow_kill_dvc(dvc: subprocess.Popen[str], stage: psutil.Process) -> None:
    dvc.kill()
    assert wait_for(lambda: not alive(stage), 30), "the stage works on without DVC"


def lock(repo: Copy) -> Any:
    """dvc.lock, in whatever order its stages have run."""
    return yaml.safe_load(repo.text("dvc.lock"))


def stop(repo: Copy, word: str, blow: Any) -> None:
    """Stop a run while it is in the stage `word`."""
    with repo.start("dvc", "repro", "features") as dvc:
        stage = running(dvc, word)
        blow(dvc, stage)
        text, _ = dvc.communicate(timeout=120)
    assert dvc.returncode != 0
    assert "Traceback" not in text
    assert not alive(stage)


STOPS = {"clip": blow_kill_dvc, "extract": blow_ctrl_c, "features": blow_kill_stage}


def test_a_run_stopped_again_and_again_goes_on_to_the_same_end(front: Copy):
    """And paints a picture again as another process has painted it."""
    wanted = lock(front)  # the digest of every artifact of a run without a stop
    for word in STOPS:
        shutil.rmtree(front.root / "data" / word)
        shutil.rmtree(front.root / "reports" / word)
    shutil.rmtree(front.root / ".dvc/cache/runs")  # or DVC would fetch what it has made before
    again = {*STOPS, "plots-film"}
    stages = {word: stage for word, stage in wanted["stages"].items() if word not in again}
    (front.root / "dvc.lock").write_text(yaml.safe_dump(wanted | {"stages": stages}))
    for word, blow in STOPS.items():
        stop(front, word, blow)
    text = front.dvc("repro", "plots-film")
    assert "Running stage 'features'" in text and "Running stage 'plots-film'" in text
    assert lock(front) == wanted
    wanted_numbers = front.git("status", "--porcelain", "data", "reports/*.json", "reports/*.csv")
    assert wanted_numbers == ""


# --- sweeps and pull requests


def test_a_sweep_makes_experiments_and_leaves_the_workspace_alone(front: Copy):
    add_sweep(front)
    front.git("add", "--all")
    front.git("commit", "--quiet", "--message", "a sweep of my own")
    before = front.git("status", "--porcelain"), front.text("dvc.lock"), front.text("params.yaml")
    text = front.run("python", "-m", "stages.sweep", "quick", fails=True)
    assert "quick-7.0 failed" in text and "features.release: should be" in text
    assert "reports/compare.html compares them" in text
    assert before == (
        front.git("status", "--porcelain"),
        front.text("dvc.lock"),
        front.text("params.yaml"),
    )
    listed = front.git("for-each-ref", "--format=%(refname:lstrip=-1)", "refs/exps").split()
    assert {"quick-0.4", "quick-0.5"} <= set(listed) and "quick-7.0" not in listed
    ref = front.git("for-each-ref", "--format=%(refname)", "refs/exps/**/quick-0.4").strip()
    changed = set(front.git("diff", "--name-only", "HEAD", ref, "--", "*metrics.json").split())
    assert changed <= {"reports/features/metrics.json"}
    values = [yaml.safe_load(front.git("show", f"{one}:params.yaml")) for one in ("HEAD", ref)]
    assert values[0] != values[1]
    values[0]["features"]["release"] = 0.4
    assert values[0] == values[1]  # nothing else has changed
    page = front.text("reports/compare.html")
    assert all(name in page for name in ("quick-0.4", "quick-0.5", "straight pct"))
    assert not list((front.root / ".dvc/tmp").glob("sweep-*"))
    again = front.run("python", "-m", "stages.sweep", "quick", fails=True)
    assert "sweep: " in text and "sweep: " not in again  # both experiments are there already
    assert "quick-0.4" in again and "quick-7.0 failed" in again


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
    assert (
        "## params: base against this pull request" in said and "\n|" in said.partition("params")[2]
    )
