"""Compose conf/ into params.yaml: `python -m stages.compose [--check] [key=value ...]`.

`help=sprites` prints the parameters of a group instead.

DVC composes as in `dvc exp run -S`, so both give the same file. With --check nothing is written;
the exit status is 1 where params.yaml is not the composition of conf/.
"""

from stages.run import run  # isort: skip

import argparse
import json
import re
import sys
from difflib import get_close_matches
from pathlib import Path
from shutil import get_terminal_size
from tempfile import TemporaryDirectory

import yaml
from dvc.utils.hydra import compose_and_dump
from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from finloop.base.errors import FinloopError
from finloop.base.override import quote_override
from finloop.base.settings import GROUPS, check_values, full_names, variants
from finloop.io.atomic import save_bytes
from finloop.io.parameters import refusal_error
from stages.experiment import FOLDER, Experiment
from stages.parameters import terminal_table
from stages.settings import CONF, FILES, LOCAL, PARAMS, STAMP, STAMPS, list_problems


def compose_params(overrides: list[str]) -> str:
    """Compose conf/ with overrides; return the text of params.yaml.

    overrides: in Hydra's syntax, `group.key=value`. FinloopError if one is refused.
    """
    if quoting := quoting_error(overrides):
        raise quoting
    root = Path.cwd()
    with TemporaryDirectory() as folder:
        output = Path(folder) / PARAMS.name
        try:
            compose_and_dump(str(output), str(root / CONF), None, "config", str(root), overrides)
        except (HydraException, OmegaConfBaseException) as error:
            raise _as_user_error(error, overrides) from error
        return output.read_text(encoding="utf-8")


def write_params(overrides: list[str]) -> None:
    """Compose conf/ with overrides, and write params.yaml."""
    save_bytes(PARAMS, compose_params(overrides).encode())


def quoting_error(overrides: list[str]) -> FinloopError | None:
    """Return the error that says how to type overrides of which a value needs quotes.

    overrides: as the shell has split them. None if each is one `key=value`. FinloopError is raised
    if one has several values or an unknown group.
    """
    wrong = [text for text in overrides if not _is_override(text)]
    if not wrong:
        return None
    key = rf"[+~]?(?:{'|'.join((*GROUPS, FOLDER))})[.:\w]*"
    text = re.sub(rf"(?<!\S)({key}) *= *", r"\1=", " ".join(overrides))  # as before the shell
    text = re.sub(rf"(?<!\S)({'|'.join(GROUPS)}):(?=\w+=)", r"\1.", text)
    whole = re.split(rf"[ ,](?={key}=)", text)
    typed = [f"'{text if _is_override(text) else _quote_value(text)}'" for text in whole]
    in_make = " ".join(typed).replace('"', '\\"')
    return FinloopError(
        f"{' '.join(wrong)} is no `key=value`: the shell ends it at a space, Hydra at one of "
        "= , : ~ ( ) [ ] { }",
        "a text with such a character in double quotes, and all of it in single quotes",
        f"dvc exp run {' '.join(f'-S {text}' for text in typed)}\n"
        f'          or, after make: S="{in_make}"',
    )


def _is_override(text: str) -> bool:
    """Return whether a text is `key=value` with one value, in Hydra's syntax.

    FinloopError if it has several values, or its group is unknown.
    """
    try:
        override = OverridesParser.create().parse_override(text)
    except HydraException:
        return False
    name = override.key_or_group.partition(".")[0]
    if override.is_sweep_override():
        key, _, values = text.partition("=")
        point = re.fullmatch(r"(\d+),(\d+)", values)
        raise FinloopError(
            f"{text} has several values",
            "one value; a list stands in brackets: key=[1,2]",
            f'for a run with each value: make sweep S="{text}"'
            + (f"; for a decimal point: {key}={point[1]}.{point[2]}" if point else ""),
        )
    if not name:
        return False  # `key =5`, which the shell has split
    if "/" in name and not name.startswith("hydra"):
        return False  # the rest of a path after a space
    is_group = override.key_or_group in GROUPS and not override.is_delete()
    if is_group and not isinstance(override.value(), str):
        raise FinloopError(
            f"{text} names no parameter of the group {name}",
            f"{name}.NAME=VALUE",
            f"`make params S=help={name}` prints the names",
        )
    known = [*GROUPS, FOLDER, LOCAL.parent.name, "hydra", *STAMPS]
    if not (override.is_add() or override.is_delete()) and name.partition("/")[0] not in known:
        near = get_close_matches(name, known, 1)
        meant = full_names(name, GROUPS) if name == override.key_or_group else ""
        meant = meant or (near[0] if near else "")
        raise FinloopError(
            f"{text}: there is no group {name}" + (f"; did you mean {meant}?" if meant else ""),
            f"one of {', '.join(GROUPS)}",
            "correct the name; `make params S=help=bpn` prints the parameters of a group",
        )
    return True


def _quote_value(override: str) -> str:
    """Return a `key=value` with its value in double quotes, as text."""
    key, _, value = override.partition("=")
    return f"{key}={json.dumps(value.strip(chr(34)), ensure_ascii=False)}"


