"""Stage `code`, the first: list the files of the program that each stage runs.

DVC does not see imports. This stage follows them from the module of each stage and writes
data/code/<stage>.txt: every file of the program that the stage may run, with a digest. A stage
depends on its list. It runs again when one of these files changes, and not when another file of the
program does.
"""

from stages.run import run  # isort: skip

import ast
import hashlib
import re
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from finloop.base.settings import GROUPS, settings_file
from finloop.io.atomic import whole_folder

ROOT = Path(__file__).parents[1]
OUT = Path("data/code")
OURS = re.compile(r"(finloop|stages)(\.\w+)+")
LAZY = "finloop/__init__.py"  # imports lazily
PROJECT = "finloop/project.py"
PARTS = {PROJECT: "Project", "finloop/run_files.py": "RunFiles"}  # its class, and the base of that
DECLARATIONS = [f"finloop/{settings_file(one)}" for one in GROUPS]
BY_NAME = {"stages/params.py": {*DECLARATIONS, "finloop/edit/modes.py"}}
"""What a file reads without an import: every declaration, and the modes that one names."""


def module_of(stage: str) -> str:
    """Return the module of a stage: "plots-film" gives "stages.plots.film"."""
    return f"stages.{stage.replace('-', '.')}"


def file_list_text(stage: str) -> str:
    """Return the text of data/code/<stage>.txt: a line with digest and path for each file.

    The files are those of the program that the stage may run.
    """
    files = add_data(follow_imports(module_files(module_of(stage))))
    lines = [f"{hash_file(file)}  {file}\n" for file in sorted(files)]
    return "".join(lines)


@cache
def hash_file(file: str) -> str:
    """Return 16 hexadecimal digits of the SHA-256 of a file; file: path from the root."""
    return hashlib.sha256((ROOT / file).read_bytes()).hexdigest()[:16]


def add_data(files: set[str]) -> set[str]:
    """Add to Python files the other files in their packages, and return all.

    Paths are relative to the root, as everywhere in this module.
    """
    packages = {Path(file).parent for file in files} - {Path("finloop"), Path("stages")}
    return files.union(*map(package_data, packages))


@cache
def package_data(package: Path) -> set[str]:
    """Return a package's files that are not Python, with those in its plain subfolders."""
    found = set()
    for path in (ROOT / package).iterdir():
        if path.is_dir() and path.name != "__pycache__" and not (path / "__init__.py").exists():
            found |= package_data(path.relative_to(ROOT))
        elif path.is_file() and path.suffix not in (".py", ".pyc"):
            found.add(path.relative_to(ROOT).as_posix())
    return found


def follow_imports(files: set[str]) -> set[str]:
    """Return these files and all files of the program that they import, directly or indirectly."""
    todo, seen = set(files), set[str]()
    while todo:
        file = todo.pop()
        seen.add(file)
        todo |= imported_files(file) - seen
    return seen


def module_files(name: str) -> set[str]:
    """Return the files of a module: its own and the __init__.py of each package above it.

    name: dotted; for an unknown name only the packages that exist.
    """
    parts = name.split(".")
    files = set()
    for depth in range(1, len(parts) + 1):
        path = Path(*parts[:depth])
        for candidate in (path / "__init__.py", path.with_suffix(".py")):
            if (ROOT / candidate).is_file():
                files.add(candidate.as_posix())
    return files


@cache
def imported_files(file: str) -> set[str]:
    """Return the program's files that a file imports anywhere, or names in a string.

    finloop/__init__.py imports lazily: it counts as importing nothing. Each property and method of
    `Project` imports what it needs inside itself. So a stage depends on what it uses, and not on
    the whole pipeline. Of finloop/project.py and finloop/run_files.py only the imports at the top
    count. A file that imports `Project` also has the imports of those members that it uses, and of
    the members that these use. It uses a member of an object called `project` or of `Project(…)`.
    """
    if file == LAZY:
        return set()
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    if file in PARTS:
        return files_of_imports(tree.body)
    found = files_of_imports([*ast.walk(tree)]) | BY_NAME.get(file, set())
    if PROJECT in found:
        for member in follow_members(attribute_names(tree, "project")):
            found |= files_of_imports([*ast.walk(project_members()[member])])
    return found


def files_of_imports(nodes: list[Any]) -> set[str]:
    """Return the program's files that some syntax nodes import, or name in a string constant."""
    names = set[str]()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and OURS.fullmatch(str(node.value)):
            names.add(str(node.value))
    return set().union(*(files_of_name(name) for name in names if OURS.match(name)))


def files_of_name(name: str) -> set[str]:
    """Return the files behind a dotted name: a module, a lazy package, or an object in one."""
    package, _, part = name.rpartition(".")
    attached = lazy_parts(package)
    modules = {name} | {f"{name}.{module}" for module in lazy_parts(name).values()}
    if part in attached:
        modules.add(f"{package}.{attached[part]}")
    return set().union(*map(module_files, modules))


@cache
def lazy_parts(package: str) -> dict[str, str]:
    """Return name → module for what a package offers by `lazy_loader.attach`; else {}."""
    path = ROOT / package.replace(".", "/") / "__init__.py"
    if not package or not path.is_file():
        return {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.keyword) and node.arg == "submod_attrs":
            return {
                name: module
                for module, names in ast.literal_eval(node.value).items()
                for name in names
            }
    return {}


@cache
def project_members() -> dict[str, ast.FunctionDef]:
    """Return name → syntax tree of the members of `Project` and of its base class."""
    found = dict[str, ast.FunctionDef]()
    for file, name in PARTS.items():
        body = ast.parse((ROOT / file).read_text(encoding="utf-8")).body
        (part,) = (one for one in body if isinstance(one, ast.ClassDef) and one.name == name)
        found |= {one.name: one for one in part.body if isinstance(one, ast.FunctionDef)}
    return found


def attribute_names(tree: ast.AST, owner: str) -> set[str]:
    """Return the names of the attributes that code reads of an object called `owner` (lower case).

    For "project" they are x in `project.x`, in `a.project.x` and in `Project(…).x`.
    """

    def object_name(node: ast.AST) -> str:
        if isinstance(node, ast.Call):
            return object_name(node.func).lower()
        return getattr(node, "id", getattr(node, "attr", ""))

    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    return {node.attr for node in nodes if object_name(node.value) == owner}


def follow_members(names: set[str]) -> set[str]:
    """Return those names that are members of `Project`, and the members they use by `self`."""
    todo, seen = names & set(project_members()), set[str]()
    while todo:
        member = todo.pop()
        seen.add(member)
        uses = attribute_names(project_members()[member], "self")
        todo |= (uses & set(project_members())) - seen
    return seen


def main() -> None:
    """Write data/code/<stage>.txt for every stage of dvc.yaml."""
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text(encoding="utf-8"))["stages"]
    with whole_folder(OUT) as folder:
        for stage in stages:
            (folder / f"{stage}.txt").write_text(file_list_text(stage), encoding="utf-8")


if __name__ == "__main__":
    run(main)
