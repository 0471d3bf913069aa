"""Figures of both papers and sheets of pictures, a module a stage: they draw, and compute nothing.

Only the stages `plots-…` import them (`gait` and `morph` draw their own), so that a changed colour
computes nothing anew.
"""
