"""Stage `params`: check that params.yaml is complete and composed from the present conf/.

It runs when conf/ has changed. Every root of the pipeline depends on its constant output, so
nothing runs before it, and nothing runs again because of it. The programs that compose params.yaml
check it too, and each stage checks its own part.
"""

from stages.run import run  # isort: skip

from pathlib import Path

from finloop.io.atomic import save_bytes
from finloop.io.parameters import refusal_error
from stages.settings import list_problems, read_params

CHECKED = Path("data/params/checked.txt")


def main() -> None:
    """Check params.yaml; write data/params/checked.txt, or raise FinloopError with all problems."""
    if problems := list_problems(read_params()):
        raise refusal_error(problems)
    save_bytes(CHECKED, b"params.yaml is whole and composed from conf/\n")


if __name__ == "__main__":
    run(main)
