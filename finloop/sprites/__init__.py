"""Sprites: frames of the film for each sequence, in all orientations (fish paper §3.3, Table 1)."""
