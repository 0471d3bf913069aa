"""The distance map of the film's pictures (fish paper §4.1, Eqs. 5-8), and the reel of rows."""
