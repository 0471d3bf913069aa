"""Use your own film: name it in conf/local/default.yaml, compose params.yaml, show the report.

`python -m stages.film [key=value ...]` takes one film or several from the variable FILM: a path as
it is, or several paths between spaces, with quotes around one that contains spaces. `--report`
prints where the report is, and opens it on a desktop. `make film` runs the pipeline between both.
"""

from stages.run import open_in_browser, run  # isort: skip

import json
import os
import shlex
import sys
from itertools import count
from pathlib import Path

import yaml

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes
from finloop.io.footage import list_films
from stages.compose import write_params
from stages.settings import LOCAL

REPORT = Path("reports/index.html")
COMMAND = "make film FILM"


def parse_film_paths(text: str, command: str = COMMAND) -> list[str]:
    """Return the absolute paths in the text of a variable such as FILM.

    Paths are separated by spaces, unless the whole text is one path. command: what the user types
    before the `=`, such as `make film FILM`. FinloopError if a file is missing, or none is named.
    """
    variable = command.rpartition(" ")[2]
    wanted = (
        f'{command}=/path/of/film.mp4; several: {variable}="a.mp4 b.mp4", quoted where a space is'
    )
    if not text.strip():
        raise FinloopError(f"{variable} names no film", wanted, "give the path of your film")
    try:
        names = [text] if Path(text).expanduser().exists() else shlex.split(text)
    except ValueError as error:
        raise FinloopError(
            f"{variable}={text} cannot be read: {error}",
            wanted,
            "give the path as it is, or close quotes",
        ) from error
    missing = [film for name in names for film in list_films(name) if not film.exists()]
    if missing:
        raise FinloopError(
            f"there is nothing at {', '.join(str(film.absolute()) for film in missing)}",
            wanted,
            "correct the path",
        )
    return [str(Path(name).expanduser().absolute()) for name in names]


def local_conf_text(films: list[str]) -> str:
    """Return the content of a file conf/local/default.yaml that names these films."""
    # In OmegaConf's notation, in which `${` would begin the name of another value.
    paths = [json.dumps(film.replace("${", "\\${"), ensure_ascii=False) for film in films]
    value = paths[0] if len(paths) == 1 else "[" + ", ".join(paths) + "]"
    return f"""# @package _global_
# By `make film`. Your own settings belong here, too.
defaults:
  - override /clip: file

clip:
  path: {value}
"""


def name_films(films: list[str], local: Path) -> str:
    """Write the films' paths into conf/local/default.yaml; return a sentence on what was done.

    A file that names these films already stays unchanged. Other content is replaced; it is saved as
    a backup unless this function wrote it.
    """
    old = local.read_bytes() if local.is_file() else b""
    old_text = old.decode(errors="replace")
    old_films = _films_in_local_conf(old_text)
    if old_films == films:
        return f"{local} names the film already, and is left as it is"
    note = ""
    if old_text and old_text != local_conf_text(old_films):
        backups = (local.with_name(f"{local.name}.before-{number}") for number in count(1))
        backup = next(path for path in backups if not path.exists())
        save_bytes(backup, old)
        note = f"; what it held before is kept in {backup}"
    save_bytes(local, local_conf_text(films).encode())
    return f"{local} names the film{note}"


def _films_in_local_conf(text: str) -> list[str]:
    """Return the films that a conf/local/default.yaml names, from its content."""
    try:
        path = yaml.safe_load(text)["clip"]["path"]
    except (yaml.YAMLError, KeyError, TypeError):
        return []
    paths = [path] if isinstance(path, str) else path
    if not isinstance(paths, list) or not all(isinstance(name, str) for name in paths):
        return []
    return [name.replace("\\${", "${") for name in paths]  # as `local_conf_text` has escaped it


def show_report(report: Path) -> None:
    """Print the path of the report, and open it if there is a desktop."""
    print(f"\nDone. The report: {report.absolute()}")
    open_in_browser(report.absolute().as_uri())


def main() -> None:
    """Name the films of FILM in conf/local/, write params.yaml; or show the report (--report)."""
    if sys.argv[1:] == ["--report"]:
        show_report(REPORT)
        return
    print(f"finloop: {name_films(parse_film_paths(os.environ.get('FILM', '')), LOCAL)}")
    write_params(sys.argv[1:])


if __name__ == "__main__":
    run(main)
