"""Compose conf/ into params.yaml: `python -m stages.compose [--check] [key=value ...]`.

The composing is DVC's own, as in `dvc exp run -S`, so both give the same file. With --check nothing
is written; the exit status is 1 where params.yaml is not the composition of conf/.
"""

from stages.run import run  # isort: skip

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

from dvc.utils.hydra import compose_and_dump
from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from finloop.errors import FinloopError
from finloop.io.atomic import whole_file
from stages.settings import CONF, PARAMS


def composed(overrides: list[str]) -> str:
    """The text of params.yaml for these overrides; FinloopError where one of them is refused."""
    root = Path.cwd()
    with TemporaryDirectory() as folder:
        output = Path(folder) / PARAMS.name
        try:
            compose_and_dump(str(output), str(root / CONF), None, "config", str(root), overrides)
        except (HydraException, OmegaConfBaseException) as error:
            raise _readable(error) from error
        return output.read_text(encoding="utf-8")


def _readable(error: BaseException) -> FinloopError:
    """Our own refusal where Hydra has wrapped one, else what Hydra says."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, FinloopError):
            return cause
        cause = cause.__cause__ or cause.__context__
    said = f"{error}\n{error.__cause__ or ''}".partition("Config search path")[0].splitlines()
    # Hydra advises `+key`, which is refused as well.
    lines = [line.strip() for line in said if line.strip() and not line.startswith("To append")]
    return FinloopError(
        "\n    ".join(lines),
        f"keys and values that the groups in {CONF}/ have",
        f"correct {CONF}/, or the overrides",
    )


def main() -> None:
    """Write params.yaml, or compare it."""
    parser = argparse.ArgumentParser(prog="make params", description=__doc__)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("overrides", nargs="*", metavar="key=value")
    given = parser.parse_args()
    text = composed(given.overrides)
    if not given.check:
        with whole_file(PARAMS) as part:
            part.write_text(text, encoding="utf-8")
    elif not PARAMS.is_file() or PARAMS.read_text(encoding="utf-8") != text:
        raise FinloopError(
            f"{PARAMS} is not the composition of {CONF}/", "the two equal", "make params"
        )


if __name__ == "__main__":
    run(main)
