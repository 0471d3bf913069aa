"""The command line of `gait`: key poses and the name of a gait make a moving drawing.

`python -m finloop.gait key1.svg key2.svg --gait dog_walk -o out.svg`. A gait without symmetry, such
as a gallop, takes four key poses. Contours of the same id belong together. The file name's ending
selects the format: .svg, .css.svg, .webp, .mp4, .json, .lottie.json, .spine.json.
"""

import argparse
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

from finloop.base.errors import FinloopError
from finloop.base.program import shipped_folder
from finloop.base.tool import (
    add_resolution_options,
    format_frame_counts,
    parse_frame_rate,
    run_tool,
)
from finloop.gait.model import DO, WANTED, Gait, gait_from_record
from finloop.gait.settings import Symmetry
from finloop.gait.transfer import LEAST_FRAMES, Transfer, animate_drawing, repeat_cycle
from finloop.io.animation import ENDINGS, find_morph_writer, save_animation
from finloop.io.record import load_json
from finloop.io.svg import describe_unpainted, load_svg
from finloop.morph.layers import MOST_FRAMES
from finloop.morph.match import Resolution

SHIPPED = shipped_folder() / "data/gaits"
RATE = Fraction(30)
KINDS: Mapping[Symmetry, str] = {
    "swap": "left and right exchange",
    "mirror": "left mirrors right",
    "none": "no symmetry, four key poses",
}
MOST_SLIDE_PCT = 15  # of a width, without correction; by the shipped key poses feet slide by 13
MOST_BYTES = 10_000_000  # of a gait's file: γ per coordinate of ten limbs of 1024 points is 2 MB


def main(arguments: list[str] | None = None, program: str = "python -m finloop.gait") -> int:
    """Read key poses and a gait, write the gait cycle, print a summary; return the exit status.

    program: how the command was called, for its help.
    """
    options = _build_parser(program).parse_args(arguments)
    return run_tool(options.output, lambda: _write_cycle(options))


def _write_cycle(options: argparse.Namespace) -> str:
    """Write the animated cycle that the command line's options describe; return its summary.

    FinloopError if an option is out of range, or a file cannot be read.
    """
    find_morph_writer(options.output)  # check the ending first
    gait = load_gait(find_gait_file(options.gait, SHIPPED))
    frames, rate = choose_frame_timing(gait.frequency_hz, options.frames, options.rate)
    if options.cycles < 1 or options.cycles * frames > MOST_FRAMES:
        raise FinloopError(
            f"{options.cycles} cycles of {frames} frames",
            f"at least 1 cycle, at most {MOST_FRAMES} frames in all",
            "set fewer cycles or frames; SVG and Lottie repeat by themselves",
        )
    wavelet = options.wavelet or gait.wavelet
    Resolution(options.level, wavelet).check(options.points)
    control = options.points >> options.level if options.level else None
    poses = [load_svg(path) for path in options.keys]
    result = animate_drawing(poses, gait, frames, options.points, control, wavelet)
    shown = repeat_cycle(result.morph, options.cycles)
    lost = save_animation(options.output, shown, rate, options.size)
    summary = _summarise_transfer(result, gait, float(frames / rate))
    return "\n  ".join(filter(None, [summary, describe_unpainted(*poses), lost]))


def load_gait(path: Path) -> Gait:
    """Return the gait in a JSON file; FinloopError if the file is missing, no JSON, or no gait."""
    return load_json(path, gait_from_record, WANTED, DO, MOST_BYTES)


def find_gait_file(name: str, shipped: Path) -> Path:
    """Return the JSON file of a gait, from the name of a shipped gait or a path.

    shipped: folder of the shipped gaits. FinloopError if there is no such gait.
    """
    paths = shipped_gait_files(shipped)
    if name in paths:
        return paths[name]
    if Path(name).is_file():
        return Path(name)
    raise FinloopError(
        f"the gait {name!r}",
        " or ".join([*paths, "the path of a gait's JSON file"]),
        "choose one of these, or fit a gait to a film: dvc repro gait",
    )


def shipped_gait_files(shipped: Path) -> dict[str, Path]:
    """Return the JSON files of the gaits in the folder `shipped`, by name."""
    return {path.stem: path for path in sorted(shipped.glob("*.json"))}


