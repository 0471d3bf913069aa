"""Show the parameters as a table: in the terminal, and as docs/parameters.md."""

from stages.run import run  # isort: skip

import argparse
import shutil
import textwrap
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path

import yaml

from finloop.base.errors import FinloopError
from finloop.base.parameter_help import ParameterHelp, list_parameters, parameter_help
from finloop.base.settings import CONF, GROUPS, variants
from finloop.io.atomic import save_bytes

PAGE = Path("docs/parameters.md")
_HEAD = """# Parameters

Every parameter of the pipeline: its value, unit, range and meaning, as `conf/` has them.
`make docs` writes this page. Set one with `make params S="sprites.page_px=2048"`;
print a group with `make params S="help=sprites"`.

Units: BL is a body length of the fish. Δ is the time over which motion is measured, 0.2 s or less;
finloop measures it in the film (`features.delta_s`). A natural step is the median difference
between two pictures of a fish that are Δ / 5 apart.
"""


def terminal_table(word: str, width: int, conf: Path = CONF) -> str:
    """Return value, range and meaning of each parameter of a group as text for the terminal.

    word: name of the group. width: of the text, in characters. conf: the folder conf/. FinloopError
    if there is no such group.
    """
    if word not in GROUPS:
        raise FinloopError(
            f"no group of parameters {word}", f"one of {', '.join(GROUPS)}", "take one of these"
        )
    lines, several = list[str](), len(variants(word)) > 1
    for entry in parameter_help(word, conf):
        if several and entry.group not in lines:
            lines.append(entry.group)
        lines.append(f"{word}.{entry.name}={_format_value(entry)}  [{entry.brackets}]")
        lines += textwrap.wrap(
            entry.meaning, width, initial_indent="    ", subsequent_indent="    "
        )
    return "\n".join(lines)


def _format_value(entry: ParameterHelp) -> str:
    """Return the value of a parameter as YAML on one line."""
    return yaml.safe_dump(entry.value, default_flow_style=True, width=200).split("\n")[0]


def parameters_page(entries: Iterable[ParameterHelp]) -> str:
    """Return the page of all parameters as Markdown, with a table for each group and variant.

    entries: those of a group and variant one after the other.
    """
    parts = [_HEAD]
    for name, group in groupby(entries, lambda entry: entry.group):
        parts += [
            f"\n## {name}\n\n| parameter | value | unit | range | meaning |\n",
            "|---|---|---|---|---|\n",
        ]
        for entry in group:
            name_and_value = f"`{entry.name}`", f"`{_format_value(entry)}`"
            cells = (*name_and_value, entry.unit, entry.range, entry.meaning)
            parts.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n")
    return "".join(parts)


def main() -> None:
    """Print the parameters of the groups on the command line, or write docs/parameters.md."""
    parser = argparse.ArgumentParser(prog="python -m stages.parameters", description=__doc__)
    parser.add_argument("--write", action="store_true", help=f"write {PAGE}")
    parser.add_argument("words", nargs="*", help="groups of parameters to print")
    arguments = parser.parse_args()
    if arguments.write:
        save_bytes(PAGE, parameters_page(list_parameters()).encode())
    for word in arguments.words:
        print(terminal_table(word, shutil.get_terminal_size().columns))


if __name__ == "__main__":
    run(main)
