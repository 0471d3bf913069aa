"""A listing of what a protocol will show, in words and tables."""

from collections.abc import Iterator, Sequence

from finloop.stimulus.order import Trial, source
from finloop.stimulus.parts import Change, Look, Motion
from finloop.stimulus.protocol import Protocol

_ORDERS = {"given": "in the order given", "shuffled": "shuffled", "blocks": "in blocks"}
_KEYS = {" ": "space bar", "Enter": "enter key"}
_TEXT = ("condition", "motion", "look", "change")
"""Columns of words, aligned to the left."""


def listing(protocol: Protocol, order: tuple[Trial, ...]) -> str:
    """Return a text that lists a protocol's duration, requirements, conditions and trials."""
    seconds = sum(trial.seconds for trial in order) + protocol.pause_s * (len(order) - 1)
    waits = "" if protocol.start == "auto" else " and the waits for a start"
    return "\n".join([
        f"{protocol.name}: {len(order)} trials, {_ORDERS[protocol.order]}; seed {protocol.seed}",
        f"{protocol.fish} fish, animated by mode matching",
        f"takes {_clock(seconds)}{waits}",
        "", *(f"required: {what}" for what in demands(protocol)),
        "", *_conditions(protocol), *_twins(protocol),
        "", *_trials(protocol, order),
    ])  # fmt: skip


def demands(protocol: Protocol) -> Iterator[str]:
    """Yield a phrase for each requirement of a start: display, tracker, key, message, receivers."""
    display, animals = protocol.display, protocol.animals
    yield "a calibrated display" if display.calibrated else "any display, calibrated or not"
    if display.fish_mm is not None:
        yield f"fish that are {display.fish_mm:g} mm long on the display"
    if animals is not None:
        points = f", {len(animals.points)} pairs of points" if animals.points else ""
        lost = f"lost after {animals.gap_s:g} s"
        yield f"live animals: a tracker that sends places in {animals.unit}{points}; {lost}"
    if protocol.start_key is not None:
        yield f"a key to start each trial: {_KEYS.get(protocol.start_key, protocol.start_key)}"
    if protocol.start_message is not None:
        yield f"a message to start each trial: {protocol.start_message}"
    for trigger in protocol.triggers:
        yield f"a receiver of the trigger at the {trigger.at} of each trial: {trigger.to}"


def _conditions(protocol: Protocol) -> Iterator[str]:
    return _table(
        ("condition", "seconds", "motion", "look", "change"),
        [
            (name, f"{one.seconds:g}", _motion(one.motion), _look(one.look), _change(one.change))
            for name, one in protocol.conditions.items()
        ],
    )


def _twins(protocol: Protocol) -> Iterator[str]:
    groups: dict[str, list[str]] = {}
    for name, condition in protocol.conditions.items():
        if condition.motion.kind not in ("rule", "again"):
            groups.setdefault(condition.motion.text, []).append(name)
    for names in groups.values():
        if len(names) > 1:
            yield f"the very same motion in each repeat: {', '.join(names)}"


def _trials(protocol: Protocol, order: tuple[Trial, ...]) -> Iterator[str]:
    begin, rows = 0.0, []
    for trial in order:
        of = source(protocol, order, trial)
        seed = str(trial.seed) if of is None else f"as trial {of.number}"
        seconds = f"{trial.seconds:g}"
        numbers = str(trial.number), _clock(begin), str(trial.block), str(trial.repeat)
        rows.append((*numbers, trial.condition, seconds, seed))
        begin += trial.seconds + protocol.pause_s
    when = "from" if protocol.start == "auto" else "from, at the earliest"
    return _table(("trial", when, "block", "repeat", "condition", "seconds", "seed"), rows)


def _motion(motion: Motion) -> str:
    match motion.kind:
        case "goal" | "goals":
            places = motion.goals or [motion.goal or ()]
            first = [f"({', '.join(f'{part:g}' for part in place)})" for place in places[:3]]
            return "to " + ", ".join(first) + f" and {len(places) - 3} more" * (len(places) > 3)
        case "path":
            return f"along {motion.path}"
        case "again":
            return f"that of {motion.again} again"
        case "company":
            return "in a group"
        case "wander":
            return "wanders"
    assert motion.rule is not None
    values = motion.rule.model_dump(mode="json", exclude_defaults=True)
    more = [f"{key} {value}" for key, value in values.items() if key != "rule"]
    return ", ".join([str(motion.rule.rule), *more])


def _look(look: Look) -> str:
    words: list[str] = [look.shape]
    words += [f"contrast {look.contrast:g}"] * (look.contrast != 1)
    words += [f"size {look.size:g}"] * (look.size != 1)
    words += [f"colour {'-'.join(map(str, look.colour or ()))}"] * (look.colour is not None)
    return ", ".join(words)


def _change(change: Change | None) -> str:
    if change is None:
        return "none"
    words = ["still"] * change.still + ["reversed"] * change.reversed
    words += [f"{change.speed:g} times as fast"] * (change.speed != 1)
    return ", ".join(words) or "none"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the rows: words to the left, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    for row in (head, *rows):
        cells = [
            cell.ljust(width) if name in _TEXT else cell.rjust(width)
            for name, cell, width in zip(head, row, widths, strict=True)
        ]
        yield "  ".join(cells).rstrip()


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}"
