"""Significant digits of results: those that every processor computes alike.

Kernels of BLAS and numbers of threads differ in the last bits; results of the zebrafish film then
agree to five digits or more.
"""

DIGITS = 4


def significant(value: float) -> float:
    """The value rounded to DIGITS significant digits; NaN stays NaN."""
    return float(f"{float(value):.{DIGITS}g}")
