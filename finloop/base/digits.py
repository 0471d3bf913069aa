"""Significant digits of results: those that every processor computes alike.

BLAS kernels and thread counts change the last bits; results of the zebrafish film still agree to
five digits or more.
"""

DIGITS = 4


def round_significant(value: float) -> float:
    """Return a value rounded to DIGITS significant digits; NaN stays NaN."""
    return float(f"{float(value):.{DIGITS}g}")
