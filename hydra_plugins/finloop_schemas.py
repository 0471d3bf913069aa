"""Let Hydra find finloop's schemas; `stages.schemas` registers them.

Hydra imports this in every process that composes. DVC looks in the repository's root last, after
the installed packages. So that a working copy of finloop composes by its own sources even where
another version is installed, the copy around the present folder goes first.

There is no `__init__.py`: `hydra_plugins` is a namespace that installed plugins share.
"""

import sys
from importlib import import_module
from pathlib import Path

for folder in (Path.cwd(), *Path.cwd().parents):
    if all((folder / name).is_file() for name in ("dvc.yaml", "finloop/__init__.py")):
        sys.path.insert(0, str(folder))
        try:
            import_module("stages.schemas")
        finally:
            sys.path.remove(str(folder))
        break
else:
    import_module("stages.schemas")
