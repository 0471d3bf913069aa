"""The messages of a page to the live tank: JSON, strictly parsed; all else is no message."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from finloop.edit.modes import Mode

MOST_FISH = 8
MOST_PLACES = 500  # of a path
LONGEST = 16_000  # bytes of a message
MOST_WEIGHT = 5.0  # of a zone
SLOWEST, FASTEST = 0.1, 8.0  # times as fast as filmed

Number = Annotated[int, Field(ge=0, lt=2**53)]
Place = Annotated[float, Field(ge=-1e5, le=1e5)]
Weight = Annotated[float, Field(ge=0, le=MOST_WEIGHT)]
Which = Annotated[int, Field(ge=0, lt=MOST_FISH)] | None  # None: every fish


class StrictModel(BaseModel):
    """A model with exactly the named fields and types, and finite numbers."""

    model_config = ConfigDict(
        strict=True, extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


class SetGoal(StrictModel):
    """Send a fish to a place, px of the tank's picture; fish: its number, None for all.

    drag: whether the user is dragging the goal.
    """

    do: Literal["goal"]
    fish: Which
    x: Place
    y: Place
    drag: bool


class SetPath(StrictModel):
    """Send a fish along a drawn path; fish: its number, None for all.

    places: x, y px of the tank's picture.
    """

    do: Literal["path"]
    fish: Which
    places: Annotated[tuple[tuple[Place, Place], ...], Field(min_length=1, max_length=MOST_PLACES)]


class SetRule(StrictModel):
    """Let a fish swim by a rule: in a group with the others, or behind the fish `leader`.

    fish: its number, None for all.
    """

    do: Literal["rule"]
    fish: Which
    leader: Which  # None: in a group


class Weights(StrictModel):
    """Set how strongly other fish repel, align and attract; 1 = as strong as the own direction."""

    do: Literal["weights"]
    repulsion: Weight
    alignment: Weight
    attraction: Weight


class Drop(StrictModel):
    """Let a fish forget its goal, path or rule, and wander; fish: its number, None for all."""

    do: Literal["drop"]
    fish: Which


class SetMode(StrictModel):
    """Let all fish swim on in another mode."""

    do: Literal["mode"]
    mode: Mode


class Pause(StrictModel):
    """Stop the tank (on: true), or let it go on (false)."""

    do: Literal["pause"]
    on: bool


class Step(StrictModel):
    """Advance the tank by one tick, and pause it."""

    do: Literal["step"]


class Speed(StrictModel):
    """Set the playback rate; times: relative to the film."""

    do: Literal["speed"]
    times: Annotated[float, Field(ge=SLOWEST, le=FASTEST)]


class PastTick(StrictModel):
    """Show a past tick, and pause there; None: return to the present."""

    do: Literal["look"]
    tick: Number | None


class SwimOn(StrictModel):
    """Let all fish swim on from a past tick; what came after it is forgotten."""

    do: Literal["swim_on"]
    tick: Number


class Explain(StrictModel):
    """Show the decisions of one fish from now on."""

    do: Literal["explain"]
    fish: Annotated[int, Field(ge=0, lt=MOST_FISH)]


class Count(StrictModel):
    """Set the number of fish in the tank."""

    do: Literal["count"]
    fish: Annotated[int, Field(ge=1, le=MOST_FISH)]


class Seen(StrictModel):
    """Report that the page has drawn the frame with this number."""

    do: Literal["seen"]
    frame: Number


PageRequest = (
    SetGoal
    | SetPath
    | SetRule
    | Weights
    | Drop
    | SetMode
    | Pause
    | Step
    | Speed
    | PastTick
    | SwimOn
    | Explain
    | Count
    | Seen
)
_REQUEST: TypeAdapter[PageRequest] = TypeAdapter(Annotated[PageRequest, Field(discriminator="do")])


def parse_message(text: str | bytes | None) -> PageRequest | None:
    """Return the message that a text is; None where it is too long, not JSON, or not valid."""
    if text is None or len(text) > LONGEST:
        return None
    try:
        return _REQUEST.validate_json(text)
    except (ValidationError, UnicodeError):
        return None
