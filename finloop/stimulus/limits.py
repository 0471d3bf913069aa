"""How much of what comes from outside is heard, and how much of it is written into the log.

A program that sends without pause neither fills the disk nor drowns the session: what is too much
is counted, and goes no further. All limits depend on the session's clock alone.
"""

from collections import OrderedDict

from finloop.show.limits import Budget

_LEAST = 256  # bytes that a short message counts, about its row in the log
_HEARD = 2**20  # bytes a second, and at once: 4096 short messages
_REFUSALS, _EVENTS = 2**19, 2**18  # bytes at once …
_BACK_PER_S = 2**7  # … and a second: 450 KiB an hour
_MOST_SENDERS = 256  # remembered; the one not heard for longest is forgotten


class InputLimits:
    """The limits of a session: what is heard of each sender, and what is written without effect."""

    def __init__(self) -> None:
        """Begin without a sender."""
        self._senders: OrderedDict[str, Budget] = OrderedDict()  # that of the last message last
        self._refusals = Budget(_REFUSALS, _BACK_PER_S)
        self._events = Budget(_EVENTS, _BACK_PER_S)

    def may_hear(self, source: str, size: int, now_s: float) -> bool:
        """Return whether a message counts. source: its sender; size: bytes; now_s: its arrival."""
        budget = self._senders.pop(source, None) or Budget(_HEARD, _HEARD)
        self._senders[source] = budget
        if len(self._senders) > _MOST_SENDERS:
            self._senders.popitem(last=False)
        return budget.spend(max(size, _LEAST), now_s)

    def may_write_refusal(self, size: int, now_s: float) -> bool:
        """Return whether there is room in the log for a message that had no effect."""
        return self._refusals.spend(max(size, _LEAST), now_s)

    def may_write_event(self, size: int, now_s: float) -> bool:
        """Return whether there is room in the log for an event that a page or program caused."""
        return self._events.spend(max(size, _LEAST), now_s)