def choose_frame_timing(
    frequency_hz: float, frames: int | None, rate: Fraction | None
) -> tuple[int, Fraction]:
    """Return the frames per cycle and the frames per second of an animated gait cycle.

    frequency_hz: of the gait, cycles/s; frames: per cycle; rate: frames per second. If one is None
    it follows from the other and the frequency; if both are, the rate is RATE. Chosen frames are
    whole, LEAST_FRAMES to MOST_FRAMES, so the frequency may change. Given both, they stay.
    """
    if frames is None:
        rate = rate or RATE
        return min(max(LEAST_FRAMES, round(float(rate) / frequency_hz)), MOST_FRAMES), rate
    return frames, rate or Fraction(frames * frequency_hz).limit_denominator(1000)


def _summarise_transfer(result: Transfer, gait: Gait, seconds: float) -> str:
    """Return lines for the user: the cycle's length, how far feet slide, which contours fold."""
    morph = result.morph
    frames = len(morph.tau)
    lines = [f"{len(morph.layers)} contours, {frames} frames, a cycle of {seconds:.3g} s"]
    if result.before is not None and result.after is not None:
        distance = abs(result.after.speed) * frames
        before, after = (
            100 * max(contact.slide.values()) for contact in (result.before, result.after)
        )
        lines[0] += (
            f"; the ground moves {distance:.3g} widths of the drawing a cycle, feet slide"
            f" {after:.2g} % of a width ({before:.2g} % without correction)"
        )
        if before > MOST_SLIDE_PCT:
            lines.append(
                f"without correction feet slide by more than {MOST_SLIDE_PCT} %: are the key poses"
                " in the gait's order?"
            )
        if missing := [foot for foot in gait.support if foot not in result.after.slide]:
            lines.append(
                f"no contour or group is {', '.join(missing)} of {gait.name}: give the limb this"
                " id, unless it is hidden"
            )
    elif gait.support:
        feet = ", ".join(gait.support)
        lines.append(f"no contour is a foot of {gait.name} ({feet}): feet may slide")
    if result.lifted:
        lines.append(
            f"in key 2 {', '.join(result.lifted)} should stand, but their partners stand:"
            " are left and right, or the keys, exchanged?"
        )
    if folded := morph.count_fold_frames():
        lines.append("folds: " + format_frame_counts(folded, frames))
    if result.outside:
        lines.append("leaves the picture: " + format_frame_counts(result.outside, frames))
    return "\n  ".join(lines)


class _ListGaits(argparse.Action):
    """An option that prints the shipped gaits and exits, as --help does."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any, **__: Any) -> None:
        """Print each shipped gait with its frequency and symmetry, then exit."""
        for name, path in shipped_gait_files(SHIPPED).items():
            gait = load_gait(path)
            print(f"{name}: {gait.frequency_hz:.3g} Hz, {KINDS[gait.symmetry]}; {gait.source}")
        parser.exit()


def _build_parser(program: str) -> argparse.ArgumentParser:
    """Return the parser of the command line's options."""
    parser = argparse.ArgumentParser(
        prog=program,
        description="Animate a drawing: key poses and a gait give a cycle that repeats. Shapes of"
        " the same id belong together; limbs are fore_left, fore_right, hind_left, hind_right.",
    )
    parser.add_argument(
        "keys",
        type=Path,
        nargs="+",
        metavar="key",
        help="key poses, SVG: the first with the limbs at their extremes, the second a quarter of a"
        " cycle later. A gait without symmetry takes four, a quarter of a cycle apart",
    )
    parser.add_argument("--gait", required=True, help="a name from --list, or a JSON file")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help=f"output file: {', '.join(ENDINGS)}"
    )
    parser.add_argument("--list", action=_ListGaits, nargs=0, help="show the gaits and exit")
    parser.add_argument("--frames", type=int, help="per cycle (default: by the gait's frequency)")
    parser.add_argument(
        "--rate",
        "--fps",
        type=parse_frame_rate,
        help=f"frames per second (default {RATE}, or by --frames)",
    )
    parser.add_argument("--cycles", type=int, default=1, help="number of cycles (default 1)")
    parser.add_argument("--points", type=int, default=128, help="per contour (default 128)")
    add_resolution_options(parser, "", "the gait's")
    parser.add_argument(
        "--size", type=int, default=512, help="longer side of .webp and .mp4, px (default 512)"
    )
    return parser
