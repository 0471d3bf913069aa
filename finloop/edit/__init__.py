"""The edit list: what is drawn at every tick, where, and why; joins between pictures."""
