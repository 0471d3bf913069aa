"""Stage `params`: check params.yaml, and write what each stage depends on beside its data.

data/params/<stage>.yaml holds the parameters of a stage, those that `meta` names in dvc.yaml, and a
digest of the files of the program that it runs. A stage depends on this file, so it runs again when
one of its parameters or files changes, and not when another one does. dvc.lock has one entry for
both. Nothing runs before this stage: it refuses a params.yaml that is incomplete, wrong, or not
composed from the present conf/.
"""

from stages.run import run  # isort: skip

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from finloop.base.errors import FinloopError
from finloop.io.atomic import whole_folder
from finloop.io.parameters import refusal_error
from stages.origins import DECLARED
from stages.settings import list_problems, read_params

OUT, CODE = Path("data/params"), Path("data/code")


def choose_parameters(values: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """Return those parameters of params.yaml that are named, name → value.

    values: content of params.yaml. names: groups ("bpn") or single parameters ("realism.seconds").
    FinloopError if there is no such parameter.
    """
    chosen = {}
    for name in names:
        value: Any = values
        for key in name.split("."):
            if not isinstance(value, Mapping) or key not in value:
                raise FinloopError(
                    f"dvc.yaml names a parameter {name}, which params.yaml does not have",
                    "groups and parameters of conf/",
                    "correct `meta` of the stage in dvc.yaml",
                )
            value = value[key]
        chosen[name] = value
    return chosen


def main() -> None:
    """Check params.yaml, and write what each stage depends on to data/params/<stage>.yaml.

    FinloopError lists all wrong parameters.
    """
    values = read_params()
    if problems := list_problems(values):
        raise refusal_error(problems)
    with whole_folder(OUT) as folder:
        for name, declared in yaml.safe_load(DECLARED.read_text(encoding="utf-8")).items():
            files = (CODE / f"{name}.txt").read_bytes()
            depends = {
                "parameters": choose_parameters(values, declared["params"]),
                "noted": declared["noted"],
                "files_sha256": hashlib.sha256(files).hexdigest()[:16],
            }
            text = yaml.safe_dump(depends, sort_keys=False, allow_unicode=True)
            (folder / f"{name}.yaml").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    run(main)
