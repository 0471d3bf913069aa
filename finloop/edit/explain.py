"""A decision in words, for the live tank, from the numbers in the edit list."""

import math

from finloop.edit.schema import (
    AS_PREDICTED,
    ENTER,
    JUMP,
    NO_WAY,
    PHASE,
    PLAY,
    SPOT,
    TERMS,
    TURNING,
    WAITING,
    WALL,
)
from finloop.edit.stretch import Decision

_CHANCE = "chance"  # the term that is left out: it explains nothing
_LEAST_S = 0.05  # a term that costs less would be shown as 0.0


def in_words(decision: Decision, goal: str, motion_area: float) -> str:
    """Return a sentence that says why a stretch was chosen.

    goal: its name or ""; motion_area: the relative one that the network asked for.
    """
    why = _reason(decision, goal or "a place", motion_area)
    if not decision.exit:
        return why
    gate = "without a gateway"
    if not math.isnan(decision.seam):
        gate = f"by a gateway, {decision.seam:.2f} steps"
    cause = "the mode shows sprites"
    if decision.exit == NO_WAY:
        cause = f"no legal way on ({_ways(decision)})"
    return f"leave the film {gate}: {cause}; {why}"


def _reason(decision: Decision, goal: str, motion_area: float) -> str:
    if decision.reason == TURNING:
        side, room = "left" if decision.turn_deg > 0 else "right", ""
        if decision.room < 1:
            room = ", little room" if decision.room > 0 else ", on the spot"
        return (
            f"turn {side} {abs(decision.turn_deg):.0f}° towards {goal}: the network asks for "
            f"motion area {motion_area:.2f}, the sprites have {decision.sprite_area:.2f}{room}"
        )
    sprites = {
        PHASE: f"like a stretch of the film from {decision.film_speed:.1f} body lengths/s on",
        WALL: "a wall is ahead",
        SPOT: f"no way stays in the tank ({_ways(decision)}): on the spot",
        WAITING: "other fish are in the way: wait",
        AS_PREDICTED: f"as predicted{_costs(decision)}",
    }
    if decision.reason in sprites:
        return sprites[decision.reason]
    how = {
        PLAY: "play on",
        JUMP: f"jump, {decision.seam:.2f} steps",
        ENTER: f"enter the film by a gateway, {decision.seam:.2f} steps",
    }
    leads = (
        f"quadrant {decision.quadrant} towards {goal}" if decision.quadrant else f"along a {goal}"
    )
    return f"{how[decision.reason]}: {leads}{_costs(decision)}"


def _costs(decision: Decision) -> str:
    """Return how many ways there were, the cost of the chosen one and that of the next best."""
    if not decision.ways:
        return "; as planned before"
    if math.isnan(decision.value_s):
        return f"; {_ways(decision)}"
    terms = dict(zip(TERMS, decision.taken_terms, strict=False))
    parts = [
        f"{name.replace('_', ' ')} {cost:.1f}".replace("-", "−")
        for name, cost in terms.items()
        if name != _CHANCE and abs(cost) >= _LEAST_S
    ]
    text = f"; {_ways(decision)}; {decision.value_s:.1f} s"
    if parts:
        text += f" ({', '.join(parts)})"
    if decision.other_terms:
        others = dict(zip(TERMS, decision.other_terms, strict=True))
        text += f", the next best {sum(others.values()) - others[_CHANCE]:.1f} s"
    return text


def _ways(decision: Decision) -> str:
    """Return how many ways there were, and how many of them fail each test of Fig. 19."""
    failed = {
        "leave the tank or end": decision.ways_tank,
        "lead away": decision.ways_quadrant,
        "head away": decision.ways_heading,
    }
    failures = [f"{count} {what}" for what, count in failed.items() if count]
    return ", ".join([f"{decision.ways} way{'s' * (decision.ways != 1)}", *failures])
