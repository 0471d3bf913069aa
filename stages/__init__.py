"""The stages of the pipeline, each run by DVC as `python -m stages.<word>`."""
