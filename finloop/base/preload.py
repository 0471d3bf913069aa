"""What the server that forks workers imports beforehand: see `finloop.base.parallel`.

Python runs the module of `python -m` again in each worker, and warns if it is imported already. So
only what that module imports stays.
"""

import importlib
import os
import sys

if _module := os.environ.get("FINLOOP_RUN_MODULE"):
    importlib.import_module(_module)
    del sys.modules[_module]
