"""Compose conf/ into params.yaml: `python -m stages.compose [--check] [key=value ...]`.

`help=sprites` prints the parameters of a group instead.

DVC composes as in `dvc exp run -S`, so both give the same file. With --check nothing is written;
the exit status is 1 where params.yaml is not the composition of conf/.
"""

from stages.run import run  # isort: skip

import argparse
import json
import os
import re
import sys
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from shutil import get_terminal_size
from tempfile import TemporaryDirectory
from typing import Any

import yaml
from dvc.utils.hydra import compose_and_dump
from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from finloop.base.errors import FinloopError
from finloop.base.override import quote_override
from finloop.base.settings import GROUPS, check_values, full_names, variants, yaml_error
from finloop.base.yaml_limits import refuse_yaml_bomb
from finloop.io.atomic import save_bytes
from finloop.io.parameters import refusal_error
from stages.conflicts import find_conflicts
from stages.experiment import FOLDER, Experiment
from stages.parameters import terminal_table
from stages.settings import CONF, FILES, LOCAL, PARAMS, STAMP, STAMPS, list_problems


def compose_params(overrides: list[str]) -> str:
    """Compose the files of conf/ with overrides; return the text of params.yaml.

    overrides: in Hydra's syntax, `group.key=value`. FinloopError if one is refused.
    """
    if refusal := quoting_error(overrides):
        raise refusal
    root = Path.cwd()
    for path in LOCAL.parent.glob("*.yaml"):  # deep nesting would end the process in Hydra
        try:
            refuse_yaml_bomb(path.read_text(encoding="utf-8", errors="replace"))
        except yaml.MarkedYAMLError:
            continue  # composing names the place
        except yaml.YAMLError as error:
            raise yaml_error(path, error) from error
    with TemporaryDirectory() as folder:
        output = Path(folder) / PARAMS.name
        try:
            compose_and_dump(str(output), str(root / CONF), None, "config", str(root), overrides)
        except (HydraException, OmegaConfBaseException) as error:
            raise _as_user_error(error, overrides) from error
        except (UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
            raise yaml_error(_find_damaged_file(error), error) from error
        return output.read_text(encoding="utf-8")


def _find_damaged_file(error: Exception) -> Path:
    """Return the file of conf/ that is no YAML; conf/ itself if all are.

    error: what the parser raised, which mostly names the file.
    """
    if mark := getattr(error, "problem_mark", None):
        return Path(os.path.relpath(mark.name))
    for path in sorted(CONF.rglob("*.yaml")):
        try:
            yaml.load(path.read_text(encoding="utf-8"), yaml.CSafeLoader)
        except (UnicodeDecodeError, yaml.YAMLError, RecursionError):
            return path
    return CONF


def refuse_wrong_values(values: Mapping[str, Mapping[str, Any]], overrides: list[str]) -> None:
    """Raise FinloopError if composing `values` with further overrides would refuse them.

    It takes a tenth of the time of composing. values: content of params.yaml. overrides: in Hydra's
    syntax; if one is not `group.key=value` of a parameter in `values`, or its value is to be looked
    up (`${…}`), it raises KeyError.
    """
    changed = {word: values[word] for word in GROUPS}
    parser = OverridesParser.create()
    for text in overrides:
        override = parser.parse_override(text)
        word, _, key = override.get_key_element().partition(".")
        if key not in changed[word] or "${" in text:
            raise KeyError(text)
        changed[word] = {**changed[word], key: override.value()}
    if problems := list_problems(changed) or find_conflicts(changed):
        raise refusal_error(problems)


def write_params(overrides: list[str]) -> None:
    """Compose conf/ with overrides, and write params.yaml."""
    save_bytes(PARAMS, compose_params(overrides).encode())


def quoting_error(overrides: list[str]) -> FinloopError | None:
    """Return an error that shows how to quote overrides; None if each is one `key=value`.

    overrides: as the shell has split them. FinloopError as in `_is_override`.
    """
    wrong = [text for text in overrides if not _is_override(text)]
    if not wrong:
        return None
    meant = _guess_overrides(overrides)
    quoted = [f"'{text if _is_override(text) else _quote_value(text)}'" for text in meant]
    for_make = " ".join(quoted).replace('"', '\\"')
    return FinloopError(
        f"{' '.join(wrong)} is no `key=value`: the shell ends it at a space, Hydra at one of "
        "= , : ~ ( ) [ ] { }",
        "a text with such a character in double quotes, and all of it in single quotes",
        f"dvc exp run {' '.join(f'-S {text}' for text in quoted)}\n"
        f'          or, after make: S="{for_make}"',
    )


def _guess_overrides(words: list[str]) -> list[str]:
    """Return the overrides that a user probably meant, from words that the shell split at spaces.

    So ["clip.path", "=", "my", "film.mp4"] gives ["clip.path=my film.mp4"].
    """
    key = rf"[+~]?(?:{'|'.join((*GROUPS, FOLDER))})[.:\w]*"  # FOLDER, as in `+experiment=name`
    # Remove spaces beside a "=", take "group:key=" for "group.key=", and split before each key.
    typed = re.sub(rf"(?<!\S)({key}) *= *", r"\1=", " ".join(words))
    typed = re.sub(rf"(?<!\S)({'|'.join(GROUPS)}):(?=\w+=)", r"\1.", typed)
    return re.split(rf"[ ,](?={key}=)", typed)


def _is_override(text: str) -> bool:
    """Return whether a text is `key=value` with one value, in Hydra's syntax.

    FinloopError if it has several values, its group is unknown, or it gives a group a value that is
    no text and so names no variant.
    """
    try:
        override = OverridesParser.create().parse_override(text)
    except HydraException:
        return False
    if override.is_sweep_override():
        key, _, values = text.partition("=")
        decimal = re.fullmatch(r"(\d+),(\d+)", values)  # with a comma, as in "0,5"
        raise FinloopError(
            f"{text} has several values",
            "one value; a list stands in brackets: key=[1,2]",
            f'for a run with each value: make sweep S="{text}"'
            + (f"; for a decimal point: {key}={decimal[1]}.{decimal[2]}" if decimal else ""),
        )
    name = override.key_or_group.partition(".")[0]
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
    if not (override.is_add() or override.is_delete()):
        refuse_unknown_group(text, name, override.key_or_group)
    return True


def refuse_unknown_group(text: str, group: str, key: str) -> None:
    """Raise FinloopError if an override's group is unknown, with the name that was perhaps meant.

    text: the override, `key=value`; key: `group` or `group.name`.
    """
    known = [*GROUPS, FOLDER, LOCAL.parent.name, "hydra", *STAMPS]
    if group.partition("/")[0] in known:
        return
    near = get_close_matches(group, known, 1)
    # Without a dot it may be a parameter whose group was forgotten.
    meant = full_names(group, GROUPS) if group == key else ""
    meant = meant or (near[0] if near else "")
    raise FinloopError(
        f"{text}: there is no group {group}" + (f"; did you mean {meant}?" if meant else ""),
        f"one of {', '.join(GROUPS)}",
        "correct the name; `make params S=help=bpn` prints the parameters of a group",
    )


def _quote_value(override: str) -> str:
    """Return an override `key=value` with its value in double quotes."""
    key, _, value = override.partition("=")
    unquoted = value.strip('"')
    return f"{key}={json.dumps(unquoted, ensure_ascii=False)}"


def load_experiment(name: str) -> Experiment:
    """Return the sweep that conf/experiment/<name>.yaml declares.

    FinloopError if there is no such file (the others are listed), or its content is wrong.
    """
    override = f"+{FOLDER}={name}"
    compose_params([override])  # raises for wrong values, and loads the schema of a sweep
    with initialize_config_dir(str(Path.cwd() / CONF), version_base=None):
        config = compose("config", [override], return_hydra_config=True)
    if config.hydra.runtime.choices["hydra/sweeper"] != "finloop":
        raise FinloopError(
            f"{CONF}/{FOLDER}/{name}.yaml has no sweep",
            "`override /hydra/sweeper: finloop`, and hydra.sweeper.params",
            f"for its values alone: make params S={override}",
        )
    values = OmegaConf.to_container(config.hydra.sweeper)
    sweep, problems = check_values(FOLDER, {name: Experiment}, values)
    if sweep is None:
        raise FinloopError(
            f"{CONF}/{FOLDER}/{name}.yaml is not a sweep:\n    " + "\n    ".join(problems),
            "title, why, seen, params and measures, with existing stages",
            "correct it",
        )
    return sweep


def _as_user_error(error: Exception, overrides: list[str]) -> FinloopError:
    """Return an error of composing as a FinloopError that says what to do.

    overrides: those that were composed.
    """
    if isinstance(error, FinloopError):
        return error
    # Three errors of Hydra and OmegaConf have a remedy of their own; the others keep their text.
    if missing := re.search(r"Could not find '(\w+)/(.+)'", str(error)):
        return _no_option_error(missing[1], missing[2], overrides)
    if twice := re.search(r"Multiple values for (\w+)\. .*override (\w+): (\w+)", str(error)):
        line = f"- override /{twice[2]}: {twice[3]}"
        return FinloopError(
            f"{twice[1]} has two variants in {CONF}/",
            f"a file that replaces the variant of {CONF}/config.yaml",
            f"write {line!r} below `defaults:`",
        )
    if value := re.search(r"In '(\S+)'[^$]*not a subclass of \w+\. value: (.*)", f"{error}"):
        return FinloopError(
            f"{CONF}/{value[1]}.yaml has {value[2]!r} where a group of parameters belongs",
            "`name: value` below the group's name, such as clip: {frames: 100}",
            "correct the file; a variant is chosen below `defaults:`, as - override /clip: carp",
        )
    message = f"{error}\n{error.__cause__ or ''}".partition("Config search path")[0]
    # Hydra advises `+key`, which is refused as well.
    lines = [line for line in message.splitlines() if not line.startswith("To append")]
    return FinloopError(
        "\n    ".join(line.strip() for line in lines if line.strip()),
        f"keys and values of the groups in {CONF}/",
        f"correct {CONF}/, or the overrides",
    )


def _no_option_error(word: str, option: str, overrides: list[str]) -> FinloopError:
    """Return the error that a group has no such option, with the override that was likely meant.

    word, option: what the user typed as `word=option`. word: a group, or another folder of conf/
    such as "experiment". overrides: all that were composed.
    """
    files = (CONF / word).glob("*.yaml")
    options = list(variants(word)) if word in GROUPS else sorted(path.stem for path in files)
    if word in GROUPS and not (CONF / word / "default.yaml").is_file():
        advised = get_close_matches(option, options, n=1, cutoff=0.5) or options
        do = "type " + " or ".join(f"{word}={choice}" for choice in advised)
        if word == "clip" and re.search(r"[/.~]", option):  # a path, not a variant
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
    """Raise FinloopError if params.yaml is not the composition of conf/ with these overrides.

    If it was composed with a conf/local/ that is missing here, only the ranges of its values count.
    """
    text = PARAMS.read_text(encoding="utf-8") if PARAMS.is_file() else ""
    values = yaml.safe_load(text) or {}
    # A stamp, the digest of conf/, has a second part "-…" where there is a conf/local/.
    if "-" in values.get(STAMP, "") and not LOCAL.is_file():
        print(f"{PARAMS} has values of a {LOCAL} that is not here: only ranges are checked",
              file=sys.stderr)  # fmt: skip
        if problems := list_problems(values):
            raise refusal_error(problems)
        return
    no_stamps = dict.fromkeys(FILES)  # the films and tracks may be missing here
    if values | no_stamps != yaml.safe_load(compose_params(overrides)) | no_stamps:
        raise FinloopError(
            f"{PARAMS} is not the composition of {CONF}/",
            f"the values of {CONF}/ in {PARAMS}",
            "run `make params`",
        )


def main() -> None:
    """Write params.yaml, check it (--check), or print the parameters of groups (help=group)."""
    parser = argparse.ArgumentParser(prog="make params", description=__doc__)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("overrides", nargs="*", metavar="key=value")
    arguments, dashed = parser.parse_known_args()
    if dashed:
        overrides = [text.lstrip("-") for text in (*dashed, *arguments.overrides) if text != "-S"]
        raise FinloopError(
            f"{' '.join(dashed)} is no option of make params",
            "key=value, without -S or dashes",
            f'make params S="{" ".join(overrides)}"',
        )
    groups = [text.removeprefix("help=") for text in arguments.overrides if text[:5] == "help="]
    if arguments.check:
        require_composed_params(arguments.overrides)
    elif groups:
        columns = get_terminal_size().columns
        print("\n\n".join(terminal_table(group, columns, CONF) for group in groups))
    else:
        write_params(arguments.overrides)


if __name__ == "__main__":
    run(main)
