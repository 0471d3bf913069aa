"""Read and check params.yaml, and return its groups as dataclasses.

params.yaml is composed from conf/ by `make params` or `dvc exp run`; a plain `dvc repro` composes
nothing. So params.yaml is stamped with a digest of conf/, and refused where conf/ was edited since.
"""

import hashlib
import os
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from finloop.base.errors import FinloopError
from finloop.base.override import format_override
from finloop.base.settings import GROUPS, check_values, default_variants, read_conf_values, variants
from finloop.io.parameters import build_settings, read_parameters

PARAMS = Path("params.yaml")
CONF = Path("conf")
LOCAL = CONF / "local/default.yaml"  # the user's film and settings; git ignores it
STAMP = "conf_sha256"  # the key in params.yaml with the digest of its conf/
FILES = ("film_stamp", "tracks_stamp", "path_stamp", "retarget_stamp")  # see `stages.stamps`
STAMPS = (STAMP, *FILES)


def load_settings(word: str) -> Any:
    """Return the parameters of a stage, from params.yaml, as its settings dataclass.

    word: name of the group of parameters, mostly that of the stage. FinloopError lists all wrong
    parameters, or says that conf/ was edited since params.yaml was composed.
    """
    return build_settings(word, read_params())


def read_params() -> dict[str, Any]:
    """Return the content of params.yaml; raise FinloopError if conf/ was edited since."""
    values = read_parameters(PARAMS)
    _require_present_conf(values)
    return values


def _require_present_conf(values: Mapping[str, Any]) -> None:
    """Raise FinloopError if conf/ has changed since params.yaml was composed.

    values: content of params.yaml. In a temporary experiment of DVC, conf/local/ is not compared.
    """
    composed_from, present = str(values.get(STAMP)), conf_stamp(CONF)
    if Path(os.environ.get("DVC_ROOT", ".")).resolve() != Path.cwd():
        # A temporary experiment has only what git has; conf/local/ was composed before.
        composed_from, present = (stamp.partition("-")[0] for stamp in (composed_from, present))
    shared_part, _, local_part = composed_from.partition("-")
    if local_part and shared_part == present:
        raise FinloopError(
            f"{PARAMS} was composed with a {LOCAL}, which is not here",
            "that file; git does not keep it",
            f"copy it from the computer on which {PARAMS} was composed, then `dvc repro`; or run "
            f"`make params`, which takes the values of {CONF}/ without it",
        )
    if composed_from != present:
        raise FinloopError(
            f"{CONF}/ is not what {PARAMS} was composed from",
            f"a {PARAMS} composed from the present {CONF}/, so that no old value is used",
            "run `make params`, then `dvc repro`; in a temporary experiment, `git add` new files "
            f"of {CONF}/ first, because it sees only files that git tracks",
        )


def conf_stamp(conf: Path) -> str:
    """Return the stamp of a folder conf/: a digest of its files, and one of conf/local/.

    Without a conf/local/ the stamp ends before the "-". conf/experiment/ does not count.
    """
    local = LOCAL.relative_to(CONF).as_posix()
    files = {path.relative_to(conf).as_posix(): path for path in conf.rglob("*.yaml")}
    shared = sorted(name for name in files if not name.startswith(("experiment/", "local/")))
    digests = []
    for names in (shared, [local]) if local in files else (shared,):
        digest = hashlib.sha256()
        for name in names:
            text = files[name].read_bytes().replace(b"\r\n", b"\n")
            # With lengths, so that no two lists of files give the same bytes.
            digest.update(b"%d %s %d %s" % (len(name), name.encode(), len(text), text))
        digests.append(digest.hexdigest()[:16])
    return "-".join(digests)


def list_problems(values: Mapping[str, Any]) -> list[str]:
    """Return a sentence for each wrong, missing or unknown parameter, with its dotted name.

    values: content of params.yaml.
    """
    unknown = [word for word in values if word not in (*GROUPS, *STAMPS)]
    problems = list(map(_describe_unknown_group, unknown))
    for word in GROUPS:
        _, wrong = check_values(word, variants(word), values.get(word, {}))
        problems += wrong
    return problems


def _describe_unknown_group(word: str) -> str:
    """Return a sentence on a top-level key of params.yaml that names no group."""
    if word == LOCAL.parent.name:
        return f"{word}: unknown; let {LOCAL} begin with the line: # @package _global_"
    group, _, key = word.partition(".")
    if group in GROUPS and key:
        return f"{word}: unknown; in a file write {group}: {{{key}: value}}"
    near = get_close_matches(word, GROUPS, n=1, cutoff=0.65)
    return f"{word}: unknown" + (f"; did you mean {near[0]}?" if near else "")


def list_overrides(values: Mapping[str, Any]) -> list[str]:
    """Return the Hydra overrides with which conf/ composes to a given params.yaml.

    values: content of params.yaml. Groups come in its order; of each, the override that chooses the
    variant comes before those of single parameters.
    """
    conf = CONF.absolute()
    default_options = default_variants(conf)
    changes = []
    for word, group in values.items():
        if word in STAMPS:
            continue
        # The parameter `source` of a group with several variants names the variant.
        option = group.get("source", default_options[word])
        if option != default_options[word]:
            changes.append(f"{word}={option}")
        in_conf = read_conf_values(word, option, conf)
        changes += [
            f"{word}.{key}={format_override(value)}"
            for key, value in group.items()
            if in_conf[key] != value
        ]
    return changes
