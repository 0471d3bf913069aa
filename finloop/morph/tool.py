"""The command line of `morph`: `python -m finloop.morph a.svg b.svg -o out.svg`.

Shapes of the same id form a pair; others are paired by place and shape, or by a file. With --force
one drawing is enough: it moves by gravity, wind, attraction, on a floor. The ending of the output
selects the format: .svg, .css.svg, .webp, .mp4, .json, .lottie.json, .spine.json. .html is a trial
page for pairs, methods and weights.
"""

import argparse
import shlex
from fractions import Fraction
from pathlib import Path

from finloop.base.drawing import Morph
from finloop.base.errors import FinloopError
from finloop.base.tool import (
    add_resolution_options,
    format_frame_counts,
    parse_frame_rate,
    run_tool,
)
from finloop.io.animation import ENDINGS, find_morph_writer, save_animation
from finloop.io.atomic import save_bytes
from finloop.io.svg import describe_unpainted, load_svg
from finloop.morph import trial
from finloop.morph.force_list import FORMS, parse_forces
from finloop.morph.in_forces import describe_rest, move_drawing
from finloop.morph.layers import (
    METHODS,
    PhysicalOptions,
    morph_drawings,
    there_and_back,
)
from finloop.morph.match import FULL, Resolution
from finloop.morph.pairs import FORM, load_pairing, match_drawings

FRAMES, POINTS, FPS, SIZE_PX = 60, 256, Fraction(30), 512  # without options
PAGE = ".html"


def main(arguments: list[str] | None = None, program: str = "python -m finloop.morph") -> int:
    """Read two drawings, write the morph, print its summary; return the exit status.

    program: how the command was called, for its help.
    """
    options = _build_parser(program).parse_args(arguments)
    return run_tool(options.output, lambda: _write_morph(options))


def _write_morph(options: argparse.Namespace) -> str:
    """Write the morph that the command line's options describe; return its summary."""
    is_page = options.output.suffix.lower() == PAGE
    usual_frames, usual_points = (trial.FRAMES, trial.POINTS) if is_page else (FRAMES, POINTS)
    frames = usual_frames if options.frames is None else options.frames
    points = usual_points if options.points is None else options.points
    if is_page:
        return _write_trial_page(options, frames, points)
    find_morph_writer(options.output)  # check the ending first
    forces, method = parse_forces(options.force), options.method
    if options.b is None and not forces:
        raise FinloopError(
            "one drawing and no force",
            "two drawings, or one and a force that moves it",
            "name a second drawing, or add --force",
        )
    if options.b is None and options.pairs:
        raise FinloopError(
            f"one drawing and pairs ({options.pairs})",
            "a second drawing, whose shapes those of the first become",
            "give it, or leave --pairs out",
        )
    if forces and (method not in (None, "physical") or options.back):
        raise FinloopError(
            "--force with --back" if options.back else f"--force with --method {method}",
            "--force alone: only bodies with mass and springs feel it, and none moves back in time",
            "leave the other option out",
        )
    a, pairing = load_svg(options.a), ""
    b = a
    if options.b is not None:
        b = load_svg(options.b)
    unpainted = describe_unpainted(a, b)
    if options.b is not None:
        a, b, pairing = match_drawings(a, b, options.pairs)
    given, rest = (points, *_curve_options(options)), ""
    rate = FPS if options.fps is None else options.fps
    size_px = SIZE_PX if options.size is None else options.size
    if forces:
        motion = move_drawing(a, b, forces, frames, rate, *given)
        result, rest = motion.morph, describe_rest(motion.rest_time)
    else:
        result = morph_drawings(a, b, method or "fold_free", frames, *given)
    shown = there_and_back(result) if options.back else result
    lost = save_animation(options.output, shown, rate, size_px)
    return "; ".join(filter(None, [_summarise_morph(result), rest, pairing, unpainted, lost]))


