"""The pictures of README and guides: `make pictures` draws them into docs/pictures/.

They show only the drawn carp: real footage is under its own licence and never part of this
repository. The pipeline runs in a scratch folder; the pictures come from the outputs of its stages.
"""
