"""The exact phase of key 1 in a walk: where the feet turn round (curve paper §4.2, Fig. 9).

The fundamental of a walk gives its period well, but not the phase at which the feet turn: a foot on
the ground moves evenly, a lifted one does not. In a gait of four subcycles the motion of every foot
is four parabolas joined at the keys. So the keys are where four parabolas fit all feet best.
"""
