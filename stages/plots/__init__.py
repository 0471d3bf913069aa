"""Pictures of what the stages have made; a module a stage, and three stages that draw them all.

`python -m stages.plots.bpn` draws reports/bpn/*.png alone. `plots-film`, `plots-motion` and
`plots-modes` are apart from the stages that compute: a changed picture computes nothing anew.
"""
