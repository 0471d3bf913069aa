"""finloop: film a fish once, steer it for ever."""

__version__ = "0.1.0"