def load_experiment(name: str) -> Experiment:
    """Return the sweep that conf/experiment/<name>.yaml declares.

    FinloopError if there is no such file (the others are listed), or its content is wrong.
    """
    override = f"+{FOLDER}={name}"
    compose_params([override])  # is it right in itself; and loads the schema of a sweep
    with initialize_config_dir(str(Path.cwd() / CONF), version_base=None):
        whole = compose("config", [override], return_hydra_config=True)
    if whole.hydra.runtime.choices["hydra/sweeper"] != "finloop":
        raise FinloopError(
            f"{CONF}/{FOLDER}/{name}.yaml has no sweep",
            "`override /hydra/sweeper: finloop`, and hydra.sweeper.params",
            f"for its values alone: make params S={override}",
        )
    values = OmegaConf.to_container(whole.hydra.sweeper)
    sweep, problems = check_values(FOLDER, {name: Experiment}, values)
    if sweep is None:
        raise FinloopError(
            f"{CONF}/{FOLDER}/{name}.yaml is not a sweep:\n    " + "\n    ".join(problems),
            "title, why, seen, params and measures, with existing stages",
            "correct it",
        )
    return sweep


def _as_user_error(error: BaseException, overrides: list[str]) -> FinloopError:
    """Return the FinloopError that Hydra has wrapped in its error, or one with Hydra's message.

    overrides: those that were composed.
    """
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, FinloopError):
            return cause
        cause = cause.__cause__ or cause.__context__
    if found := re.search(r"Could not find '(\w+)/(.+)'", str(error)):
        return _no_option_error(found[1], found[2], overrides)
    lines_of = f"{error}\n{error.__cause__ or ''}".partition("Config search path")[0].splitlines()
    # Hydra advises `+key`, which is refused as well.
    lines = [line.strip() for line in lines_of if line.strip() and not line.startswith("To append")]
    return FinloopError(
        "\n    ".join(lines),
        f"keys and values of the groups in {CONF}/",
        f"correct {CONF}/, or the overrides",
    )


def _no_option_error(word: str, option: str, overrides: list[str]) -> FinloopError:
    """Return the error that a group has no such option, with the override that was probably meant.

    word, option: as in `word=option`. overrides: those that were composed.
    """
    options = list(variants(word)) if word in GROUPS else []
    options += sorted(path.stem for path in (CONF / word).glob("*.yaml") if not options)
    if word in GROUPS and not (CONF / word / "default.yaml").is_file():
        near = get_close_matches(option, options, 1, 0.5)
        do = "type " + " or ".join(f"{word}={one}" for one in near or options)
        if word == "clip" and re.search(r"[/.~]", option):
            do = f"type clip=file {quote_override('clip.path', option)}"
    elif word in GROUPS:
        do = f"type {word}.NAME=VALUE; `make params S=help={word}` prints the names"
    else:
        do = "take one of these"
    return FinloopError(
        f"{' '.join(overrides)}: there is no {CONF}/{word}/{option}.yaml",
        f"for {word} one of: {', '.join(options)}",
        do,
    )


def require_composed_params(overrides: list[str]) -> None:
    """Raise FinloopError if params.yaml is not what conf/ composes to with these overrides.

    If params.yaml was composed with a conf/local/ that is missing here, only its values are
    checked.
    """
    text = PARAMS.read_text(encoding="utf-8") if PARAMS.is_file() else ""
    values = yaml.safe_load(text) or {}
    if "-" in values.get(STAMP, "") and not LOCAL.is_file():
        print(f"{PARAMS} has values of a {LOCAL} that is not here: only ranges are checked",
              file=sys.stderr)  # fmt: skip
        if problems := list_problems(values):
            raise refusal_error(problems)
        return
    unstamped = dict.fromkeys(FILES)  # films and tracks may be elsewhere, too
    if values | unstamped != yaml.safe_load(compose_params(overrides)) | unstamped:
        raise FinloopError(
            f"{PARAMS} is not the composition of {CONF}/",
            f"the values of {CONF}/ in {PARAMS}",
            "run `make params`",
        )


def main() -> None:
    """Write params.yaml, compare it with conf/, or print the parameters of groups."""
    parser = argparse.ArgumentParser(prog="make params", description=__doc__)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("overrides", nargs="*", metavar="key=value")
    arguments, dashed = parser.parse_known_args()
    if dashed:
        given = [text.lstrip("-") for text in (*dashed, *arguments.overrides) if text != "-S"]
        raise FinloopError(
            f"{' '.join(dashed)} is no option of make params",
            "key=value, without -S or dashes",
            f'make params S="{" ".join(given)}"',
        )
    words = [text.removeprefix("help=") for text in arguments.overrides if text[:5] == "help="]
    if arguments.check:
        require_composed_params(arguments.overrides)
    elif words:
        columns = get_terminal_size().columns
        print("\n\n".join(terminal_table(word, columns, CONF) for word in words))
    else:
        write_params(arguments.overrides)


if __name__ == "__main__":
    run(main)
