"""Mode `loops`: video loops chosen by the position table (fish paper §4.1-4.2, Figs. 10-13).

At a loop end the film can play on, or go on at the other end of a loop: these rows are the
candidates. From each, the position table says in which quadrant the fish will be at every later
loop end of that track (Fig. 11). A candidate is *legal* if it leads to a loop end inside the tank,
in the quadrant of the goal, and begins with the fish headed that way (Fig. 13). For a fish that
wanders the quadrant does not count. Where several candidates are legal, `loop_end_choice` decides
(the cases of Fig. 10b). Where none is, the film plays on inside the tank (§4.2). Where even that is
impossible, the fish swims on the spot.
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
from finloop.modes.animator import Animator, ModeAssets, make_animator, video_loop_graph
from finloop.modes.matching import NothingToUse
from finloop.plan.graph import MotionGraph, random_fish_in_film
from finloop.plan.search import Candidates, film_candidates, make_candidates

_HEADING_UNIT_DEG = 30.0  # of heading error weigh as much as 1 body length/s of speed error
_TANK, _QUADRANT, _HEADING = map(VERDICTS.index, ("tank", "quadrant", "heading"))


class RollOuts(NamedTuple):
    """Where the film leads from each candidate (k,): to the loop end nearest to the goal.

    ticks: rows to show up to that loop end, 0 where no loop end passes the tests; far: px from it
    to the goal; touches_goal: whether the fish touches the goal before, which ends the roll-out at
    the next loop end; quadrant: where that loop end is, seen from the first place; verdict: index
    in `VERDICTS` of the test that the candidate fails; inside: rows to show up to the loop end
    nearest to the goal if quadrant and heading do not count, 0 where the fish leaves the tank
    before any loop end.
    """

    ticks: Ints
    far: Floats
    touches_goal: Mask
    quadrant: NDArray[np.int8]
    verdict: NDArray[np.int8]
    inside: Ints


class Loops:
    """Plays the film's video loops (Figs. 10-13).

    film: motion graph with loop jumps alone; least_rows: fewest rows shown between two jumps; ends
    (n,): whether a row is a loop end; can_play: whether the film can go on for ever.
    """

    def __init__(self, world: World, film: MotionGraph, p: LoopsSettings) -> None:
        """Keep the world, the film and the parameters of the mode, and find the loop ends."""
        self.world, self.film, self.p = world, film, p
        self.least_rows = max(1, round(p.min_deltas_between_jumps * world.motion.delta))
        self.ends = mark_loop_ends(film)
        self.can_play = bool((film.recurrent & film.has_next).any())

    def begin(self, rng: np.random.Generator) -> Fish:
        """Return a fish at a random place, at a row from which the film goes on for ever."""
        fish = random_fish_in_film(self.film, self.world.tank, rng)
        return fish._replace(since=self.least_rows)  # so it may jump at once

    def take_over(self, fish: Fish) -> Fish:
        """Return a fish of another mode for this one, shown by a frame of the film.

        A frame from which the film goes on stays on screen. Otherwise the frame whose heading and
        speed are nearest to the fish's is shown. Where jumps keep the heading, the fish keeps its
        own.
        """
        film = self.film
        if self.can_go_on(fish):
            if film.jumps_keep_heading or not fish.rotation_deg:
                return fish
            row = fish.row
        else:
            row = self._most_similar_row(fish)
        rotation_deg = (
            float(wrap(fish.heading - film.heading[row])) if film.jumps_keep_heading else 0.0
        )
        heading = float(wrap(film.heading[row] + rotation_deg))
        speed, area = float(film.speed[row]), float(film.area[row])
        return Fish(
            fish.x, fish.y, heading, speed, state=FILM, sprite=-1, area=area, tick=fish.tick,
            row=row, rotation_deg=rotation_deg, since=self.least_rows,  # so it may jump at once
        )  # fmt: skip

    def can_go_on(self, fish: Fish) -> bool:
        """Return whether a frame of the film shows the fish, and the film can go on for ever."""
        return 0 <= fish.row < self.film.filmed_count and bool(
            self.film.can_play_on(np.array([fish.row]))[0]
        )

    def _most_similar_row(self, fish: Fish) -> int:
        """Return the row most like a fish in heading and speed from which the film can go on."""
        film = self.film
        rows = film.lasting_rows
        differences = np.abs(film.speed[rows] - fish.speed)
        if not film.jumps_keep_heading:
            differences += np.abs(wrap_deg(film.heading[rows] - fish.heading)) / _HEADING_UNIT_DEG
        return int(rows[np.argmin(differences)])

    def next_stretch(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Return the next stretch of film: up to a loop end, or on the spot if none is inside."""
        candidates = self.next_candidates(fish)
        roll_outs = self.roll_out(self.next_place(fish), candidates, goal)
        taken = self.choose_candidate(candidates, roll_outs, rng)
        if taken is not None:
            return self.make_stretch(fish, candidates, roll_outs, taken, goal)
        inside = np.flatnonzero(roll_outs.inside)
        if inside.size:
            taken = int(rng.choice(inside))
            return self.make_stretch(fish, candidates, roll_outs, taken, goal)
        return self.swim_on_spot(fish, candidates, roll_outs, goal, rng)

    def next_candidates(self, fish: Fish) -> Candidates:
        """Return the rows that can be shown next: the film's next row, and the rows it can jump to.

        For `least_rows` rows after a jump there are no jumps, unless the film ends.
        """
        candidates = film_candidates(self.film, fish.row + 1, fish.rotation_deg)
        plays_on = ~candidates.jumps
        if plays_on.any() and fish.since + 1 < self.least_rows:
            rows, rotations_deg, seams, _jumps, _terms = candidates
            return make_candidates(rows[plays_on], rotations_deg[plays_on], seams[plays_on])
        return candidates

    def roll_out(
        self, place_px: tuple[float, float], candidates: Candidates, goal: Target,
        ends: Mask | None = None,
    ) -> RollOuts:  # fmt: skip
        """Return where the film leads from each candidate, if that is shown at `place_px`, x, y.

        ends (n,): the rows at which a roll-out may end, by default the loop ends.
        """
        ends, legal = self.ends if ends is None else ends, self.world.tank.legal
        return RollOuts(
            *_roll_out_candidates(
                self.film, legal, ends, candidates, place_px, goal,
                least_rows=self.least_rows, most_deg=self.p.improper_angle_deg,
            )
        )  # fmt: skip

    def choose_candidate(
        self, candidates: Candidates, roll_outs: RollOuts, rng: np.random.Generator
    ) -> int | None:
        """Return the index of the candidate that `loop_end_choice` prefers; None if none is legal.

        "jump" prefers jumps, "play" the film's next row; where none of these is legal, any other
        legal candidate counts. Of several (Fig. 10b) the one that leads nearest to the goal is
        taken. "any" takes a random legal one.
        """
        legal = np.flatnonzero(roll_outs.ticks)
        if not legal.size:
            return None
        if self.p.loop_end_choice == "any":
            return int(rng.choice(legal))
        jumps = candidates.jumps[legal]
        preferred = legal[jumps if self.p.loop_end_choice == "jump" else ~jumps]
        choice = preferred if preferred.size else legal
        return int(choice[np.argmin(roll_outs.far[choice])])

    def make_stretch(
        self, fish: Fish, candidates: Candidates, roll_outs: RollOuts, taken: int, goal: Target,
        reason: str = "", ticks: int | None = None,
    ) -> Stretch:  # fmt: skip
        """Return the stretch of film from candidate number `taken`, `ticks` long.

        ticks: by default up to the loop end that its roll-out leads to; reason: code of the
        decision, by default that the film plays on or jumps.
        """
        row, rotation_deg = int(candidates.rows[taken]), float(candidates.rotations_deg[taken])
        is_legal = roll_outs.ticks[taken] > 0
        if ticks is None:
            ticks = int(roll_outs.ticks[taken] if is_legal else roll_outs.inside[taken])
        rows = np.arange(row, row + ticks)
        trajectory = self._film_trajectory(rows, rotation_deg, self.next_place(fish))
        plays_on = row == fish.row + 1 and fish.row >= 0
        decision = add_verdict_counts(roll_outs, Decision(
            reason or (PLAY if plays_on else JUMP),
            seam=np.nan if plays_on else float(candidates.seams[taken]),
            quadrant=int(roll_outs.quadrant[taken]) if is_legal else 0,
        ))  # fmt: skip
        return Stretch(
            FILM, trajectory, rows, begins_with_transition=not plays_on, aim=goal,
            touches_goal=bool(is_legal and roll_outs.touches_goal[taken]), decision=decision,
            kind=FRAME, rotation_deg=np.full(ticks, rotation_deg),
        )  # fmt: skip

    def _film_trajectory(
        self, rows: Ints, rotation_deg: float, start_px: tuple[float, float]
    ) -> Floats:
        """Return x, y px and heading, (t, 3), of a fish that plays successive rows (t,) of film.

        rotation_deg: degrees by which they are turned; start_px: x, y at the first of them.
        """
        film, cos, sin = (
            self.film,
            np.cos(np.radians(rotation_deg)),
            np.sin(np.radians(rotation_deg)),
        )
        dx = np.append(0.0, np.cumsum(film.dx[rows[:-1]]))
        dy = np.append(0.0, np.cumsum(film.dy[rows[:-1]]))
        return np.column_stack([
            start_px[0] + dx * cos + dy * sin, start_px[1] + dy * cos - dx * sin,
            film.heading[rows] + rotation_deg,
        ])  # fmt: skip

    def next_place(self, fish: Fish) -> tuple[float, float]:
        """Return where the fish is at the next tick, x, y px.

        A fish in the film moves as the film does; a fish that a sprite shows goes straight on.
        """
        if fish.row < 0:
            distance = fish.speed * self.world.motion.body_length_px / self.world.motion.rate_hz
            cos, sin = np.cos(np.radians(fish.heading)), np.sin(np.radians(fish.heading))
            return fish.x + distance * float(cos), fish.y - distance * float(sin)
        dx, dy = rotate(self.film.dx[fish.row], self.film.dy[fish.row], fish.rotation_deg)
        return fish.x + float(dx), fish.y + float(dy)

    def swim_on_spot(
        self, fish: Fish, candidates: Candidates, roll_outs: RollOuts, goal: Target,
        rng: np.random.Generator,
    ) -> Stretch:  # fmt: skip
        """Return a stretch of film in place, as every candidate leaves the tank (§4.2).

        It plays a random candidate, up to the first loop end after `least_rows` rows, or to an
        earlier one if the film ends, or for one row if there is none.
        """
        film, taken = self.film, int(rng.integers(len(candidates.rows)))
        row, rotation_deg = int(candidates.rows[taken]), float(candidates.rotations_deg[taken])
        ahead = slice(row, row + 4 * self.least_rows)  # enough rows to find such a loop end, mostly
        is_reached = np.logical_and.accumulate(film.has_next[ahead])
        ticks_to_ends = np.flatnonzero(self.ends[ahead] & is_reached) + 1
        ticks = 1
        if ticks_to_ends.size:
            least = min(self.least_rows, ticks_to_ends[-1])
            ticks = int(ticks_to_ends[ticks_to_ends >= least][0])
        rows = np.arange(row, row + ticks)
        place = np.tile([fish.x, fish.y], (ticks, 1))
        return Stretch(
            FILM, np.column_stack([place, film.heading[rows] + rotation_deg]), rows,
            begins_with_transition=row != fish.row + 1, aim=goal, touches_goal=False,
            decision=add_verdict_counts(roll_outs, Decision(SPOT)), kind=FRAME,
            rotation_deg=np.full(ticks, rotation_deg),
        )  # fmt: skip

    def end_state(self, fish: Fish, stretch: Stretch) -> Fish:
        """Return the fish as it is at the end of a stretch of film that began with `fish`."""
        ticks, last_row = len(stretch.trajectory), int(stretch.number[-1])
        x, y, heading = map(float, stretch.trajectory[-1])
        assert stretch.rotation_deg is not None
        begins_anew = (
            stretch.begins_with_transition or fish.row < 0
        )  # `since` counts the ticks from there on
        return Fish(
            x, y, float(wrap(heading)), speed=float(self.film.speed[last_row]), state=FILM,
            sprite=-1, area=float(self.film.area[last_row]), tick=fish.tick + ticks, row=last_row,
            rotation_deg=float(stretch.rotation_deg[-1]),
            since=ticks - 1 if begins_anew else fish.since + ticks,
        )  # fmt: skip


