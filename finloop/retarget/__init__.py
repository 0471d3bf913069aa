"""Retarget motion: one animal's motion with another's looks (Gleicher 1998).

The film's fish swims a track that was recorded elsewhere. Place, heading and bends come from the
track; proportions, size, light and skin come from the film. For every tick finloop chooses a row of
the film with a similar posture and motion, and draws it in the requested posture. The film plays on
as long as it can.

M. Gleicher, Retargetting Motion to New Characters, SIGGRAPH 1998.
"""

from finloop.retarget.film import ASKED, JoinParameters, RetargetData, Retargeted, retarget_track
from finloop.retarget.track import Track, track_from_poses

__all__ = [
    "ASKED",
    "JoinParameters",
    "RetargetData",
    "Retargeted",
    "Track",
    "retarget_track",
    "track_from_poses",
]
