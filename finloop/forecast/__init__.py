"""Prediction of the next pose and motion with its spread, an extension of the paper's idea.

Eq. 4 of the fish paper predicts motion area and swimming type. Here the state is the pose itself
with forward, sideways and turning speed; the control is still displacement and included angle (Eqs.
1, 3). A network predicts the mean of the next state; the film's own departures from it, frame after
frame, are its spread. So a fish swims like the filmed ones, but along new routes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "film": ["FilmStates", "compute_film_states"],
    "learning": ["train_predictor"],
    "model": ["Forecast"],
    "neighbours": ["build_similarity_graph"],
    "sampling": ["RolloutState", "start_at_row", "step_fish"],
})  # fmt: skip
