"""Draw the stages' results; one module per stage, and three stages that draw them all.

`python -m stages.plots bpn` draws reports/motion/bpn/*.png alone. `plots-film`, `plots-motion` and
`plots-modes` are separate stages, so that a changed picture computes nothing again.
"""
