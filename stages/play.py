"""The live tank: `python -m stages.play` opens a local page on which the user sends the fish.

It is a program that reads the stages' results, not a stage; it writes nothing.
"""

from stages.run import open_in_browser, run  # isort: skip  (before numpy)

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from finloop.edit.modes import MODES, ONE_FISH
from finloop.edit.pictures import cross_fade_distance
from finloop.edit.schema import FRAME
from finloop.live.message import MOST_FISH
from finloop.live.server import create_tank_server
from finloop.live.tank import LiveTank, warm_up_paths
from finloop.live.view import TankView, make_tank_feed
from finloop.modes.animator import Animator
from finloop.modes.matching import NothingToUse
from finloop.project import Project
from finloop.render.gallery import PLACE, Gallery, build_cutout_sets
from finloop.show.pictures import PagePictures
from finloop.show.web import HOST, bind_socket
from stages.settings import load_settings

PORT = 8750


def open_modes(project: Project) -> dict[str, Animator]:
    """Return the animators of all modes for which the film shows enough, by mode.

    For each other mode, a note on stderr says what the film lacks. NothingToUse if no mode is left.
    """
    animators: dict[str, Animator] = {}
    # Mode `matching` continues a fish that another mode shows as a sprite from the sprite's row.
    options = {"matching": {"sprite_rows": project.sprites["row"].to_numpy()}}
    for mode in MODES:
        try:
            open_mode = import_module(f"stages.modes.{mode}").open_mode
            animators[mode] = open_mode(project, **options.get(mode, {}))
        except NothingToUse as error:
            print(f"{mode}: {error.came}", file=sys.stderr)
            last_error = error
    if not animators:
        raise last_error
    return animators


@contextmanager
def open_view(mode: str, fish_count: int | None, seed: int) -> Iterator[TankView]:
    """Yield the opened live tank with all that draws it.

    mode: of the first fish. fish_count: None = as many as `matching.fish`, or one in a mode of the
    paper; fewer if the tank has no room. seed: of the random choices.
    """
    animate = load_settings("animate")
    with Project() as project:
        animators = open_modes(project)
        players = {name: animator.player for name, animator in animators.items()}
        first = next(iter(animators.values()))  # the film is the same in all modes
        pictures, most_unlike = first.pictures, animate.fade_steps * first.step  # natural steps
        cutout_sets = build_cutout_sets({FRAME: project.cutouts}, project.tracks(PLACE), None)
        gallery = Gallery(cutout_sets, project.bodies)
        page_pictures = PagePictures(gallery, pictures.reel.scale)
        floor, rate_hz = project.background, first.player.world.motion.rate_hz
        feed = make_tank_feed(page_pictures, floor, rate_hz, project.bodies)

        def is_ghost(row: Any) -> bool:
            """Return whether a cross-fade would show a double image.

            row: of an edit list.
            """
            return row.mode != "matching" and cross_fade_distance(row, pictures) > most_unlike

        if "matching" in players:
            warm_up_paths(players["matching"])
        default_count = 1 if mode in ONE_FISH else min(load_settings("matching").fish, MOST_FISH)
        fish_count_wanted = fish_count or default_count
        # A goal in another tank loads the compiled functions of a reaction before a user waits.
        rehearsal = LiveTank(players, mode, 1, seed)
        rehearsal.send_to_goal(0, 0.0, 0.0)
        rehearsal.advance()
        tank = LiveTank(players, mode, fish_count_wanted, seed, is_ghost)
        if len(tank.fish) < fish_count_wanted:
            print(f"play: the tank has room for {len(tank.fish)} fish", file=sys.stderr)
        yield TankView(tank, feed, project.bodies)


def main() -> None:
    """Serve the page of the live tank until Ctrl-C."""
    options = _build_parser().parse_args()
    with bind_socket(options.port) as listens:
        url = f"http://{HOST}:{listens.getsockname()[1]}/"
        print("play: reading the stages' results ...", file=sys.stderr)

        def announce() -> None:
            """Print the page's address, and open the page unless --no-open is given."""
            print(f"play: the tank is open at {url} (Ctrl-C closes it)", file=sys.stderr)
            if options.open:
                open_in_browser(url)

        try:
            mode = options.mode or ("matching" if (options.fish or 1) > 1 else "hybrid")
            with open_view(mode, options.fish, options.seed) as view:
                create_tank_server(view, listens, announce).serve_until_stopped()
        except KeyboardInterrupt:
            print("\nplay: the tank is closed", file=sys.stderr)


def _build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m stages.play", description="A live tank on a local page."
    )
    add, fish = parser.add_argument, range(1, MOST_FISH + 1)
    help_fish = f"default: 1; in mode matching as matching.fish, at most {MOST_FISH}"
    add("--mode", choices=tuple(MODES), help="default hybrid; matching for several fish")
    add("--fish", type=int, choices=fish, help=help_fish)
    add("--port", type=int, default=PORT, help=f"default {PORT}; 0 = any free one")
    add("--seed", type=_parse_seed, default=0, help="default 0")
    add("--no-open", dest="open", action="store_false", help="do not open a browser")
    return parser


def _parse_seed(text: str) -> int:
    """Parse a command-line argument as a whole number, at least 0; else raise an error."""
    number = int(text)
    if number < 0:
        raise argparse.ArgumentTypeError(f"{text} is less than 0")
    return number


if __name__ == "__main__":
    run(main)
