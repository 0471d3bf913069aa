"""Compiled functions: how numba compiles a kernel, and when it compiles it again.

Numba keeps a file's machine code in `__pycache__` until that file changes. But a kernel also
contains the kernels of other files that it calls. So this module keeps machine code only while
every file with a kernel is unchanged.
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
def _sources_digest() -> str:
    """Return a SHA-256 digest (hex) of finloop's files with compiled functions.

    They are taken to be the files whose text contains the word `kernel`.
    """
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        text = path.read_bytes()
        if _MENTION in text:
            digest.update(text)
    return digest.hexdigest()


class _AllSources:
    """Makes numba compile a kernel again when any file with a kernel has changed.

    It replaces two methods of numba's cache locators, which look at the kernel's own file only.
    """

    _lineno: int  # of the kernel in its file; set by numba

    def get_source_stamp(self) -> str:
        """Return a digest of all kernels' files; numba compiles again when it changes."""
        return _sources_digest()

    def get_disambiguator(self) -> str:
        """Return a cache file's suffix: the kernel's line, and 8 digits of all kernels' digest.

        Without the digest, numba would load an older file, which may name removed types and fail.
        """
        return f"{self._lineno}-{_sources_digest()[:8]}"


class InTree(_AllSources, InTreeCacheLocator):
    """Tells numba to keep a kernel's machine code beside its source file."""


class UserWide(_AllSources, UserWideCacheLocator):
    """Tells numba to keep machine code in the user's cache where the source folder is read-only."""


numba.config.CACHE_LOCATOR_CLASSES = ",".join(  # type: ignore[attr-defined]
    f"{__name__}.{locator.__name__}" for locator in (InTree, UserWide)
)

kernel = numba.njit(cache=True, nogil=True)
"""Compiles a function when it is first called, for every type of arguments."""

finite_kernel = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
"""A `kernel` for functions whose values are all finite."""

kernel_part = numba.njit(cache=True, nogil=True, inline="always")
"""A kernel that is inlined into each kernel that calls it, which is faster."""

_UNCOUNTED: Any = {"_nrt": False}  # numba's stubs do not know it
leaf_kernel = numba.njit(cache=True, nogil=True, forceinline=True, **_UNCOUNTED)
"""A kernel that neither makes nor returns an array. Numba does not count references to its
arguments: in a function of a few numbers, counting takes as long as the work."""

finite_leaf = numba.njit(
    cache=True, nogil=True, error_model="numpy", fastmath=True, forceinline=True, **_UNCOUNTED
)
"""A `leaf_kernel` whose values are all finite."""

for_kernels = numba.extending.register_jitable
"""A Python function that kernels can call as well; numba compiles it there."""
