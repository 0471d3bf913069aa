"""Budgets of messages from outside: so many at once, refilled with time (a token bucket)."""

PAGE_MESSAGES, PAGE_MESSAGES_PER_S = 40, 20  # of a page: at once, and in a second


class Budget:
    """An amount that may be spent at once, and comes back with time."""

    def __init__(self, amount: float, back_per_s: float) -> None:
        """Begin with the whole amount; back_per_s: how much of it comes back in a second."""
        self._amount, self._back_per_s = amount, back_per_s
        self._left, self._since_s = amount, 0.0

    def spend(self, amount: float, now_s: float) -> bool:
        """Spend an amount if it is left at a time; return whether it was."""
        back = self._back_per_s * max(0.0, now_s - self._since_s)
        self._left, self._since_s = min(self._amount, self._left + back), now_s
        if amount > self._left:
            return False
        self._left -= amount
        return True
