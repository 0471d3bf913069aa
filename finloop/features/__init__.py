"""Measure each fish in each frame: its bend, heading, motion and swimming type (§2.2-2.3)."""
