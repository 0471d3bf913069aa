"""Mode `loops`: video loops chosen by the position table (fish paper §4.1-4.2, Figs. 10-13).

At a loop end the film can play on, or go on at the other end of a loop. From either, the position
table says in which quadrant the fish will be at every later loop end of that track (Fig. 11). A way
to one of them is *legal* if it stays in the tank, leads to the quadrant of the goal, and begins
with the fish headed the way it leads (Fig. 13). For a fish that wanders the quadrant does not
count. Where several ways are legal the policy chooses, the cases of Fig. 10b. Where none is, the
mode goes on inside the tank (§4.2). Where even that is impossible, the fish swims on the spot.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.arena import is_legal_point
from finloop.animate.kinematics import Target, bearing, rotate, touches_target, wrap
from finloop.animate.settings import AnimateSettings as CommonSettings
from finloop.animate.state import Fish
from finloop.animate.world import World
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel
from finloop.edit.schema import FILM, FRAME, JUMP, PLAY, SPOT, VERDICTS
from finloop.edit.stretch import Decision, Stretch
from finloop.features.table import wrap_deg
from finloop.loops.positions import quadrant_of_displacement
from finloop.loops.settings import LoopsSettings
from finloop.modes.animator import (
    FilmData,
    ModeAssets,
    PaperAnimator,
    make_animator,
    prepare_mode_assets,
    video_loop_graph,
)
from finloop.modes.matching import NothingToUse
from finloop.plan.graph import MotionGraph

_HEADING_UNIT_DEG = 30.0  # of heading error weigh as much as 1 body length/s of speed error
_TANK, _QUADRANT, _HEADING = map(VERDICTS.index, ("tank", "quadrant", "heading"))


class Starts(NamedTuple):
    """Rows (k,) of the film that can be shown next.

    rots: degrees by which each would be turned; seams: discontinuity of each in natural steps, 0
    for the film's own next frame.
    """

    rows: Ints
    rots: Floats
    seams: Floats


class Ways(NamedTuple):
    """Where playing on from each start (k,) leads: to the loop end nearest to the goal.

    ticks: rows to show, 0 where no loop end passes the tests; far: px from that loop end to the
    goal; touched: whether the fish touches the goal on the way, which then ends at the next loop
    end; quadrant: where that loop end is, seen from the beginning of the way; verdict: index in
    `VERDICTS` of the test that the start fails; inside: rows to show inside the tank where quadrant
    and heading do not count, 0 where the way leaves the tank.
    """

    ticks: Ints
    far: Floats
    touched: Mask
    quadrant: NDArray[np.int8]
    verdict: NDArray[np.int8]
    inside: Ints


class Loops:
    """Plays the film's video loops (Figs. 10-13).

    film: motion graph with loop jumps alone; stay: fewest rows shown between two jumps; ends (n,):
    whether a row is a loop end; can_play: whether the film can go on for ever.
    """

    def __init__(self, world: World, film: MotionGraph, p: LoopsSettings) -> None:
        """Keep the world, the film and the parameters of the mode, and find the loop ends."""
        self.world, self.film, self.p = world, film, p
        self.stay = max(1, round(p.min_deltas_between_jumps * world.motion.delta))
        self.ends = mark_loop_ends(film)
        self.can_play = bool((film.recurrent & film.has_next).any())

    def begin(self, rng: np.random.Generator) -> Fish:
        """Return a fish at a random place, at a row from which the film goes on for ever."""
        film = self.film
        x, y = self.world.tank.random_point(rng)
        row = int(rng.choice(np.flatnonzero(film.has_next[:-1] & film.recurrent[1:])))
        rot = float(rng.uniform(-180, 180)) if film.jumps_keep_heading else 0.0
        heading = float(wrap(film.heading[row] + rot))
        return Fish(
            x, y, heading, speed=0.0, state=FILM, sprite=-1, row=row, rot=rot, since=self.stay
        )

    def take_over(self, fish: Fish) -> Fish:
        """Return a fish of another mode as a fish of this mode, in the film.

        A frame from which the film goes on stays. Otherwise the fish shows the frame whose heading
        and speed are nearest to its own. If jumps keep the heading, so does this one.
        """
        film = self.film
        if self.can_go_on(fish):
            if film.jumps_keep_heading or not fish.rot:
                return fish
            row = fish.row
        else:
            row = self._most_similar_row(fish)
        rot = float(wrap(fish.heading - film.heading[row])) if film.jumps_keep_heading else 0.0
        heading = float(wrap(film.heading[row] + rot))
        speed, area = float(film.speed[row]), float(film.area[row])
        return Fish(
            fish.x, fish.y, heading, speed, state=FILM, sprite=-1, area=area, tick=fish.tick,
            row=row, rot=rot, since=self.stay,
        )  # fmt: skip

    def can_go_on(self, fish: Fish) -> bool:
        """Return whether a frame of the film shows the fish, and the film goes on from there."""
        return 0 <= fish.row < self.film.filmed and bool(
            self.film.can_play_on(np.array([fish.row]))[0]
        )

    def _most_similar_row(self, fish: Fish) -> int:
        """Return the row most similar to a fish in heading and speed, of the rows that play on."""
        film = self.film
        rows = np.flatnonzero(film.has_next[:-1] & film.recurrent[1:])
        differences = np.abs(film.speed[rows] - fish.speed)
        if not film.jumps_keep_heading:
            differences += np.abs(wrap_deg(film.heading[rows] - fish.heading)) / _HEADING_UNIT_DEG
        return int(rows[np.argmin(differences)])

    def next_stretch(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Return film up to a loop end: by a legal way, else by any in the tank, else in place."""
        starts = self.next_rows(fish)
        ways = self.follow_starts(fish, starts, goal)
        taken = self.choose_start(starts, ways, rng)
        if taken is not None:
            return self.make_stretch(fish, starts, ways, taken, goal)
        inside = np.flatnonzero(ways.inside)
        if inside.size:
            return self.make_stretch(fish, starts, ways, int(rng.choice(inside)), goal)
        return self.swim_on_spot(fish, starts, ways, goal, rng)

    def next_rows(self, fish: Fish) -> Starts:
        """Return the rows that can be shown next: the film's next row, and the rows it can jump to.

        For `stay` rows after a jump there are no jumps, unless the film ends.
        """
        film, row = self.film, fish.row + 1
        plays_on = film.has_next[row] and film.recurrent[row + 1]
        may_jump = not plays_on or fish.since + 1 >= self.stay
        slot = film.jump_slot[row] if may_jump else -1  # −1: no jump
        jumps = slice(film.start[slot], film.start[slot + 1]) if slot >= 0 else slice(0)
        rows = np.append(np.full(int(plays_on), row), film.to[jumps]).astype(np.int64)
        seams = np.append(np.zeros(int(plays_on)), film.seam[jumps])
        rots = np.full(len(rows), fish.rot)
        if film.jumps_keep_heading:
            rots = wrap_deg(film.heading[row] + fish.rot - film.heading[rows])
        return Starts(rows, np.asarray(rots, float), seams)

    def follow_starts(
        self, fish: Fish, starts: Starts, goal: Target, ends: Mask | None = None
    ) -> Ways:
        """Return where the film leads from each row that the fish could show next.

        ends (n,): the rows at which a way may end, by default the loop ends.
        """
        return self.follow_starts_from(self.next_place(fish), starts, goal, ends)

    def follow_starts_from(
        self, place_px: tuple[float, float], starts: Starts, goal: Target, ends: Mask | None = None
    ) -> Ways:
        """Return where the film leads from each row that could be shown next at `place_px`, x, y.

        ends (n,): the rows at which a way may end, by default the loop ends.
        """
        ends = self.ends if ends is None else ends
        legal = self.world.tank.legal
        limits = self.stay, self.p.improper_angle_deg
        return Ways(*_follow_starts(self.film, legal, ends, (starts, place_px), goal, limits))

    def choose_start(self, starts: Starts, ways: Ways, rng: np.random.Generator) -> int | None:
        """Return the index of the start that `loop_end_choice` prefers; None if none is legal.

        Of several preferred starts (Fig. 10b) the one that ends nearest to the goal is taken, or
        with "any" a random one.
        """
        legal = np.flatnonzero(ways.ticks)
        if not legal.size:
            return None
        if self.p.loop_end_choice == "any":
            return int(rng.choice(legal))
        jumps = starts.seams[legal] > 0
        preferred = legal[jumps if self.p.loop_end_choice == "jump" else ~jumps]
        choice = preferred if preferred.size else legal
        return int(choice[np.argmin(ways.far[choice])])

    def make_stretch(
        self, fish: Fish, starts: Starts, ways: Ways, taken: int, goal: Target, reason: str = ""
    ) -> Stretch:
        """Return the stretch of film that begins with start number `taken` and ends with its way.

        reason: code of the decision, by default that the film plays on or jumps.
        """
        film, row, rot = self.film, int(starts.rows[taken]), float(starts.rots[taken])
        legal = ways.ticks[taken] > 0
        ticks = int(ways.ticks[taken] if legal else ways.inside[taken])
        rows = np.arange(row, row + ticks)
        cos, sin = np.cos(np.radians(rot)), np.sin(np.radians(rot))
        first_place = self.next_place(fish)
        dx = np.append(0.0, np.cumsum(film.dx[rows[:-1]]))
        dy = np.append(0.0, np.cumsum(film.dy[rows[:-1]]))
        trajectory = np.column_stack([
            first_place[0] + dx * cos + dy * sin, first_place[1] + dy * cos - dx * sin,
            film.heading[rows] + rot,
        ])  # fmt: skip
        plays_on = row == fish.row + 1 and fish.row >= 0
        decision = add_verdict_counts(ways, Decision(
            reason or (PLAY if plays_on else JUMP),
            seam=np.nan if plays_on else float(starts.seams[taken]),
            quadrant=int(ways.quadrant[taken]) if legal else 0,
        ))  # fmt: skip
        return Stretch(
            FILM, trajectory, rows, new=not plays_on, aim=goal,
            touched=bool(legal and ways.touched[taken]), decision=decision, kind=FRAME,
            rot=np.full(ticks, rot),
        )  # fmt: skip

    def next_place(self, fish: Fish) -> tuple[float, float]:
        """Return where the fish is at the next tick, x, y px.

        A fish in the film moves as the film does; a fish that a sprite shows goes straight on.
        """
        if fish.row < 0:
            distance = fish.speed * self.world.motion.body_length_px / self.world.motion.rate_hz
            cos, sin = np.cos(np.radians(fish.heading)), np.sin(np.radians(fish.heading))
            return fish.x + distance * float(cos), fish.y - distance * float(sin)
        dx, dy = rotate(self.film.dx[fish.row], self.film.dy[fish.row], fish.rot)
        return fish.x + float(dx), fish.y + float(dy)

    def swim_on_spot(
        self, fish: Fish, starts: Starts, ways: Ways, goal: Target, rng: np.random.Generator
    ) -> Stretch:
        """Return film of a random start, played in place, as no way stays in the tank (§4.2).

        It ends at the first loop end after `stay` rows, or at an earlier one if the film ends.
        """
        film, taken = self.film, int(rng.integers(len(starts.rows)))
        row, rot = int(starts.rows[taken]), float(starts.rots[taken])
        ahead = slice(row, row + 4 * self.stay)  # far enough to hold such a loop end, mostly
        is_reached = np.logical_and.accumulate(film.has_next[ahead])
        ticks_to_ends = np.flatnonzero(self.ends[ahead] & is_reached) + 1
        ticks = 1
        if ticks_to_ends.size:
            least = min(self.stay, ticks_to_ends[-1])
            ticks = int(ticks_to_ends[ticks_to_ends >= least][0])
        rows = np.arange(row, row + ticks)
        place = np.tile([fish.x, fish.y], (ticks, 1))
        return Stretch(
            FILM, np.column_stack([place, film.heading[rows] + rot]), rows,
            new=row != fish.row + 1, aim=goal, touched=False,
            decision=add_verdict_counts(ways, Decision(SPOT)), kind=FRAME,
            rot=np.full(ticks, rot),
        )  # fmt: skip

    def end_state(self, fish: Fish, stretch: Stretch) -> Fish:
        """Return the fish as it is at the end of a stretch of film that began with `fish`."""
        ticks, last_row = len(stretch.trajectory), int(stretch.number[-1])
        x, y, heading = map(float, stretch.trajectory[-1])
        assert stretch.rot is not None
        begins_anew = stretch.new or fish.row < 0
        return Fish(
            x, y, float(wrap(heading)), speed=float(self.film.speed[last_row]), state=FILM,
            sprite=-1, area=float(self.film.area[last_row]), tick=fish.tick + ticks, row=last_row,
            rot=float(stretch.rot[-1]), since=ticks - 1 if begins_anew else fish.since + ticks,
        )  # fmt: skip


