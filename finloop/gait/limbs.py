"""Limb contours of film from regions traced in each frame (curve paper §4.2, "trace the contours").

Regions are masks or traced contours by id in each frame. Here they become contours of n points of
equal arc length in the body frame, point i of one frame belonging to point i of every other.
The paper does not say which points correspond. Here every frame is turned and moved onto one mean
shape of the limb, and its contour begins where it fits that shape best. The mean shape is the same
for the whole film, so nothing drifts.
"""
