"""Pictures of what the stages have made: `python -m stages.plots.bpn` writes reports/bpn/*.png.

Stages of their own, so that a picture changed makes nothing anew but itself.
"""
