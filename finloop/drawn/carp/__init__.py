"""A film of drawn carp from above, with the truth about every fish in every frame.

It checks §2 of the fish paper: tracking, backbones, features.
"""
