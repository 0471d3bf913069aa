"""The parts of a protocol: motion, look, change, condition, display, animals, start, trigger.

Every field has its meaning, unit and range. Types are strict, and unknown keys are refused.
"""

import json
import re
from pathlib import Path
from string import Formatter
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PrivateAttr, model_validator

from finloop.stimulus.rules import RuleSpec
from finloop.stimulus.tracker import TrackerSettings

KEYS = {"space": " ", "enter": "Enter"}
"""Names of keys, and their names in the browser."""
TRIGGER_WORDS = ("trial", "condition", "block", "repeat", "at")
"""Names that a trigger's text may contain in braces."""


def _printable(text: str) -> str:
    if not text.isprintable() or text != text.strip():
        raise ValueError("should be printable text without spaces around it")
    return text


def _receiver(to: str) -> str:
    udp = re.fullmatch(r"udp://[A-Za-z0-9.-]+:([0-9]{1,5})", to)
    if to != "socket" and not (udp and 0 < int(udp[1]) < 65_536):
        raise ValueError("should be socket, or udp://host:port")
    return to


def _key(name: str) -> str:
    """Return the browser's name of a key; a name of the browser stays."""
    key = KEYS.get(name, name)
    if key not in KEYS.values() and (len(key) != 1 or not key.isprintable()):
        raise ValueError(f"should be {', '.join(KEYS)}, or one character")
    return key


def _template(text: str) -> str:
    try:
        parts = list(Formatter().parse(text))
    except ValueError:
        parts = [("", "", "", None)]
    if any(name not in (*TRIGGER_WORDS, None) or form or kind for _, name, form, kind in parts):
        words = ", ".join(f"{{{word}}}" for word in TRIGGER_WORDS)
        raise ValueError(f"may name {words} in braces; write any other brace twice: {{{{ and }}}}")
    return text


Name = Annotated[str, Field(min_length=1, max_length=80), AfterValidator(_printable)]
File = Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_printable)]
Share = Annotated[float, Field(ge=0, le=1)]
Place = tuple[Share, Share]
Level = Annotated[int, Field(ge=0, le=255)]


class Part(BaseModel):
    """A part of a protocol, with exactly the named fields and types."""

    model_config = ConfigDict(
        strict=True, extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


class Motion(Part):
    """What the fish do: exactly one of these fields is given."""

    goal: Place | None = None
    """All fish swim to one goal, then wander: x, y, shares (0..1) of the tank's width and height
    from the upper left."""
    goals: Annotated[tuple[Place, ...], Field(min_length=1, max_length=500)] | None = None
    """Goals one after the other, then the fish wander: 1..500 places as `goal` has them."""
    path: File | None = None
    """Along a path: a file .csv, .parquet or .svg, relative to the protocol's folder. Places are
    shares of the tank unless the columns name a unit."""
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
        given = [name for name in Motion.model_fields if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                f"should be exactly one of {', '.join(Motion.model_fields)}; "
                f"it is {' and '.join(given) or 'none'}"
            )
        return self

    @property
    def file(self) -> Path:
        """Return the path's file, in the protocol's folder."""
        return self._folder / (self.path or "")

    @property
    def kind(self) -> str:
        """Return the name of the one field that is given."""
        return next(name for name in Motion.model_fields if getattr(self, name) is not None)

    @property
    def text(self) -> str:
        """Return the motion as JSON text, the same for motions that are the same."""
        values = self.model_dump(mode="json", exclude_defaults=True)
        return json.dumps(values, sort_keys=True, separators=(",", ":"))


class Look(Part):
    """How a fish is drawn; its motion stays the same."""

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
        if self.colour is not None and self.shape == "fish":
            raise ValueError("colour is of a dot or a silhouette; a fish has its own")
        return self

    @property
    def message(self) -> dict[str, Any]:
        """Return the look for the display's page, ready for JSON: as, contrast, size, colour."""
        return self.model_dump(mode="json", by_alias=True)


class Change(Part):
    """A change of a motion that is known before it is shown."""

    speed: Annotated[float, Field(ge=0.1, le=8)] = 1.0
    """0.1..8 times as fast."""
    reversed: bool = False
    """Backwards in time: the last tick first, the fish tail first."""
    still: bool = False
    """The first moment is held."""

    @model_validator(mode="after")
    def _moves(self) -> "Change":
        if self.still and (self.reversed or self.speed != 1):
            raise ValueError("what is still has no speed and no direction; leave out one of them")
        return self


class Condition(Part):
    """What is shown in a trial: a motion, how it is changed, and how the fish look."""

    seconds: Annotated[float, Field(ge=0.1, le=86_400)]
    """Duration of a trial, s, 0.1..86400, fades included. A motion at twice the speed is shown as
    long, and gets twice as far."""
    motion: Motion
    """What the fish do."""
    look: Look = Look()
    """How the fish are drawn."""
    change: Change | None = None
    """The change of the motion; null: none."""


class Display(Part):
    """What a protocol requires of the display."""

    fish_mm: Annotated[float, Field(gt=0, le=10_000)] | None = None
    """Length of a fish on the display, mm, above 0; null: from the display's calibration."""
    calibrated: bool = True
    """Whether the display must be calibrated."""


class Animals(TrackerSettings):
    """Live animals reported by a tracker: its unit, y axis, points, and when an animal is lost."""

    gap_s: Annotated[float, Field(gt=0, le=60)] = 0.5
    """An animal without messages for this time, s, above 0..60, is lost."""


class Start(Part):
    """What starts a trial that does not start by itself: a key, or a message."""

    key: Annotated[str, AfterValidator(_key)] | None = None
    """A key that is pressed at the display: space, enter, or one character."""
    message: Name | None = None
    """The name of a message of the network, {"do":"trigger","name":…}: up to 80 characters."""

    @model_validator(mode="after")
    def _check_one_start(self) -> "Start":
        if (self.key is None) == (self.message is None):
            raise ValueError("should be exactly one of key, message")
        return self


class Trigger(Part):
    """A message that is sent when a trial starts or ends."""

    at: Literal["start", "end"]
    """When it is sent."""
    to: Annotated[str, AfterValidator(_receiver)]
    """udp://host:port, or socket: all programs connected to the WebSocket of the animals."""
    text: Annotated[str, Field(min_length=1, max_length=1000), AfterValidator(_template)]
    """1..1000 characters; {trial}, {condition}, {block}, {repeat} and {at} are filled in."""
