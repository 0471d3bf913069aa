"""Motion of one animal, looks of another: motion retargeting (Gleicher 1998).

A track that was recorded anywhere is swum by the film's fish. Place, heading and bends are the
track's, proportions, size, light and skin the film's. For every tick a row of the film is chosen
that is posed and moves as is asked for, and drawn in the asked posture; the film goes on as long as
it may.

M. Gleicher, Retargetting Motion to New Characters, SIGGRAPH 1998.
"""

from finloop.retarget.film import ASKED, JoinParameters, RetargetData, Retargeted, retarget_track
from finloop.retarget.track import Track, track_of

__all__ = [
    "ASKED",
    "JoinParameters",
    "RetargetData",
    "Retargeted",
    "Track",
    "retarget_track",
    "track_of",
]