def add_verdict_counts(ways: Ways, decision: Decision) -> Decision:
    """Return the decision with the numbers of ways, in all and failing each test, added."""
    counts = np.bincount(ways.verdict, minlength=len(VERDICTS)).tolist()
    return decision._replace(
        ways=len(ways.verdict), ways_tank=counts[_TANK], ways_quadrant=counts[_QUADRANT],
        ways_heading=counts[_HEADING],
    )  # fmt: skip


def mark_loop_ends(film: MotionGraph) -> Mask:
    """Return which rows (n,) are loop ends: those with a next row that can jump instead."""
    rows = np.arange(len(film.rows) - 1)
    slot = film.jump_slot[rows + 1]
    jumps = (slot >= 0) & (film.start[slot + 1] > film.start[slot])
    is_end = np.zeros(len(film.rows), bool)
    is_end[:-1] = film.has_next[rows] & jumps
    return is_end


@kernel
def _follow_starts(film, legal, ends, starts_and_place, goal, limits):  # type: ignore[no-untyped-def]
    """Return where the film leads from each start (k,), as columns of `Ways`.

    legal (h, w): where the fish's centre may be; ends (n,): rows at which a way may end;
    starts_and_place: `Starts`, and x, y px; goal: `Target`; limits: fewest rows after a jump, most
    degrees between the first heading and the direction.
    """
    starts, place = starts_and_place
    start_count = starts.rows.size
    ticks, inside = np.zeros(start_count, np.int64), np.zeros(start_count, np.int64)
    far, touched = np.full(start_count, np.inf), np.zeros(start_count, np.bool_)
    quadrant, verdict = np.zeros(start_count, np.int8), np.full(start_count, _TANK, np.int8)
    stay, most_angle = limits
    wanted = quadrant_of_displacement(goal.x - place[0], place[1] - goal.y)
    for way in range(start_count):
        row, rot = starts.rows[way], starts.rots[way]
        x, y, shown = place[0], place[1], 0
        first_heading = film.rows[row].heading + rot
        least_rows = stay if starts.seams[way] > 0 else 1
        nearest, touches = np.inf, False
        while is_legal_point(legal, x, y):
            film_row = film.rows[row]
            shown += 1
            touches = touches or touches_target(x, y, film_row.heading + rot, goal)
            if ends[row] and (touches or shown >= least_rows):
                dx, dy = x - place[0], place[1] - y
                distance = 0.0 if touches else np.hypot(goal.x - x, goal.y - y)
                if distance < nearest:
                    nearest, inside[way] = distance, shown
                angle = abs(wrap(bearing(place[0], place[1], x, y) - first_heading))
                right_quadrant = goal.free or quadrant_of_displacement(dx, dy) == wanted
                if touches or (right_quadrant and angle <= most_angle):
                    if distance < far[way]:
                        far[way], ticks[way], touched[way] = distance, shown, touches
                        quadrant[way], verdict[way] = quadrant_of_displacement(dx, dy), 0
                elif verdict[way] != 0:
                    verdict[way] = _HEADING if right_quadrant else max(verdict[way], _QUADRANT)
            if (touches and ends[row]) or not film_row.has_next:
                break
            dx, dy = rotate(film_row.dx, film_row.dy, rot)
            x, y, row = x + dx, y + dy, row + 1
    return ticks, far, touched, quadrant, verdict, inside


