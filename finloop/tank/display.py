"""Off-screen drawing of VTK, which without a suitable library would end the process."""

import ctypes
import os
import sys

from finloop.base.errors import FinloopError

_LIBRARIES = {  # by name: the window of VTK that needs it
    "libEGL.so.1": "vtkEGLRenderWindow",
    "libOSMesa.so.8": "vtkOSOpenGLRenderWindow",
    "libOSMesa.so": "vtkOSOpenGLRenderWindow",
}


def choose_window(libraries: dict[str, str] = _LIBRARIES) -> None:
    """Make VTK draw off-screen, with the first of these libraries that is installed.

    Call it before the first window. On systems other than Linux VTK brings what it needs.
    FinloopError if none is installed.
    """
    if not sys.platform.startswith("linux"):
        return
    for library, window in libraries.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = window  # else it asks for a screen first
        return
    raise FinloopError(
        f"none of {', '.join(libraries)} is installed, so that nothing can be drawn in 3-D",
        "a library that draws without a screen",
        "install one (Debian, Ubuntu: apt-get install libegl1), then: dvc repro tank",
    )
