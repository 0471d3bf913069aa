"""finloop installed: a wheel, a lab's own repository that calls it, and which finloop runs."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from conftest import ROOT
from scratch import content

import finloop.command
from finloop.base.errors import FinloopError
from finloop.lab.new import list_shipped_files, make_repository

BUILD = "import sys; from setuptools.build_meta import build_wheel as build; build(sys.argv[1])"
TINY = ["clip=carp", "clip.frames=20", "clip.width_px=96", "clip.height_px=96",
        "clip.body_length_px=30"]  # fmt: skip


def python(*command: str, folder: Path, fails: bool = False, **env: str) -> str:
    """What Python prints in a folder; it must end well, or with `fails` badly."""
    plain = {key: value for key, value in os.environ.items() if key[:4] not in ("GIT_", "DVC_")}
    paths = f"{Path(sys.executable).parent}{os.pathsep}{plain['PATH']}"
    done = subprocess.run(
        [sys.executable, *command], cwd=folder, text=True,
        env=plain | {"PYTHONPATH": "", "PATH": paths} | env,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
    )  # fmt: skip
    assert (done.returncode != 0) == fails, done.stdout
    return done.stdout


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder on Python's path, into which the wheel is unpacked."""
    made, folder = tmp_path_factory.mktemp("wheel"), tmp_path_factory.mktemp("site")
    python("-c", BUILD, str(made), folder=ROOT)
    (wheel,) = made.glob("finloop-*.whl")
    shutil.unpack_archive(wheel, folder, "zip")
    return folder


@pytest.fixture(scope="module")
def lab(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A lab's own repository, made by the installed command."""
    folder = tmp_path_factory.mktemp("labs") / "my lab"
    text = python(
        "-m", "finloop.command", "new", str(folder), folder=folder.parent, PYTHONPATH=str(site)
    )
    assert f"cd {folder}" in text and "pip install" not in text
    return folder


def test_a_wheel_has_all_that_the_program_reads_and_the_scripts(site):
    listed = ["git", "ls-files", "-co", "--exclude-standard", "finloop", "stages", "hydra_plugins"]
    files = subprocess.check_output(listed, cwd=ROOT, text=True).splitlines()
    assert [one for one in files if (ROOT / one).is_file() and not (site / one).is_file()] == []
    shipped = list(list_shipped_files())
    assert {"dvc.yaml", "conf/config.yaml", ".dvc/plots_page.html"} < {*shipped}
    assert [one for one in shipped if not (site / "finloop/shipped" / one).is_file()] == []
    (info,) = site.glob("finloop-*.dist-info")
    assert "finloop = finloop.command:main" in (info / "entry_points.txt").read_text()
    metadata = (info / "METADATA").read_text(encoding="utf-8")
    assert f"Version: {finloop.__version__}\n" in metadata
    assert "Requires-Python: <3.14,>=3.11\n" in metadata
    assert sorted(one.name for one in site.iterdir() if one != info) == [
        "finloop", "hydra_plugins", "stages",
    ]  # fmt: skip
    assert not list(ROOT.glob("*.egg-info")) and not (ROOT / "build").exists()


def test_a_lab_runs_the_installed_program(lab, site):
    pipeline = yaml.safe_load((lab / "dvc.yaml").read_text())["stages"]
    whole = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    assert pipeline.pop("code")["always_changed"] and whole.pop("code") and pipeline == whole
    assert "@" not in (lab / "README.md").read_text()
    here = {"folder": lab, "PYTHONPATH": str(site)}
    conf = lab / "conf/features/default.yaml"
    before = conf.read_text()
    conf.write_text(before.replace("turn_end_threshold: 0.5", "turn_end_threshold: 0.4"))
    python("-m", "stages.compose", *TINY, **here)
    conf_of_lab = yaml.safe_load((lab / "params.yaml").read_text())
    assert conf_of_lab["features"]["turn_end_threshold"] == 0.4
    text = python("-m", "dvc", "repro", "params", **here)
    assert f"finloop {finloop.__version__}, installed in {site}" in text
    assert (lab / "data/params/clip.yaml").is_file()
    code = content(lab / "data/code")  # on which every stage depends
    changed = site / "stages/params.py"  # as another version would be
    changed.write_text(changed.read_text() + "\n# another\n")
    python("-m", "stages.code", **here)
    assert content(lab / "data/code")["params.txt"] != code["params.txt"]


def test_a_working_copy_runs_its_own_sources_beside_an_installed_version(site):
    """Though the installed one is first on Python's path, as for the command `dvc`."""
    text = python("-m", "finloop.command", "version", folder=ROOT, PYTHONPATH=str(site))
    assert f"a working copy in {ROOT}" in text
    script = "import sys; sys.path.remove(''); from finloop.command import main; sys.exit(main())"
    text = python("-c", script, "version", folder=ROOT, PYTHONPATH=str(site))
    assert f"a working copy in {ROOT}" in text
    script = (
        "import sys; sys.path.remove('')\n"
        "from dvc.utils.hydra import load_hydra_plugins\n"
        f"load_hydra_plugins({str(ROOT)!r})\n"
        "print([one.__file__ for name, one in sys.modules.items() if name == 'stages.schemas'])"
    )
    text = python("-c", script, folder=ROOT, PYTHONPATH=str(site))
    assert str(ROOT / "stages/schemas.py") in text
    command = ("-P", "-m", "stages.compose", "--check")
    text = python(*command, folder=ROOT, fails=True, PYTHONPATH=str(site))
    assert "PYTHONSAFEPATH" in text and f"working copy {ROOT}" in text


def test_commands_make_a_morph_and_a_gait(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    faces = [str(ROOT / f"data/drawings/face_{one}.svg") for one in "ab"]
    few = ["--frames", "3", "--points", "32"]
    assert finloop.command.main(["morph", *faces, "-o", "face.svg", *few]) == 0
    assert Path("face.svg").is_file()
    assert finloop.command.main(["morph", *faces, "-o", "face.svg/a.svg", *few]) == 1
    assert "\n  wanted: no file where a folder is wanted" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        finloop.command.main(["gait", "--list"])
    assert "dog_walk: " in capsys.readouterr().out
    with pytest.raises(SystemExit):
        finloop.command.main(["gait", "--help"])
    assert "usage: finloop gait" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        finloop.command.main(["swim"])
    assert "invalid choice: 'swim' (choose from" in capsys.readouterr().err
    assert finloop.command.main(["new", "face.svg"]) == 1
    assert "face.svg is a file" in capsys.readouterr().err


def test_a_folder_that_serves_for_no_repository_is_refused(tmp_path, monkeypatch):
    (tmp_path / "full").mkdir()
    (tmp_path / "full/a.txt").touch()
    with pytest.raises(FinloopError, match=r"full is not empty: it has a\.txt"):
        make_repository(tmp_path / "full")
    outer = tmp_path / "outer"
    subprocess.run(["git", "init", "--quiet", str(outer)], check=True)
    with pytest.raises(FinloopError, match="lies in the repository"):
        make_repository(outer / "deep/lab")
    assert not (outer / "deep").exists()
    with pytest.raises(FinloopError, match=r"lab cannot be made \("):
        make_repository(tmp_path / "full/a.txt/lab")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(FinloopError, match="git is missing"):
        make_repository(tmp_path / "lab")
