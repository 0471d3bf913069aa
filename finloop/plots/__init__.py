"""Figures of both papers and sheets of pictures, one module per stage; they compute nothing.

The stages `plots-…` import them, so that a changed colour computes nothing again; `gait` and
`morph` draw their own.
"""
