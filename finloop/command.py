"""The command `finloop`: morph, gait, new, version."""

import argparse
import os
import sys
from pathlib import Path

from finloop.base.errors import FinloopError
from finloop.base.program import HOME, describe_program, holds_sources, shipped_folder

HELP = """\
finloop morph A.svg B.svg -o OUT.svg     turn one drawing into another
finloop gait 1.svg 2.svg --gait NAME …   make a drawing walk or swim
finloop new FOLDER                       make a repository for your own films
finloop version                          say which finloop runs, and where it is

`finloop morph --help` and `finloop gait --help` list their options."""
WORDS = "morph", "gait", "version", "new"
NEXT = """\
{folder} is a repository with a pipeline of its own. Next:
  cd {folder}
  make film FILM=/path/of/film.mp4   from film to report
README.md there says more."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command `finloop`; return the exit status. arguments: None = the command line's."""
    words = sys.argv[1:] if arguments is None else arguments
    folder = Path.cwd()
    # In the folder of a working copy of finloop, that copy runs, unless `python -P` forbids it.
    if holds_sources(folder) and folder.resolve() != HOME and not sys.flags.safe_path:
        os.execv(sys.executable, [sys.executable, "-m", "finloop.command", *words])
    if words[:1] == ["morph"]:
        from finloop.morph.tool import main as morph

        return morph(words[1:], "finloop morph")
    if words[:1] == ["gait"]:
        from finloop.gait.tool import main as gait

        return gait(words[1:], "finloop gait")
    parser = argparse.ArgumentParser(
        prog="finloop", description=HELP, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=describe_program())
    commands = parser.add_subparsers(dest="word", required=True, metavar=" | ".join(WORDS))
    for word in WORDS[:-1]:  # all but `new`, which takes an argument
        commands.add_parser(word)
    new = commands.add_parser("new", description="Make a lab's own repository.")
    new.add_argument("folder", type=Path, help="a new folder, or an empty one")
    options = parser.parse_args(words)
    if options.word == "version":
        print(describe_program())
        return 0
    return _make_lab_repository(options.folder)


def _make_lab_repository(folder: Path) -> int:
    """Create a lab's own repository; print next steps or an error; return the exit status."""
    from finloop.lab.new import make_repository

    try:
        repository = make_repository(folder)
    except FinloopError as error:
        print(f"finloop: {error}", file=sys.stderr)
        return 1
    print(NEXT.format(folder=repository))
    if shipped_folder() == HOME:
        print(f"This finloop is not installed: `pip install {HOME}` lets that folder find it.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
