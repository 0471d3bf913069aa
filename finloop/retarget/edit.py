"""Make the edit list of a retargeted track: rows of the film in the requested postures."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask
from finloop.edit.bodies import Bodies
from finloop.edit.joins import JoinRules, PictureSequence, cross_fade_partners, inertialize_pictures
from finloop.edit.modes import RETARGET
from finloop.edit.schema import EDIT, FILM, FRAME, INERTIAL, JUMP, PLAY, STATES
from finloop.features.table import wrap_deg
from finloop.puppet import Pose


@dataclass(frozen=True)
class RowSequence:
    """Which film row is shown at each of T ticks, (T,), and whether mirrored, (T,).

    switch: the ticks, from 1 on, at which another row is shown than the next one of the film.
    """

    row: Ints
    mirrored: Mask
    switch: Ints

    @classmethod
    def from_rows(cls, numbers: Ints, follows: Ints, count: int) -> "RowSequence":
        """Return the sequence of numbered rows (T,), in which a mirror image has number + count.

        follows (m,): the number that comes next in the film, −1 for none; count: rows of the film.
        """
        switch = np.flatnonzero(numbers[1:] != follows[numbers[:-1]]) + 1
        return cls(numbers % count, numbers >= count, switch)

    def to_pictures(self, heading_deg: Floats, bodies: Bodies) -> PictureSequence:
        """Return the film's pictures to draw, turned to headings (T,) [degrees]."""
        turn = wrap_deg(heading_deg - bodies.heading_deg[self.row])
        return PictureSequence(np.ones(len(self.row), bool), self.row, turn, self.mirrored)


def shown_pose_codes(sources: RowSequence, rules: JoinRules) -> Floats:
    """Return the pose codes (T, c) that are drawn at each tick, with joins at jumps.

    sources: the row shown at each of T ticks. rules: how jumps are drawn. If its kind is INERTIAL,
    the difference between the postures before and after a jump dies away over the next ticks.
    """
    bodies, any_heading_deg = rules.bodies, np.zeros(len(sources.row))  # codes do not depend on it
    shown = sources.to_pictures(any_heading_deg, bodies)
    drawn = bodies.picture_bodies(shown.frame, shown.number, shown.rotation_deg, shown.mirrored)
    codes = bodies.codes(drawn)
    if rules.kind != INERTIAL:
        return codes
    states = inertialize_pictures(shown, any_heading_deg, rules)
    # `posed`: the ticks soon after a jump, whose pose is changed.
    return np.where(states.posed[:, None], states.codes, codes)


def build_edit_list(
    sources: RowSequence, pose: Pose, codes: Floats, scale: Floats, rules: JoinRules, rate_hz: float
) -> pd.DataFrame:
    """Return the edit list of a retargeted track: what is drawn at every tick.

    sources: the shown rows; pose (T): as drawn; codes (T, c): of these poses; scale (n,): at which
    each film row is drawn; rules: how jumps are drawn; rate_hz: ticks per second.
    """
    ticks, bodies = len(sources.row), rules.bodies
    heading = wrap_deg(np.degrees(pose.heading_rad))
    shown = sources.to_pictures(heading, bodies)
    # The frames that fade out play on, and stay at the end of their track.
    partner, weight = cross_fade_partners(
        shown, _find_fades(shown, sources.switch, rules), rules.fade,
        following=lambda _, row: row + int(bodies.goes_on[row]),
    )  # fmt: skip
    fades = weight > 0
    speed = np.hypot(np.diff(pose.x_px), np.diff(pose.y_px)) * rate_hz / pose.size_px[1:]
    switches = np.zeros(ticks, bool)
    switches[sources.switch] = True
    reason = pd.Series(JUMP, range(ticks), dtype=object).where(switches, None)
    reason[0] = PLAY
    table = pd.DataFrame({
        "fish": 0,
        "tick": np.arange(ticks),
        "time_s": np.arange(ticks) / rate_hz,
        "kind": FRAME,
        "source": sources.row,
        "rotation_deg": shown.rotation_deg,
        "scale": scale[sources.row],
        "mirrored": sources.mirrored,
        "x_px": pose.x_px,
        "y_px": pose.y_px,
        "partner_kind": pd.Series(FRAME, range(ticks), dtype=object).where(fades, None),
        "partner": pd.Series(partner.number).where(fades),
        "partner_rotation_deg": np.where(fades, partner.rotation_deg, np.nan),
        "partner_scale": np.where(fades, scale[partner.number], np.nan),
        "partner_mirrored": fades & partner.mirrored,
        "weight": weight,
        "pose": pd.Series(list(codes.astype(np.float32)), dtype=object),
        "heading_deg": heading,
        "speed": np.append(speed[:1], speed),
        "mode": RETARGET,
        "state": STATES[FILM],
        "goal": "",
        "aim_x_px": pose.x_px,
        "aim_y_px": pose.y_px,
        "reason": reason,
    })  # fmt: skip
    return table.reindex(columns=EDIT.names).astype(EDIT.pandas_dtypes)


def _find_fades(shown: PictureSequence, jumps: Ints, rules: JoinRules) -> Ints:
    """Return the ticks (m,) of those jumps at which light and skin are cross-faded.

    Left out are the jumps to a near frame of the same track, which looks the same.
    """
    if not len(jumps):
        return jumps
    bodies = rules.bodies
    drawn = bodies.picture_bodies(shown.frame, shown.number, shown.rotation_deg, shown.mirrored)
    due = bodies.next_body(drawn.select(jumps - 1))  # what would follow without the jump
    return jumps[~bodies.are_near_in_film(due, drawn.select(jumps), rules.fade)]
