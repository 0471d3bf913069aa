"""Messages and exit status of command-line tools."""

import argparse
import sys
from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path

from finloop.base.errors import user_error


def run_tool(output: Path, work: Callable[[], str]) -> int:
    """Call `work` and print the summary that it returns, or its error; return the exit status.

    output: the file that `work` writes, for messages. The exit status is 0, or 1 after an error.
    """
    try:
        summary = work()
    except Exception as error:
        message = user_error(error)
        if message is None:
            raise
        print(f"finloop: {message}", file=sys.stderr)
        return 1
    print(f"{output}: {summary}")
    return 0


def format_frame_counts(counts: Mapping[str, int], frames: int) -> str:
    """Return counts of frames by contour id as text, such as "eye in 3, tail in 1 of 20 frames".

    frames: number of all frames.
    """
    listed = ", ".join(f"{name} in {count}" for name, count in counts.items())
    return f"{listed} of {frames} frames"


def parse_frame_rate(text: str) -> Fraction:
    """Parse a command-line argument, such as "25" or "30000/1001", as frames per second above 0.

    ArgumentTypeError if it is anything else.
    """
    try:
        rate = Fraction(text)
    except (ValueError, ZeroDivisionError) as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of frames per second") from error
    if rate <= 0:
        raise argparse.ArgumentTypeError(f"{text} frames per second are not above 0")
    return rate


def add_resolution_options(
    parser: argparse.ArgumentParser, other_use: str, usual_wavelet: str
) -> None:
    """Add the options --level and --wavelet, which say how coarse contours are, to a parser.

    other_use: what else the wavelet is used for, "" if nothing. usual_wavelet: the wavelet that is
    taken without the option. Both are words for the help text. Options that are not given are 0 and
    None.
    """
    parser.add_argument(
        "--level",
        type=int,
        default=0,
        help="round contours off: keep 1/2^LEVEL of their points as control points (default 0)",
    )
    uses = (
        f"of these control points, and of {other_use}" if other_use else "of these control points"
    )
    parser.add_argument("--wavelet", help=f"{uses}: db4, sym8 … (default {usual_wavelet})")
