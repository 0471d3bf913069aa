"""Compiled functions: how numba compiles a kernel, and when it compiles it again.

Numba keeps machine code in `__pycache__`, for a file as long as that file is the same. But a kernel
contains the kernels that it calls, of other files too. So here machine code is kept as long as
every file with a kernel is the same.
"""

import hashlib
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numba.extending
from numba.core.caching import InTreeCacheLocator, UserWideCacheLocator

_PACKAGE = Path(__file__).parents[1]
_MENTION = Path(__file__).stem.encode()


@cache
def sources_digest() -> str:
    """A digest of every file of the package that has a kernel, this one too."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if _MENTION in text:
            digest.update(text)
    return digest.hexdigest()


class _AllSources:
    """Looked up by numba: what must be the same for machine code to be used again."""

    _lineno: int

    def get_source_stamp(self) -> str:
        return sources_digest()

    def get_disambiguator(self) -> str:
        """A name of its own: an older file may name types that are no more, and cannot be read."""
        return f"{self._lineno}-{sources_digest()[:8]}"


class InTree(_AllSources, InTreeCacheLocator):
    """Machine code beside its source."""


class UserWide(_AllSources, UserWideCacheLocator):
    """Machine code in the user's cache, where the source's folder cannot be written."""


numba.config.CACHE_LOCATOR_CLASSES = ",".join(  # type: ignore[attr-defined]
    f"{__name__}.{locator.__name__}" for locator in (InTree, UserWide)
)

kernel = numba.njit(cache=True, nogil=True)
"""Compiles a function when it is first called, for every type of arguments."""

finite_kernel = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
"""The same for a function in which nothing is infinite or not a number."""

kernel_part = numba.njit(cache=True, nogil=True, inline="always")
"""A kernel that is compiled as a part of each kernel that calls it, which is quicker."""

_UNCOUNTED: Any = {"_nrt": False}  # numba's stubs do not know it
leaf_kernel = numba.njit(cache=True, nogil=True, forceinline=True, **_UNCOUNTED)
"""A kernel that neither makes nor returns an array. References to the arrays that it is given are
not counted, which in a function of a few numbers takes as long as its work."""

finite_leaf = numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath=True, forceinline=True, **_UNCOUNTED
)
"""A `leaf_kernel` in which nothing is infinite or not a number."""

for_kernels = numba.extending.register_jitable
"""A Python function, of numbers or arrays, that kernels call, too: there it is compiled."""
