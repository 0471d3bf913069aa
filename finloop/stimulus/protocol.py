"""A protocol: what is shown to animals, in which conditions, how often, and in which order.

It is a YAML file that `finloop.stimulus.protocol_file` reads; examples/protocol.yaml is one. Every
field has its meaning, unit and range here. Types are strict, and unknown keys are refused.

Conditions with the same motion show the very same motion: the seed of a trial's motion depends only
on the protocol's seed, the motion's own text and the number of the repeat. So a control differs
from its stimulus in its look or its change, and in nothing else.
"""

import hashlib
import json
import re
from contextlib import suppress
from pathlib import Path
from string import Formatter
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, PrivateAttr, Tag, model_validator

from finloop.show.message import StrictModel
from finloop.stimulus.tracker import TrackerSettings

MOST_FISH = 64
MOST_TRIALS = 10_000
MOST_DELAY_S = 60.0
"""How long ago the place may be that a fish copies."""
KEYS = {"space": " ", "enter": "Enter"}
"""Names of keys, and their names in the browser."""
TRIGGER_WORDS = ("trial", "condition", "block", "repeat", "at")
"""Names that a trigger's text may contain in braces."""
NEAREST = "nearest"
"""The name of the live animal that is nearest to the fish."""
_FIELDS_OF_RULES = {
    "distance": ("keep distance", "follow", "lead", "avoid"),
    "delay_s": ("copy",),
    "axis": ("mirror",),
}


def _check_printable(text: str) -> str:
    """Return a text unchanged; ValueError if it has unprintable characters or spaces around it."""
    if not text.isprintable() or text != text.strip():
        raise ValueError("should be printable text without spaces around it")
    return text


def _check_receiver(to: str) -> str:
    """Return a trigger's receiver unchanged; ValueError if it is not socket or udp://host:port."""
    udp = re.fullmatch(r"udp://[A-Za-z0-9.-]+:([0-9]{1,5})", to)
    if to != "socket" and not (udp and 0 < int(udp[1]) < 65_536):
        raise ValueError("should be socket, or udp://host:port")
    return to


def _browser_key(name: str) -> str:
    """Return the browser's name of a key, such as " " for space; ValueError if it is unknown."""
    key = KEYS.get(name, name)
    if key not in KEYS.values() and (len(key) != 1 or not key.isprintable()):
        raise ValueError(f"should be {', '.join(KEYS)}, or one character")
    return key


def _check_template(text: str) -> str:
    """Return a trigger's text unchanged; ValueError if braces hold anything but `TRIGGER_WORDS`."""
    known = (*TRIGGER_WORDS, None)  # None: a piece of text without braces
    with suppress(ValueError):  # a brace without its counterpart
        if all(
            name in known and not format_spec and not conversion
            for _, name, format_spec, conversion in Formatter().parse(text)
        ):
            return text
    words = ", ".join(f"{{{word}}}" for word in TRIGGER_WORDS)
    raise ValueError(f"may name {words} in braces; write any other brace twice: {{{{ and }}}}")


Name = Annotated[str, Field(min_length=1, max_length=80), AfterValidator(_check_printable)]
File = Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_check_printable)]
Share = Annotated[float, Field(ge=0, le=1)]
Place = tuple[Share, Share]
Level = Annotated[int, Field(ge=0, le=255)]


class RuleSpec(StrictModel):
    """The rule by which the fish react to a live animal."""

    rule: Literal["approach", "keep distance", "follow", "lead", "avoid", "copy", "mirror"]
    """approach: to the animal; keep distance: at `distance` from it, on the line from it to the
    fish; follow: `distance` behind it; lead: `distance` ahead of it; avoid: away while it is
    nearer than that; copy: to where it was some time ago; mirror: to its mirror image."""
    animal: Annotated[str, Field(min_length=1, max_length=40)] = NEAREST
    """The tracker's id of an animal, or nearest: the one nearest to the fish."""
    distance: Annotated[float, Field(gt=0, le=100)] = 1.0
    """Body lengths, above 0..100; of keep distance, follow, lead and avoid."""
    delay_s: Annotated[float, Field(ge=0, le=MOST_DELAY_S)] = 1.0
    """How long ago the animal was where the fish swims to, s, 0..60; of copy."""
    axis: Literal["x", "y", "centre"] = "centre"
    """What is mirrored about the tank's middle: x (left and right change places), y (top and
    bottom), or centre (both); of mirror."""
    renew: Annotated[float, Field(ge=0, le=10)] = 0.25
    """Body lengths, 0..10, by which the place must move before the fish decides anew."""

    @model_validator(mode="after")
    def _refuse_unused_values(self) -> "RuleSpec":
        """Return the rule; ValueError if a field that it does not use differs from its default."""
        for name, rules in _FIELDS_OF_RULES.items():
            differs = getattr(self, name) != RuleSpec.model_fields[name].default
            if differs and self.rule not in rules:
                raise ValueError(f"{name} is of {', '.join(rules)}; {self.rule} has none")
        return self


