"""The modes of a live tank: their players, and what each can draw."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from finloop.animate.protocols import AnyPlayer
from finloop.edit.build import EditInputs


class Modes(NamedTuple):
    """The modes of a tank: by name the player of each, and what its edit lists are built from."""

    players: Mapping[str, AnyPlayer]
    sources: Mapping[str, EditInputs]

    @classmethod
    def from_players(cls, players: Mapping[str, AnyPlayer]) -> "Modes":
        """Return the modes of players by name; each can also draw the sprites of the others."""
        every = {mode: one.sources for mode, one in players.items()}
        widest = max(every.values(), key=lambda one: len(one.sprite_scale))
        return cls(players, {
            mode: replace(
                one, sprite_scale=widest.sprite_scale, sprite_after=widest.sprite_after,
                orientations=widest.orientations,
                joins=replace(one.joins, bodies=widest.joins.bodies),
            )
            for mode, one in every.items()
        })  # fmt: skip