def add_verdict_counts(roll_outs: RollOuts, decision: Decision) -> Decision:
    """Return a decision with the number of its candidates, and of those that fail each test."""
    counts = np.bincount(roll_outs.verdict, minlength=len(VERDICTS)).tolist()
    return decision._replace(
        candidates=len(roll_outs.verdict), candidates_tank=counts[_TANK],
        candidates_quadrant=counts[_QUADRANT], candidates_heading=counts[_HEADING],
    )  # fmt: skip


def mark_loop_ends(film: MotionGraph) -> Mask:
    """Return which rows (n,) are loop ends: a jump can replace the row after them."""
    rows = np.arange(len(film.rows) - 1)
    slot = film.jump_slot[rows + 1]
    jumps = (slot >= 0) & (film.start[slot + 1] > film.start[slot])
    is_end = np.zeros(len(film.rows), bool)
    is_end[:-1] = film.has_next[rows] & jumps
    return is_end


@kernel
def _roll_out_candidates(
    film: MotionGraph, legal: Mask, ends: Mask, candidates: Candidates,
    place_px: tuple[float, float], goal: Target, least_rows: int, most_deg: float,
) -> tuple[Ints, Floats, Mask, NDArray[np.int8], NDArray[np.int8], Ints]:  # fmt: skip
    """Play the film on from each candidate (k,); return the six columns of `RollOuts`.

    Each candidate is played on as long as it stays in the tank. Of the loop ends that pass the
    tests, the one nearest to the goal gives ticks, distance, touch, quadrant and verdict; the last
    column is the ticks to the one nearest to the goal of all. legal (h, w): where the fish's centre
    may be; ends (n,): whether a roll-out may end at a row; place_px: x, y of the first place;
    least_rows: to show after a jump; most_deg: largest angle between the first heading and the
    direction of the loop end (Fig. 13).
    """
    count = candidates.rows.size
    ticks, inside = np.zeros(count, np.int64), np.zeros(count, np.int64)
    far, touches_goal = np.full(count, np.inf), np.zeros(count, np.bool_)
    # Verdict: 0 if a loop end passes all tests, else the last test that one comes to; in the order
    # of their numbers these are tank, quadrant and heading.
    quadrant, verdict = np.zeros(count, np.int8), np.full(count, _TANK, np.int8)
    first_x, first_y = place_px
    goal_quadrant = quadrant_of_displacement(goal.x - first_x, first_y - goal.y)
    for k in range(count):
        row, rotation_deg = candidates.rows[k], candidates.rotations_deg[k]
        x, y, shown = first_x, first_y, 0
        first_heading = film.rows[row].heading + rotation_deg
        fewest = least_rows if candidates.jumps[k] else 1
        nearest, touches = np.inf, False
        while is_legal_point(legal, x, y):
            film_row = film.rows[row]
            shown += 1
            touches = touches or touches_target(x, y, film_row.heading + rotation_deg, goal)
            if ends[row] and (touches or shown >= fewest):
                end_quadrant = quadrant_of_displacement(x - first_x, first_y - y)
                distance = 0.0 if touches else np.hypot(goal.x - x, goal.y - y)
                if distance < nearest:
                    nearest, inside[k] = distance, shown
                angle = abs(wrap(bearing(first_x, first_y, x, y) - first_heading))
                right_quadrant = goal.free or end_quadrant == goal_quadrant
                if touches or (right_quadrant and angle <= most_deg):
                    if distance < far[k]:
                        far[k], ticks[k], touches_goal[k] = distance, shown, touches
                        quadrant[k], verdict[k] = end_quadrant, 0
                elif verdict[k] != 0:
                    verdict[k] = _HEADING if right_quadrant else max(verdict[k], _QUADRANT)
            if (touches and ends[row]) or not film_row.has_next:
                break
            dx, dy = rotate(film_row.dx, film_row.dy, rotation_deg)
            x, y, row = x + dx, y + dy, row + 1
    return ticks, far, touches_goal, quadrant, verdict, inside


