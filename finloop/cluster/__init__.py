"""Let workers of a Dask cluster compute, on this machine or on many.

`base.parallel` submits pieces and takes their results in order; these are the workers that it
submits to. They share a folder with the stage, and are reached by the scheduler's address. A piece
is worked in that folder, by the same code, packages and thread counts, so it gives the same bytes
as on a process of this machine; a worker that differs is refused. Needs the extra `cluster` (`make
cluster`).
"""
