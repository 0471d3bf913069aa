"""The one list of playing modes by name, with the texts for tables, pictures and pages."""

from typing import Annotated, Literal, NamedTuple, get_args

Mode = Literal["network", "loops", "hybrid", "matching"]
"""The name of a mode in settings, edit lists, metrics and live messages."""

RETARGET = "retarget"
"""In place of a mode, the name of the edit list that stage `retarget` makes of a recorded track."""

Shown = Annotated[Literal[Mode, "retarget"], "a mode or retarget"]
"""What can be drawn: the edit list of a mode, or the retargeted one."""


COLOURS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#F0E442",
)  # fmt: skip
"""The colours of the modes, in their order, as hex (Okabe-Ito); three are spare."""


class ModeFacts(NamedTuple):
    """Texts about a mode: title, source, one sentence; colour: of its curves, one of `COLOURS`."""

    title: str
    source: str
    sentence: str
    colour: str


MODES: dict[str, ModeFacts] = {
    "network": ModeFacts(
        "Network", "fish paper, §3, Fig. 18",
        "The trained network moves sprites in their orientations.", COLOURS[0],
    ),
    "loops": ModeFacts(
        "Loops", "fish paper, §4.1-4.2, Figs. 8-13",
        "Video loops of the film, chosen by the position table; nothing else.", COLOURS[1],
    ),
    "hybrid": ModeFacts(
        "Hybrid", "fish paper, §4.3, Fig. 19",
        "Video loops where they lead to the goal, the network between, joined by gateways.",
        COLOURS[2],
    ),
    "matching": ModeFacts(
        "Matching", "finloop",
        "One search over all frames, their mirror images and predictions; poses go on over joins.",
        COLOURS[3],
    ),
}  # fmt: skip
"""Every mode, in the order of tables and pictures."""

ONE_FISH = ("network", "loops", "hybrid")
"""Modes that move one fish, to goals or wandering: no paths, no group."""

assert tuple(MODES) == get_args(Mode)