@kernel
def ticks_to_marked_row(
    film: MotionGraph, legal: Mask, marked: Mask, candidates: Candidates,
    place_px: tuple[float, float],
) -> Ints:  # fmt: skip
    """Return how many ticks each candidate (k,) plays until a marked row is shown; 0: never.

    candidates: rows and rotations. The marked row counts as shown. It is never shown if the fish
    leaves the tank, or the film ends, before. legal (h, w): where the fish's centre may be; marked
    (n,): mask of rows; place_px: x, y of the first row shown.
    """
    ticks = np.zeros(candidates.rows.size, np.int64)
    for k in range(ticks.size):
        row, rotation_deg = candidates.rows[k], candidates.rotations_deg[k]
        x, y, shown = place_px[0], place_px[1], 0
        while is_legal_point(legal, x, y):
            shown += 1
            if marked[row]:
                ticks[k] = shown
                break
            if not film.rows[row].has_next:
                break
            dx, dy = rotate(film.rows[row].dx, film.rows[row].dy, rotation_deg)
            x, y, row = x + dx, y + dy, row + 1
    return ticks


def loops_animator(
    assets: ModeAssets, loops: pd.DataFrame, p: CommonSettings, q: LoopsSettings
) -> Animator:
    """Return the animator of mode `loops` (Figs. 10-13); NothingToUse if the film has no loops.

    assets: what the modes share; loops: rows a, b and distance of each loop; p: the group
    `animate`.
    """
    mode = Loops(assets.world, video_loop_graph(assets, loops), q)
    if not mode.can_play:
        raise no_loops_error("loops")
    return make_animator(assets, mode, None, p, q.join)


def no_loops_error(mode: str) -> NothingToUse:
    """Return the error that the film has no loops for a mode; mode: its name."""
    return NothingToUse(
        f"mode {mode}: the film has no loops by which it could go on for ever",
        "a film in which similar frames return, with a loop at least every few seconds",
        "take a longer film, let more frames join (loops.distance_threshold, "
        "distance.max_distance_steps), or another mode: network needs no loops",
    )
