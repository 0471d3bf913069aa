"""Motion area: how much a fish is bent (fish paper §2.2, Fig. 2).

Six control points on the backbone - head end, 1/6, 1/3, 1/2, 5/6, tail end - make a closed uniform
cubic B-spline. The area it encloses grows with the bend. A straight fish encloses nothing.

The area is exact, not counted in pixels. By Green's theorem it is ½∮(x dy − y dx); with
x = Σ xᵢ B(t − i) it becomes a sum over pairs of control points, and B vanishes four knots away:

    area = ½ Σᵢ Σₖ₌₁..₃ gₖ (pᵢ × pᵢ₊ₖ),   gₖ = 2 ∫ B(t) B′(t − k) dt,   p × q = pₓ q_y − p_y qₓ
"""
