"""What the tools for drawings have in common: how their work ends on a command line."""

import sys
from collections.abc import Callable
from pathlib import Path

from finloop.errors import FinloopError


def ended(output: Path, work: Callable[[], str]) -> int:
    """Do the work that writes `output` and say what it returns; the exit status, 0 or 1.

    What was wrong is said on stderr, whether FinloopError or a file that cannot be written.
    """
    try:
        said = work()
    except FinloopError as error:
        print(f"finloop: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"finloop: {output} cannot be written ({error.strerror})", file=sys.stderr)
        return 1
    print(f"{output}: {said}")
    return 0
