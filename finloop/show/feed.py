"""The messages to a display page: the empty tank, film pictures, and the states of all ticks.

Their form is that of `pack_message`; the text's `kind` says what a message is:

- hello: what is the same in a session; payload: the empty tank.
- picture: a picture of the film, for a slot of the page's memory; payload: its posture, its pixels.
- rows: the states of a tick, DRAWN (`finloop.show.drawn`). `cut`: those sent for that tick and
  later ones are void; the page goes on from what it shows to this state. `jump`: it shows this
  state at once.
- clear: shows no fish from now on. frame: states to draw unchanged, for a replay.
- say: a text in front of the display. pong: the answer to a ping, for the clocks.

A film of hours has more pictures than the page can hold. The slot that has not been needed for
longest is used again first.
"""

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

from finloop.base.arrays import Picture
from finloop.show.drawn import States
from finloop.show.page import pack_message
from finloop.show.pictures import PagePicture, list_shown_rows

MEMORY = 256 * 2**20  # bytes of all slots
FEWEST, MOST = 256, 1024  # slots; WebGL 2 promises 256
EARLY_S = 0.5
"""How long before they are due known ticks are sent."""
_KEPT_TICKS = 64  # the last ticks, which a page that connects now gets


class TankCanvas(NamedTuple):
    """The picture of the empty tank, and the size of the largest picture of a fish.

    floor: (h, w) or (h, w, 3) uint8. slot_width, slot_height: px.
    """

    floor: Picture
    slot_width: int
    slot_height: int


class Feed:
    """Makes the messages to a display page; it remembers which pictures the page has.

    slot_count: how many pictures the page keeps.
    """

    def __init__(
        self, tank: TankCanvas, facts: dict[str, Any], load_picture: Callable[[int], PagePicture]
    ) -> None:
        """Begin with a page that has no pictures; choose how many it shall keep.

        facts: values of the message `hello`, among them `fish` (how many) and `rate` (ticks/s);
        load_picture: returns a picture of the film by its row.
        """
        self.tank, self.facts, self._load_picture = tank, facts, load_picture
        # A fish needs two pictures a tick, from sending until just after display.
        needed = round(2 * facts["fish"] * (EARLY_S * facts["rate"] + 2))
        room = MEMORY // (tank.slot_width * tank.slot_height * 4)
        self.slot_count = max(FEWEST, needed, min(MOST, room))
        self._slots: OrderedDict[int, int] = OrderedDict()  # picture: slot, the newest last
        self._recent_states: dict[int, bytes] = {}  # messages, by tick

    def opening_messages(self) -> list[bytes]:
        """Return all messages that a new page needs: hello, pictures, and the last ticks' states.

        One picture is always among them: with the first the page prepares to draw, which is slow.
        """
        if not self._slots:
            self._slots[0] = 0  # the film's first picture
        floor = self.tank.floor
        hello = {
            "kind": "hello", "width": floor.shape[1], "height": floor.shape[0],
            "channels": 1 if floor.ndim == 2 else 3, "slots": self.slot_count,
            "slot_width": self.tank.slot_width, "slot_height": self.tank.slot_height, **self.facts,
        }  # fmt: skip
        pictures = [self._picture_message(number, slot) for number, slot in self._slots.items()]
        return [pack_message(hello, floor.tobytes()), *pictures, *self._recent_states.values()]

    def tick_messages(
        self, seq: int, tick: int, due_s: float, states: States, replanned: bool = False,
        jump: bool = False,
    ) -> list[bytes]:  # fmt: skip
        """Return the messages of one tick: pictures that the page lacks, then the fish's states.

        The message with the states is kept for pages that connect within the next ticks; seq: its
        number. tick: number within the trial. due_s: server's time at which to show it. replanned:
        whether states sent before for this tick and later ones are void. jump: whether to show it
        at once.
        """
        pictures = self.picture_messages(states)
        facts = {
            "kind": "rows",
            "seq": seq,
            "tick": tick,
            "due": due_s,
            "cut": replanned,
            "jump": jump,
        }
        self._recent_states = {
            old: sent
            for old, sent in self._recent_states.items()
            if tick - _KEPT_TICKS < old < tick
        }
        self._recent_states[tick] = pack_message(facts, states.tobytes())
        return [*pictures, self._recent_states[tick]]

    def frame_messages(self, number: int, states: States) -> list[bytes]:
        """Return the messages of a replayed frame: pictures that the page lacks, then states.

        number: of the frame. states (fish, fields): of its fish.
        """
        frame = pack_message({"kind": "frame", "number": number}, states.tobytes())
        return [*self.picture_messages(states), frame]

    def clear_message(self) -> bytes:
        """Return the message after which the page shows no fish; forget the last ticks."""
        self._recent_states = {}
        return pack_message({"kind": "clear"})

    def picture_messages(self, states: States) -> list[bytes]:
        """Return messages with the pictures that states (…, fields) name and that the page lacks.

        If the page's memory is full, the picture that was needed longest ago is overwritten.
        """
        messages = []
        # The slots are kept in the order of need, the latest last.
        for number in list_shown_rows(states):
            if number in self._slots:
                self._slots.move_to_end(number)
                continue
            has_room = len(self._slots) < self.slot_count
            slot = len(self._slots) if has_room else self._slots.popitem(last=False)[1]
            self._slots[number] = slot
            messages.append(self._picture_message(number, slot))
        return messages

    def _picture_message(self, number: int, slot: int) -> bytes:
        """Return the message with the picture of a film row, for a slot of the page's memory."""
        picture = self._load_picture(number)
        facts = {"kind": "picture", "slot": slot} | picture.describe(number)
        return pack_message(facts, picture.to_bytes())
