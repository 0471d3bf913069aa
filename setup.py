"""Build the wheel: the packages, and below finloop/shipped/ what is no Python (see finloop/lab).

Everything else stands in pyproject.toml. The build works in a folder of its own, so that no file of
an earlier build gets into the wheel.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from setuptools import find_packages, setup

SHIPPED = Path("finloop/lab/files.txt").read_text(encoding="utf-8").split()
DATA = ["*.html", "*.j2", "*.js", "*.txt", "*.yaml", "page/*", "template/*"]

with TemporaryDirectory() as folder:
    setup(
        packages=[
            *find_packages(include=["finloop", "finloop.*", "stages", "stages.*"]),
            "hydra_plugins",
            "finloop.shipped",
        ],
        package_dir={"finloop.shipped": "."},
        package_data={"": DATA, "finloop.shipped": SHIPPED},
        exclude_package_data={"finloop.shipped": ["conf/local/default.yaml"]},
        options={"build": {"build_base": folder}, "egg_info": {"egg_base": folder}},
    )
