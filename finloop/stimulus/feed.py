"""The messages to a display page: the empty tank, film pictures, and the states of all ticks.

A message is 4 bytes, the length of a JSON text, little end first; the text; a payload.

- hello: what is the same in a session; payload: the empty tank.
- picture: a picture of the film, for a slot of the page's memory; payload: its posture, its pixels.
- rows: the states of a tick, DRAWN (`finloop.stimulus.drawn`). `cut`: those sent for that tick and
  later ones are void; the page goes on from what it shows to this state.
- clear: shows no fish from now on. frame: states to draw unchanged, for a replay.
- say: a text in front of the display. pong: the answer to a ping, for the clocks.

A film of hours has more pictures than the page can hold. The slot that has not been needed for
longest is used again first.
"""

import json
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.stimulus.drawn import PARTNER, PICTURE
from finloop.stimulus.pictures import PagePicture

MEMORY = 256 * 2**20  # bytes of all slots
FEWEST, MOST = 256, 1024  # slots; WebGL 2 promises 256
EARLY_S = 0.5
"""How long before they are due known ticks are sent."""


class TankCanvas(NamedTuple):
    """The empty tank, (h, w) or (h, w, 3) uint8, and the size of the largest fish picture, px."""

    floor: NDArray[np.uint8]
    slot_width: int
    slot_height: int

    @property
    def channels(self) -> int:
        """Return the floor's number of colour channels, 1 or 3; a fish's picture adds alpha."""
        return 1 if self.floor.ndim == 2 else 3

    def slots(self, fish: int, rate_hz: float) -> int:
        """Return how many fish pictures the page keeps: what memory allows, at least those in use.

        In use are two pictures a fish and tick, from sending until just after display.
        """
        one = self.slot_width * self.slot_height * 4
        needed = round(2 * fish * (EARLY_S * rate_hz + 2))
        return max(FEWEST, needed, min(MOST, MEMORY // one))


def message(kind: str, payload: bytes = b"", **facts: Any) -> bytes:
    """Return a message to the page as bytes: length, JSON of `kind` and `facts`, payload."""
    text = json.dumps({"kind": kind, **facts}, separators=(",", ":")).encode()
    return len(text).to_bytes(4, "little") + text + payload


class Feed:
    """Makes the messages to a display page, and keeps track of the pictures that the page has.

    facts: values of the message `hello`, of which `fish` (their number) and `rate` (ticks/s) are
    required; picture: returns a picture of the film by its row.
    """

    def __init__(
        self, tank: TankCanvas, facts: dict[str, Any], picture: Callable[[int], PagePicture]
    ) -> None:
        self.tank, self.facts = tank, facts
        self.slots = tank.slots(facts["fish"], facts["rate"])
        self._picture = picture
        self._slots: OrderedDict[int, int] = OrderedDict()  # picture: slot, the newest last
        self._last: dict[int, bytes] = {}  # rows by tick, of the last ticks

    def begin(self) -> list[bytes]:
        """Return all messages that a new page needs: hello, pictures, and the last ticks' states.

        They include at least one picture: with the first one the page prepares to draw, which takes
        a while.
        """
        if not self._slots:
            self._slots[0] = 0
        height, width = self.tank.floor.shape[:2]
        hello = message(
            "hello", self.tank.floor.tobytes(), width=width, height=height,
            channels=self.tank.channels, slots=self.slots,
            slot_width=self.tank.slot_width, slot_height=self.tank.slot_height, **self.facts,
        )  # fmt: skip
        pictures = [self._picture_message(number, slot) for number, slot in self._slots.items()]
        return [hello, *pictures, *self._last.values()]

    def rows(
        self, seq: int, tick: int, due_s: float, states: NDArray[np.float32], cut: bool = False
    ) -> list[bytes]:
        """Return the messages of one tick's states (fish, F): missing pictures, then the states.

        seq: number of the message; tick: of the trial; due_s: when to show it, session time, s;
        cut: whether states that were sent for this tick and later ones are void.
        """
        made = self.pictures(states)
        rows = message("rows", states.tobytes(), seq=seq, tick=tick, due=due_s, cut=cut)
        self._last = {old: sent for old, sent in self._last.items() if tick - 64 < old < tick}
        self._last[tick] = rows
        return [*made, rows]

    def frame(self, number: int, states: NDArray[np.float32]) -> list[bytes]:
        """Return the messages of a replayed frame (fish, F): missing pictures, then the states."""
        return [*self.pictures(states), message("frame", states.tobytes(), number=number)]

    def clear(self) -> bytes:
        """Return the message after which the page shows no fish."""
        self._last = {}
        return message("clear")

    def pictures(self, states: NDArray[np.float32]) -> list[bytes]:
        """Return messages with the pictures that states (…, F) name and the page lacks."""
        made = []
        for number in np.unique(states[..., [PICTURE, PARTNER]]).astype(int).tolist():
            if number < 0:
                continue
            if number in self._slots:
                self._slots.move_to_end(number)
                continue
            free = len(self._slots) < self.slots
            slot = len(self._slots) if free else self._slots.popitem(last=False)[1]
            self._slots[number] = slot
            made.append(self._picture_message(number, slot))
        return made

    def _picture_message(self, number: int, slot: int) -> bytes:
        one = self._picture(number)
        height, width = one.pixels.shape[:2]
        return message(
            "picture", one.posture.astype("<f4").tobytes() + one.pixels.tobytes(), picture=number,
            slot=slot, width=width, height=height, line=[float(part) for part in one.line],
        )  # fmt: skip
