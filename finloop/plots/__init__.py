"""Figures of both papers and sheets of pictures, one module per stage; they compute nothing.

Only the stages `plots-…` import them (`gait` and `morph` draw their own). So a changed colour makes
no stage compute again.
"""
