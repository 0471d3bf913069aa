"""The messages of a page to the live tank: JSON, strictly parsed; all else is no message."""

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter

from finloop.edit.modes import Mode
from finloop.show.hub import TimeRequest
from finloop.show.message import Number, StrictModel, parse_json

MOST_FISH = 8
MOST_PLACES = 500  # of a path
LONGEST = 16_000  # bytes of a message
MOST_WEIGHT = 5.0  # of a zone
SLOWEST, FASTEST = 0.1, 8.0  # times as fast as filmed

Place = Annotated[float, Field(ge=-1e5, le=1e5)]
Weight = Annotated[float, Field(ge=0, le=MOST_WEIGHT)]
FishIndex = Annotated[int, Field(ge=0, lt=MOST_FISH)] | None  # None: every fish


class SetGoal(StrictModel):
    """Request to send a fish to a place.

    fish: its number, None for all. x, y: px of the tank's picture. drag: whether the user is
    dragging the goal.
    """

    do: Literal["goal"]
    fish: FishIndex
    x: Place
    y: Place
    drag: bool


class SetPath(StrictModel):
    """Request to send a fish along a drawn path.

    fish: its number, None for all. places: x, y px of the tank's picture.
    """

    do: Literal["path"]
    fish: FishIndex
    places: Annotated[tuple[tuple[Place, Place], ...], Field(min_length=1, max_length=MOST_PLACES)]


class SetRule(StrictModel):
    """Request to let a fish swim by a rule: in a group with the others, or behind a leader.

    fish, leader: numbers; fish None for all, leader None for a group.
    """

    do: Literal["rule"]
    fish: FishIndex
    leader: FishIndex


class SetZoneWeights(StrictModel):
    """Request to set how strongly other fish repel, align and attract a fish in a group.

    1 is as strong as the fish's own direction.
    """

    do: Literal["weights"]
    repulsion: Weight
    alignment: Weight
    attraction: Weight


class LetWander(StrictModel):
    """Request that a fish forgets its goal, path or rule, and wanders; fish: None for all."""

    do: Literal["drop"]
    fish: FishIndex


class SetMode(StrictModel):
    """Request that all fish swim on in another mode."""

    do: Literal["mode"]
    mode: Mode


class SetPaused(StrictModel):
    """Request to stop the tank, or the past that is played (on: true), or to let it go on."""

    do: Literal["pause"]
    on: bool


class AdvanceTick(StrictModel):
    """Request to advance the tank by one tick, and to pause it."""

    do: Literal["step"]


class SetPlaybackRate(StrictModel):
    """Request to set the playback rate; times: relative to the film."""

    do: Literal["speed"]
    times: Annotated[float, Field(ge=SLOWEST, le=FASTEST)]


class ShowPastTick(StrictModel):
    """Request to show a past tick, and to stay there; None: to return to the present."""

    do: Literal["look"]
    tick: Number | None


class BranchFromPast(StrictModel):
    """Request that all fish swim on from a past tick; the later ones are kept, to return to."""

    do: Literal["branch"]
    tick: Number


class ReturnToFuture(StrictModel):
    """Request to go on in a future that was left, by its number in the list of them."""

    do: Literal["return"]
    future: Annotated[int, Field(ge=0, lt=16)]


class ExplainFish(StrictModel):
    """Request to show the decisions of one fish from now on; fish: its number."""

    do: Literal["explain"]
    fish: Annotated[int, Field(ge=0, lt=MOST_FISH)]


class SetFishCount(StrictModel):
    """Request to set the number of fish in the tank."""

    do: Literal["count"]
    fish: Annotated[int, Field(ge=1, le=MOST_FISH)]


PageRequest = (
    SetGoal | SetPath | SetRule | SetZoneWeights | LetWander | SetMode | SetPaused | AdvanceTick
    | SetPlaybackRate | ShowPastTick | BranchFromPast | ReturnToFuture | ExplainFish | SetFishCount
    | TimeRequest
)  # fmt: skip
_REQUEST: TypeAdapter[PageRequest] = TypeAdapter(Annotated[PageRequest, Field(discriminator="do")])


def parse_message(text: str | bytes | None) -> PageRequest | None:
    """Return the request in a page's JSON text; None if it is too long, not JSON, or invalid."""
    return parse_json(_REQUEST, text, LONGEST)
