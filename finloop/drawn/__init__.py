"""Drawn animals that know their truth: carp from above, a dog from the side.

They take the place of film where the true answer must be known: of tracking and features (fish
paper §2) and of gaits (curve paper §4.2).
"""