@kernel
def ticks_to_first_end(film, legal, ends, starts, place_px):  # type: ignore[no-untyped-def]
    """Return how many rows (k,) to show from each start to the first row of `ends`; 0 for none.

    starts: `Starts` (k,); legal (h, w): where the fish's centre may be; ends (n,): rows; place_px:
    x, y of the first row shown. A way that leaves the tank or reaches the film's end before counts
    as none.
    """
    ticks = np.zeros(starts.rows.size, np.int64)
    for way in range(ticks.size):
        row, rot = starts.rows[way], starts.rots[way]
        x, y, shown = place_px[0], place_px[1], 0
        while is_legal_point(legal, x, y):
            shown += 1
            if ends[row]:
                ticks[way] = shown
                break
            if not film.rows[row].has_next:
                break
            dx, dy = rotate(film.rows[row].dx, film.rows[row].dy, rot)
            x, y, row = x + dx, y + dy, row + 1
    return ticks


def loops_animator(
    film_data: FilmData, loops: pd.DataFrame, p: CommonSettings, q: LoopsSettings
) -> PaperAnimator:
    """Return the animator of mode `loops` (Figs. 10-13); NothingToUse if the film has no loops.

    film_data: what is taken from the film; loops: rows a, b and distance of each loop; p: the group
    `animate`.
    """
    assets = prepare_mode_assets(film_data, p)
    mode = make_loops(film_data, assets, loops, q)
    if not mode.can_play:
        raise no_loops_error("loops")
    return make_animator(film_data, assets, mode, mode.film, None, p, q.join)


def no_loops_error(mode: str) -> NothingToUse:
    """Return the error that the film has no loops for a mode; mode: its name."""
    return NothingToUse(
        f"mode {mode}: the film has no loops by which it could go on for ever",
        "a film in which similar frames return, with a loop at least every few seconds",
        "take a longer film, let more frames join (loops.distance_threshold, "
        "distance.max_distance_steps), or another mode: network needs no loops",
    )


def make_loops(
    film_data: FilmData, assets: ModeAssets, loop_table: pd.DataFrame, q: LoopsSettings
) -> Loops:
    """Return the flow chart of mode `loops`; loop_table: rows a, b and distance of each loop."""
    return Loops(assets.world, video_loop_graph(film_data, assets, loop_table), q)