def _curve_options(options: argparse.Namespace) -> tuple[Resolution, PhysicalOptions]:
    """Return the resolution and the physical settings that the command line's options give."""
    return Resolution(options.level, options.wavelet or FULL.wavelet), PhysicalOptions(
        options.elastic, options.damping, options.mass, options.stiffness_damping
    )


def _write_trial_page(options: argparse.Namespace, frames: int, points: int) -> str:
    """Write the trial page that the command line's options describe; return its summary.

    FinloopError without a second drawing, or with an option that a page has no use for.
    """
    names = "force", "method", "back", "fps", "size"
    unused = [f"--{name}" for name in names if getattr(options, name) not in (None, False, [])]
    if unused or options.b is None:
        raise FinloopError(
            f"a trial page ({PAGE}) with {', '.join(unused) or 'one drawing'}",
            "two drawings alone: the page shows all methods and pairs, in its own size and time",
            "give two drawings without these options, or another ending of the output",
        )
    a, b = load_svg(options.a), load_svg(options.b)
    content, summary = trial.build_trial_page(
        a,
        b,
        load_pairing(options.pairs) if options.pairs else None,
        (shlex.quote(str(options.a)), shlex.quote(str(options.b))),
        trial.TrialOptions(frames, points, *_curve_options(options)),
    )
    save_bytes(options.output, content.encode())
    return "; ".join(filter(None, [summary, describe_unpainted(a, b)]))


def _summarise_morph(result: Morph) -> str:
    """Return a line for the user: numbers of contours and frames of a morph, and where it folds."""
    frames = len(result.tau)
    text = f"{len(result.layers)} contours, {frames} frames, "
    if covered := result.count_cover_frames():
        text += f"pieces cover each other: {format_frame_counts(covered, frames)}; "
    if folded := result.count_fold_frames():
        return text + f"folds: {format_frame_counts(folded, frames)}"
    if all(result.continuous.values()):
        return text + "no folds, neither in a frame nor between frames"
    unproved = ", ".join(name for name, proved in result.continuous.items() if not proved)
    return text + f"no folds in a frame; between frames not proved for {unproved}"


def _build_parser(program: str) -> argparse.ArgumentParser:
    """Return the parser of the command line's options."""
    parser = argparse.ArgumentParser(
        prog=program,
        description="Morph one drawing into another; shapes of the same id form a pair. Or move"
        " one by forces.",
    )
    parser.add_argument("a", type=Path, help="the first drawing, SVG")
    parser.add_argument("b", type=Path, nargs="?", help="the second drawing; none with --force")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        help=f"output file: {', '.join(ENDINGS)}, or {PAGE}: a trial page",
    )
    parser.add_argument("--pairs", type=Path, help=f"YAML: {FORM}")
    parser.add_argument(
        "--method", choices=METHODS, help="default fold_free, or physical by forces"
    )
    parser.add_argument(
        "--force",
        action="append",
        default=[],
        help=f"{FORMS}; may be repeated; a shape that a force names stands still",
    )
    parser.add_argument(
        "--frames",
        type=int,
        help=f"including both ends (default {FRAMES}, of a page {trial.FRAMES})",
    )
    parser.add_argument("--fps", type=parse_frame_rate, help=f"frames/s (default {FPS})")
    parser.add_argument(
        "--points", type=int, help=f"per contour (default {POINTS}, of a page {trial.POINTS})"
    )
    parser.add_argument(
        "--size", type=int, help=f"longer side of .webp and .mp4, px (default {SIZE_PX})"
    )
    parser.add_argument("--back", action="store_true", help="append the morph in reverse")
    add_resolution_options(parser, "the physical stiffness", FULL.wavelet)
    usual = PhysicalOptions()
    parser.add_argument("--elastic", type=float, default=usual.elastic, help="physical: stiffness")
    parser.add_argument("--damping", type=float, default=usual.damping, help="physical: damping")
    parser.add_argument("--mass", type=float, default=usual.mass, help="physical: mass")
    parser.add_argument(
        "--stiffness-damping",
        type=float,
        default=usual.stiffness_damping,
        help="physical: damping of changes of shape (s2), default 0",
    )
    return parser
