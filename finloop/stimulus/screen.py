"""How much of the tank a calibrated display shows: in the page, what is beyond its edge is lost."""

from functools import cached_property

import numpy as np
from skimage.transform import ProjectiveTransform

from finloop.base.arrays import Floats, Mask
from finloop.show.drawn import ALPHA, PICTURE, States, X, Y
from finloop.stimulus.display import DisplayCalibration

_UNIT_SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


class ScreenCheck:
    """A calibrated display that counts the ticks in which a fish would be outside of it.

    ticks: with a fish; ticks_outside: those with the centre of a fish beyond the screen's edge.
    """

    def __init__(self, display: DisplayCalibration, legal: Mask, mm_per_px: float | None) -> None:
        """Begin without ticks; legal (h, w): px of the tank where the centre of a fish can be.

        mm_per_px: mm of the display that one px of the tank shows, None if unknown.
        """
        self._display, self._legal, self._mm_per_px = display, legal, mm_per_px
        self.ticks = self.ticks_outside = 0

    def find_outside(self, places: Floats) -> Mask:
        """Return which places (n, 2) [px of the tank] the display does not show.

        The tank is drawn as by `viewOf` of view.js: enlarged, in the middle, then warped.
        """
        display, tank = self._display, np.array(self._legal.shape[::-1], float)
        screen = np.array([display.width_px, display.height_px], float)
        known = (display.px_per_mm or 0.0) * (self._mm_per_px or 0.0)
        scale = display.scale or known or float((screen / tank).min())
        edge = np.floor((screen - tank * scale) / 2 + 0.5)  # whole px
        on_screen = edge + (places + 0.5) * scale
        if display.corners is not None:
            corners = np.array(display.corners) * screen
            on_screen = ProjectiveTransform.from_estimate(_UNIT_SQUARE * screen, corners)(on_screen)
        is_outside: Mask = np.any((on_screen < 0) | (on_screen > screen), axis=1)
        return is_outside

    def count_tick(self, states: States) -> None:
        """Count a tick by the states (fish, fields) of its fish."""
        shown = states[(states[:, PICTURE] >= 0) & (states[:, ALPHA] > 0)]
        self.ticks += len(shown) > 0
        self.ticks_outside += bool(self.find_outside(shown[:, [X, Y]].astype(float)).any())

    @cached_property
    def share_outside(self) -> float:
        """Return the share of the area where fish can be that the display does not show."""
        return float(self.find_outside(np.argwhere(self._legal)[:, ::-1].astype(float)).mean())

    def describe_tank(self) -> str:
        """Return a sentence with the sizes of tank and screen, and how much of the tank is lost.

        The sizes are in mm if they are known.
        """
        display = self._display
        height, width = self._legal.shape
        screen = f"{display.width_px} × {display.height_px} px"
        tank = f"{width} × {height} px"
        if display.px_per_mm is not None:
            mm = 1 / display.px_per_mm
            screen = f"{display.width_px * mm:.0f} × {display.height_px * mm:.0f} mm"
        if self._mm_per_px is not None:
            tank = f"{width * self._mm_per_px:.0f} × {height * self._mm_per_px:.0f} mm"
        return (
            f"the tank is {tank}, the screen {screen}: {100 * self.share_outside:.1f} % of the"
            " area where fish can be is off the screen"
        )

    def describe_ticks(self) -> str:
        """Return a sentence with the share of the counted ticks in which a fish was outside."""
        share = self.ticks_outside / max(1, self.ticks)
        return (
            f"a fish would be off the screen in {100 * share:.2f} % of the ticks"
            f" ({self.ticks_outside} of {self.ticks})"
        )