class Motion(StrictModel):
    """What the fish do in a condition; exactly one of these fields is given."""

    goal: Place | None = None
    """All fish swim to one goal, then wander: x, y, shares (0..1) of the picture's width and height
    from the upper left."""
    goals: Annotated[tuple[Place, ...], Field(min_length=1, max_length=500)] | None = None
    """Goals one after the other, then the fish wander: 1..500 places as `goal` has them."""
    path: File | None = None
    """Along a path: a file .csv, .parquet or .svg, relative to the protocol's folder. Places are
    shares of the tank, the box around where fish may swim, unless the columns name a unit."""
    rule: RuleSpec | None = None
    """By a rule towards a live animal; the motion is known only as it is shown."""
    company: Literal[True] | None = None
    """In a group with the other fish on the display, as the film's fish are: true."""
    wander: Literal[True] | None = None
    """Wander: true."""
    again: Name | None = None
    """The very motion of the latest trial of another condition: its name (yoked)."""
    _folder: Path = PrivateAttr(default=Path())

    @model_validator(mode="after")
    def _check_one_motion(self) -> "Motion":
        """Return the motion; ValueError if it has no field or several."""
        if len(self._given_fields) != 1:
            raise ValueError(
                f"should be exactly one of {', '.join(Motion.model_fields)}; "
                f"it is {' and '.join(self._given_fields) or 'none'}"
            )
        return self

    @property
    def _given_fields(self) -> list[str]:
        """Return the names of the fields that are given."""
        return [name for name in Motion.model_fields if getattr(self, name) is not None]

    @property
    def file(self) -> Path:
        """Return the file of the path to follow, relative paths within the protocol's folder."""
        return self._folder / (self.path or "")

    @property
    def kind(self) -> str:
        """Return the name of the only field that is given."""
        return self._given_fields[0]

    @property
    def text(self) -> str:
        """Return the motion as JSON text, equal for equal motions."""
        values = self.model_dump(mode="json", exclude_defaults=True)
        return json.dumps(values, sort_keys=True, separators=(",", ":"))


class Look(StrictModel):
    """How a fish is drawn; its motion does not depend on it."""

    shape: Literal["fish", "dot", "silhouette"] = Field(default="fish", alias="as")
    """The fish as filmed, a dot of the fish's area, or the fish's outline, filled."""
    contrast: Annotated[float, Field(ge=0, le=4)] = 1.0
    """0..4 times that of the film; 0 is the background."""
    size: Annotated[float, Field(ge=0.1, le=10)] = 1.0
    """0.1..10 times as long; the path stays the same."""
    colour: tuple[Level, Level, Level] | None = None
    """Red, green, blue (0..255) of a dot or a silhouette; null: the darkest of the fish."""

    @model_validator(mode="after")
    def _check_colour(self) -> "Look":
        """Return the look; ValueError if a fish that is drawn as filmed has a colour."""
        if self.colour is not None and self.shape == "fish":
            raise ValueError("colour is of a dot or a silhouette; a fish has its own")
        return self

    @property
    def to_json_values(self) -> dict[str, Any]:
        """Return the look as values for JSON, by the keys `as`, `contrast`, `size`, `colour`."""
        return self.model_dump(mode="json", by_alias=True)


class MotionChange(StrictModel):
    """How a motion is changed before it is shown: faster, backwards or still."""

    speed: Annotated[float, Field(ge=0.1, le=8)] = 1.0
    """0.1..8 times as fast."""
    reversed: bool = False
    """Backwards in time: the last tick first, the fish tail first."""
    still: bool = False
    """The first moment is held."""

    @model_validator(mode="after")
    def _check_movement(self) -> "MotionChange":
        """Return the change; ValueError if a still motion has a speed or a direction."""
        if self.still and (self.reversed or self.speed != 1):
            raise ValueError("what is still has no speed and no direction; leave out one of them")
        return self


class Condition(StrictModel):
    """What is shown in a trial: a motion, how it is changed, and how the fish look."""

    seconds: Annotated[float, Field(ge=0.1, le=86_400)]
    """Duration of a trial, s, 0.1..86400, fades included. A motion at twice the speed is shown as
    long, and gets twice as far."""
    motion: Motion
    """What the fish do."""
    look: Look = Look()
    """How the fish are drawn."""
    change: MotionChange | None = None
    """The change of the motion; null: none."""


