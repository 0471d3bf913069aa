"""The pictures of README and guides: `make pictures` draws them all anew, into docs/pictures/.

They show the drawn carp only: real footage is under its own licence and never part of this
repository. The pipeline runs in a scratch folder; the pictures are made from what its stages write.
"""
