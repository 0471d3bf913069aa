"""A stage for each mode: its animation, further ones to be measured, and its measures."""