class DisplayRequirements(StrictModel):
    """What a protocol requires of the display."""

    fish_mm: Annotated[float, Field(gt=0, le=10_000)] | None = None
    """Length of a fish on the display, mm, above 0; null: from the display's calibration."""
    calibrated: bool = True
    """Whether the display must be calibrated."""


class AnimalSettings(TrackerSettings):
    """Live animals reported by a tracker: its unit, y axis, points, and when an animal is lost."""

    gap_s: Annotated[float, Field(gt=0, le=60)] = 0.5
    """An animal without messages for this time, s, above 0..60, is lost."""


class TrialStart(StrictModel):
    """What starts a trial that does not start by itself: a key, or a message."""

    key: Annotated[str, AfterValidator(_browser_key)] | None = None
    """A key that is pressed at the display: space, enter, or one character."""
    message: Name | None = None
    """The name of a message of the network, {"do":"trigger","name":…}: up to 80 characters."""

    @model_validator(mode="after")
    def _check_one_start(self) -> "TrialStart":
        """Return the start; ValueError if it has both or neither of key and message."""
        if (self.key is None) == (self.message is None):
            raise ValueError("should be exactly one of key, message")
        return self


class Trigger(StrictModel):
    """A message that is sent when a trial starts or ends."""

    at: Literal["start", "end"]
    """When it is sent."""
    to: Annotated[str, AfterValidator(_check_receiver)]
    """udp://host:port, or socket: all programs connected to the WebSocket of the animals."""
    text: Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_check_template)]
    """1..1000 characters; {trial}, {condition}, {block}, {repeat} and {at} are filled in."""


class Protocol(StrictModel):
    """All that a session shows, and in which order; it is read by `load_protocol`."""

    version: Literal[1]
    """Version of this format: 1."""
    name: Name
    """Name of the protocol: up to 80 characters."""
    seed: Annotated[int, Field(ge=0, lt=2**53)]
    """Seed of the order and of all motions: 0..2^53 - 1."""
    fish: Annotated[int, Field(ge=1, le=MOST_FISH)] = 1
    """How many fish are shown: 1..64."""
    display: DisplayRequirements = DisplayRequirements()
    """Requirements of the display."""
    animals: AnimalSettings | None = None
    """Live animals; null: there are none, and no rule towards one."""
    pause_s: Annotated[float, Field(ge=0, le=86_400)] = 0.0
    """Between two trials, s, 0..86400: the empty tank."""
    repeats: Annotated[int, Field(ge=1, le=MOST_TRIALS)] = 1
    """How often each condition is shown: 1..10000."""
    order: Literal["given", "shuffled", "blocks"] = "given"
    """Order of the trials: as listed, again and again; all shuffled; or in blocks, each with every
    condition once, shuffled, and none twice in a row."""
    start: Annotated[
        Annotated[Literal["auto"], Tag("auto")] | Annotated[TrialStart, Tag("wait")],
        Discriminator(lambda start: "auto" if isinstance(start, str) else "wait"),
    ] = "auto"
    """What starts each trial: auto, after the pause; {key: space}; or {message: its name}."""
    fade_s: Annotated[float, Field(ge=0, le=60)] = 0.0
    """Time for which the fish fade in and out at both ends of a trial, s, 0..60."""
    triggers: Annotated[tuple[Trigger, ...], Field(max_length=20)] = ()
    """Messages that are sent, 0..20."""
    conditions: Annotated[dict[Name, Condition], Field(min_length=1, max_length=200)]
    """By their names, 1..200."""

    @property
    def start_key(self) -> str | None:
        """Return the key that starts a trial, by its name in the browser; None: no key does."""
        return None if self.start == "auto" else self.start.key

    @property
    def start_message(self) -> str | None:
        """Return the name of the message that starts a trial; None: no message does."""
        return None if self.start == "auto" else self.start.message

    @property
    def looks(self) -> list[Look]:
        """Return all different looks of the conditions; fish name their look by its index here."""
        return list(dict.fromkeys(condition.look for condition in self.conditions.values()))


def derive_motion_seed(protocol: Protocol, condition: str, repeat: int) -> int:
    """Return the seed (0 … 2^53 − 1) of a trial's motion, equal for conditions with equal motions.

    repeat: its number, from 1.
    """
    motion = protocol.conditions[condition].motion.text
    text = json.dumps([protocol.seed, motion, repeat])
    # The first 53 of the 256 bits: JavaScript and JSON hold such numbers exactly.
    return int.from_bytes(hashlib.sha256(text.encode()).digest()) >> (256 - 53)
