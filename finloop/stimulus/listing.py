"""A listing of what a protocol will show, in words and tables."""

from collections.abc import Iterator, Sequence

from finloop.stimulus.order import Trial, find_source_trial
from finloop.stimulus.protocol import Condition, Motion, Protocol
from finloop.stimulus.tracker import TrackerSettings, fit_calibration, refuse_other_tank

_ORDERS = {"given": "in the order given", "shuffled": "shuffled", "blocks": "in blocks"}
_KEYS = {" ": "space bar", "Enter": "enter key"}
_TEXT = ("condition", "motion", "look", "change")
"""Columns of words, aligned to the left."""


def describe_protocol(protocol: Protocol, trials: tuple[Trial, ...]) -> str:
    """Return a text with the duration, requirements, conditions and trials of a protocol."""
    seconds = sum(trial.seconds for trial in trials) + protocol.pause_s * (len(trials) - 1)
    waits = "" if protocol.start == "auto" else " and the waits for a start"
    return "\n".join([
        f"{protocol.name}: {len(trials)} trials, {_ORDERS[protocol.order]}; seed {protocol.seed}",
        f"{protocol.fish} fish, animated by mode matching",
        f"takes {_clock_time(seconds)}{waits}",
        "", *(f"required: {requirement}" for requirement in list_requirements(protocol)),
        "", *_condition_lines(protocol),
        "", *_trial_lines(protocol, trials),
    ])  # fmt: skip


def list_requirements(protocol: Protocol) -> Iterator[str]:
    """Yield a phrase for each thing that a protocol needs, such as a display or a tracker."""
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


def describe_points(settings: TrackerSettings, width: float, height: float) -> str:
    """Return a text that says where the tracker's points fall in the tank; "" without points.

    width, height: of the tank's picture, px. FinloopError if they are those of another tank, or no
    view of the tank shows them.
    """
    if not settings.points:
        return ""
    refuse_other_tank(settings, width, height)
    fit = fit_calibration(settings, None)
    rows = [
        (_place(pair.tracker), _place(pair.tank), _place(fit.map_place(*pair.tracker)))
        for pair in settings.points
    ]
    return "\n".join([
        f"the tracker's points in px of the tank, which is {width:g} × {height:g}:",
        *_aligned_table(("sent", "as written", "as it is used"), rows),
    ])  # fmt: skip


def _place(place: tuple[float, float]) -> str:
    """Return a place in words, such as "(12.5, 0.0)"."""
    return "({:.1f}, {:.1f})".format(*(round(value, 1) + 0.0 for value in place))  # no -0.0


def _condition_lines(protocol: Protocol) -> Iterator[str]:
    """Yield the lines of a table of the conditions, then which of them show the same motion."""
    rows, same_motion = [], dict[str, list[str]]()
    for name, condition in protocol.conditions.items():
        rows.append((name, f"{condition.seconds:g}", *_describe_condition(condition)))
        # Equal words get equal seeds. But a rule's motion depends on the animals, too, and `again`
        # names its twin in its own line.
        if condition.motion.kind not in ("rule", "again"):
            same_motion.setdefault(condition.motion.text, []).append(name)
    yield from _aligned_table(("condition", "seconds", "motion", "look", "change"), rows)
    for names in same_motion.values():
        if len(names) > 1:
            yield f"the very same motion in each repeat: {', '.join(names)}"


def _describe_condition(condition: Condition) -> tuple[str, str, str]:
    """Return the motion, the look and the change of a condition, each in words."""
    look, change = condition.look, condition.change
    looks = [
        look.shape,
        "" if look.contrast == 1 else f"contrast {look.contrast:g}",
        "" if look.size == 1 else f"size {look.size:g}",
        "" if look.colour is None else f"colour {'-'.join(map(str, look.colour))}",
    ]
    changes = [] if change is None else [
        "still" if change.still else "",
        "reversed" if change.reversed else "",
        "" if change.speed == 1 else f"{change.speed:g} times as fast",
    ]  # fmt: skip
    look_words, change_words = (", ".join(filter(None, words)) for words in (looks, changes))
    return _describe_motion(condition.motion), look_words, change_words or "none"


def _describe_motion(motion: Motion) -> str:
    """Return a motion in words, such as "along wall.csv" or "in a group"."""
    match motion.kind:
        case "goal" | "goals":
            places = motion.goals or [motion.goal or ()]
            first = ["(" + ", ".join(f"{part:g}" for part in place) + ")" for place in places[:3]]
            more = f" and {len(places) - 3} more" if len(places) > 3 else ""
            return "to " + ", ".join(first) + more
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
    details = [f"{key} {value}" for key, value in values.items() if key != "rule"]
    return ", ".join([str(motion.rule.rule), *details])


def _trial_lines(protocol: Protocol, trials: tuple[Trial, ...]) -> Iterator[str]:
    """Yield the lines of a table of the trials, with the times at which they begin."""
    begin_s, rows = 0.0, []
    for trial in trials:
        source = find_source_trial(protocol, trials, trial)
        seed = str(trial.seed) if source is None else f"as trial {source.number}"
        numbers = str(trial.number), _clock_time(begin_s), str(trial.block), str(trial.repeat)
        rows.append((*numbers, trial.condition, f"{trial.seconds:g}", seed))
        begin_s += trial.seconds + protocol.pause_s
    begin_head = "from" if protocol.start == "auto" else "from, at the earliest"
    yield from _aligned_table(
        ("trial", begin_head, "block", "repeat", "condition", "seconds", "seed"), rows
    )


def _aligned_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a table: columns in `_TEXT` aligned to the left, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    for row in (head, *rows):
        cells = [
            cell.ljust(width) if name in _TEXT else cell.rjust(width)
            for name, cell, width in zip(head, row, widths, strict=True)
        ]
        yield "  ".join(cells).rstrip()


def _clock_time(seconds: float) -> str:
    """Return a duration as hours:minutes:seconds."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{rest:02}"
