"""The command line of `gait`: two key poses and the name of a gait give a moving drawing.

`python -m finloop.gait key1.svg key2.svg --gait dog_walk -o out.svg`. Contours of
the same id form a pair. The ending says the format: .svg, .webp, .mp4, .json, .lottie.json.
"""

import argparse
from fractions import Fraction
from pathlib import Path
from typing import Any

from finloop.base.errors import FinloopError
from finloop.base.tool import frame_rate, in_frames, run_tool
from finloop.gait.model import Gait
from finloop.gait.record import DO, MOST_BYTES, WANTED, gait_of
from finloop.gait.transfer import LEAST_FRAMES, Transfer, repeat, transfer
from finloop.io.animation import ENDINGS, save_animation, writer
from finloop.io.record import load_json
from finloop.io.svg import load_svg
from finloop.morph.layers import MOST_FRAMES

SHIPPED = Path(__file__).parents[2] / "data/gaits"
RATE = Fraction(30)


def main(arguments: list[str] | None = None) -> int:
    """Read two key poses and a gait, write the cycle, print its summary; the exit status."""
    options = _parser().parse_args(arguments)
    return run_tool(options.output, lambda: _write(options))


def _write(options: argparse.Namespace) -> str:
    """Write the cycle and return its summary."""
    writer(options.output)  # a wrong ending is an error before the work
    gait = load_gait(path_of(options.gait, SHIPPED))
    frames, rate = timing(gait.frequency_hz, options.frames, options.rate)
    if options.cycles < 1 or options.cycles * frames > MOST_FRAMES:
        raise FinloopError(
            f"{options.cycles} cycles of {frames} frames",
            f"at least 1 cycle, at most {MOST_FRAMES} frames in all",
            "stay between; SVG and Lottie repeat by themselves",
        )
    poses = load_svg(options.key1), load_svg(options.key2)
    result = transfer(*poses, gait, frames, options.points, options.control)
    save_animation(options.output, repeat(result.morph, options.cycles), rate, options.size)
    return summary(result, gait, float(frames / rate))


def load_gait(path: Path) -> Gait:
    """Read a gait's JSON file; FinloopError if it is missing, no JSON, or no gait."""
    return load_json(path, gait_of, WANTED, DO, MOST_BYTES)


def path_of(name: str, shipped: Path) -> Path:
    """The file of a gait: a shipped one by its name, any other by its path.

    Raises
    ------
    FinloopError
        If it is neither.
    """
    paths = gaits(shipped)
    if name in paths:
        return paths[name]
    if Path(name).is_file():
        return Path(name)
    raise FinloopError(
        f"the gait {name!r}",
        f"one of {', '.join(paths) or 'none, as none is here'}, or the path of a gait's JSON file",
        "choose one of these, or fit one to a film: dvc repro gait",
    )


def gaits(shipped: Path) -> dict[str, Path]:
    """The shipped gaits by name."""
    return {path.stem: path for path in sorted(shipped.glob("*.json"))}


def timing(frequency_hz: float, frames: int | None, rate: Fraction | None) -> tuple[int, Fraction]:
    """Frames of a cycle and frames per second, so that the gait keeps its tempo.

    Where both are given, they are the tempo.
    """
    if frames is None:
        rate = rate or RATE
        return min(max(LEAST_FRAMES, round(float(rate) / frequency_hz)), MOST_FRAMES), rate
    return frames, rate or Fraction(frames * frequency_hz).limit_denominator(1000)


def summary(result: Transfer, gait: Gait, seconds: float) -> str:
    """What a cycle consists of and how its feet stand, in a line or more."""
    morph = result.morph
    frames = len(morph.tau)
    lines = [f"{len(morph.layers)} contours, {frames} frames, a cycle of {seconds:.3g} s"]
    if result.before is not None and result.after is not None:
        way = abs(result.after.speed) * frames
        before, after = (
            100 * max(contact.slide.values()) for contact in (result.before, result.after)
        )
        lines[0] += (
            f"; the ground passes by at {way:.3g} widths of the drawing a cycle, feet slide"
            f" {after:.2g} % of one ({before:.2g} % between the keys as drawn)"
        )
    elif gait.support:
        feet = ", ".join(gait.support)
        lines.append(f"no contour is a foot of {gait.name} ({feet}): the ground is not kept")
    if result.lifted:
        lines.append(
            f"in key 2 {', '.join(result.lifted)} should stand, but their partners do:"
            " are left and right, or the keys, exchanged?"
        )
    if folded := morph.count_fold_frames():
        lines.append("folds: " + in_frames(folded, frames))
    if result.outside:
        lines.append("leaves the picture: " + in_frames(result.outside, frames))
    return "\n  ".join(lines)


class _List(argparse.Action):
    """Prints the shipped gaits and ends, as --help does."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
        for name, path in gaits(SHIPPED).items():
            gait = load_gait(path)
            kind = {"swap": "left and right exchange", "mirror": "left mirrors right"}
            print(f"{name}: {gait.frequency_hz:.3g} Hz, {kind[gait.symmetry]}; {gait.source}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m finloop.gait",
        description="Make a drawing go: two key poses and a gait give a cycle that repeats."
        " Contours of the same id belong together; limbs are fore_left, fore_right, hind_left,"
        " hind_right.",
    )
    parser.add_argument("key1", type=Path, help="limbs at their extremes, SVG")
    parser.add_argument("key2", type=Path, help="a quarter of a cycle later, with the same ids")
    parser.add_argument("--gait", required=True, help="a name that --list shows, or a JSON file")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help=f"what to write: {', '.join(ENDINGS)}"
    )
    parser.add_argument("--list", action=_List, nargs=0, help="show the gaits and end")
    parser.add_argument("--frames", type=int, help="of a cycle (default: as the tempo asks)")
    parser.add_argument(
        "--rate",
        "--fps",
        type=frame_rate,
        help=f"frames per second (default {RATE}, or as frames ask)",
    )
    parser.add_argument("--cycles", type=int, default=1, help="in a row (default 1)")
    parser.add_argument("--points", type=int, default=128, help="of a contour (default 128)")
    parser.add_argument("--control", type=int, help="control points: 4, 16, 64 … (default all)")
    parser.add_argument("--size", type=int, default=512, help="longer side of films, px")
    return parser
