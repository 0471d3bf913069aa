"""The next pose and motion, foretold with their spread: the paper's idea taken further.

Eq. 4 of the fish paper foretells motion area and swimming type. Here the state is the pose itself
with forward, sideways and turning speed; the control stays displacement and included angle (Eqs.
1, 3). A network foretells the mean of the next state; the film's own departures from it, frame
after frame, are its spread. So a fish swims as the filmed ones do, but on ways of its own.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "film": ["FilmStates", "film_states"],
    "learning": ["learn"],
    "model": ["Forecast"],
    "neighbours": ["similar_rows"],
    "sampling": ["RolloutState", "begin", "step"],
})  # fmt: skip
