"""Fish of one frame joined to those of the next: tracks (fish paper §2.1, several fish at once).

A track is a run of consecutive frames of one isolated fish. It ends where its identity becomes
uncertain: where the fish touches another one or the border, vanishes, or moves farther than a fish
can. Afterwards a new track begins, even if it is the same animal, so two fish are never confused.

A track is *swallowed* if no silhouette is assigned to it and its expected place lies inside the box
of a silhouette that is assigned to another track.
"""
