"""Stage `code`, the first: list the files of the program that each stage runs.

DVC does not see imports. This stage follows them from the module of each stage and writes
data/code/<stage>.txt: every file of the program that the stage may run, with a digest. The stage
`params` puts a digest of this list into data/params/<stage>.yaml, on which the stage depends. So a
stage runs again when one of these files changes, and not when another file of the program does.

DVC does not let a stage depend on dvc.yaml. So what dvc.yaml declares in `meta` is copied to
data/code/declared.yaml; stages/pipeline.yaml is a link to dvc.yaml, so that DVC sees it change.

In a lab's own repository the program is installed elsewhere. There DVC runs this stage every time:
another version gives other lists, and so the stages whose files differ run again.
"""

from stages.run import run  # isort: skip

import ast
import hashlib
import re
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from finloop.base.program import HOME, describe_program
from finloop.base.settings import GROUPS, settings_file
from finloop.io.atomic import whole_folder
from stages.origins import DECLARED, paths_to_note, read_stages

ROOT = HOME  # relative paths in this module are below it: the same where finloop is installed
OUT = Path("data/code")
OURS = re.compile(r"(finloop|stages)(\.\w+)+")
LAZY = "finloop/__init__.py"  # imports lazily
PROJECT = "finloop/project.py"
DECLARATIONS = [f"finloop/{settings_file(group)}" for group in GROUPS]
BY_NAME = {"stages/params.py": {*DECLARATIONS, "finloop/edit/modes.py"}}
"""File → files that it reads without an import: the declarations of parameters, and the modes."""


def stage_module(stage: str) -> str:
    """Return the name of the module of a stage: "plots-film" gives "stages.plots.film"."""
    return f"stages.{stage.replace('-', '.')}"


def file_lists() -> dict[str, str]:
    """Return the content of each file data/code/<stage>.txt, by file name."""
    return {f"{stage}.txt": file_list_text(stage) for stage in read_stages()}


def file_list_text(stage: str) -> str:
    """Return the text of data/code/<stage>.txt: digest and path of each file that a stage runs.

    The files are the modules that the stage imports, directly or indirectly, and the other files in
    their packages. Paths are relative to the root, as everywhere in this module.
    """
    unread, files = module_files(stage_module(stage)), set[str]()
    while unread:
        file = unread.pop()
        files.add(file)
        unread |= imported_files(file) - files
    # Those in the packages themselves, finloop/ and stages/, belong to no stage in particular.
    packages = {Path(file).parent for file in files} - {Path("finloop"), Path("stages")}
    files = files.union(*map(_package_data, packages))
    return "".join(f"{hash_file(file)}  {file}\n" for file in sorted(files))


@cache
def hash_file(file: str) -> str:
    """Return 16 hexadecimal digits of the SHA-256 of a file, given by its path below the root."""
    return hashlib.sha256((ROOT / file).read_bytes()).hexdigest()[:16]


@cache
def _package_data(package: Path) -> set[str]:
    """Return the files of a package that are not Python.

    package: its folder. All paths are relative to the root.
    """
    files = set()
    for path in (ROOT / package).iterdir():
        if path.is_dir() and path.name != "__pycache__" and not (path / "__init__.py").exists():
            files |= _package_data(path.relative_to(ROOT))
        elif path.is_file() and path.suffix not in (".py", ".pyc"):
            files.add(path.relative_to(ROOT).as_posix())
    return files


def module_files(name: str) -> set[str]:
    """Return the file of a module, by its dotted name, and the __init__.py of packages above it.

    Parts of the name for which there is no file are left out.
    """
    parts, files = name.split("."), set()
    for depth in range(1, len(parts) + 1):
        path = Path(*parts[:depth])
        for candidate in (path / "__init__.py", path.with_suffix(".py")):
            if (ROOT / candidate).is_file():
                files.add(candidate.as_posix())
    return files


@cache
def imported_files(file: str) -> set[str]:
    """Return the program's files that a file needs: imported, named in a string, or read.

    finloop/__init__.py imports lazily: it counts as importing nothing. Each member of `Project`
    imports what it needs inside itself. So a stage depends on the members that it uses, of an
    object called `project` or of `Project(…)`, and not on the whole pipeline.
    """
    if file == LAZY:
        return set()
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    if file == PROJECT:
        return files_of_imports(tree.body)  # those of the module, without those of the members
    files = files_of_imports([*ast.walk(tree)]) | BY_NAME.get(file, set())
    if PROJECT in files:
        files |= _source_files_of_members(_members_of(tree, "project"))
    return files


def _source_files_of_members(names: set[str]) -> set[str]:
    """Return the source files that members of the class `Project`, and those they call, import.

    names: of the members; other names are ignored.
    """
    members, files, used = project_members(), set[str](), set[str]()
    unread = names & members.keys()
    while unread:
        name = unread.pop()
        used.add(name)
        files |= files_of_imports([*ast.walk(members[name])])
        unread |= (_members_of(members[name], "self") & members.keys()) - used
    return files


def files_of_imports(nodes: list[Any]) -> set[str]:
    """Return the program's files that syntax nodes (`ast`) import or name in a string."""
    names = set[str]()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and OURS.fullmatch(str(node.value)):
            names.add(str(node.value))
    return set().union(*(_files_of_name(name) for name in names if OURS.match(name)))


def _files_of_name(name: str) -> set[str]:
    """Return the program's files that a dotted name stands for: of a module, package, or object.

    A module, finloop.base.line, stands for its file. A package that imports lazily, finloop.export,
    stands for all its modules that offer objects. Of such a package an object, as
    finloop.export.export_atlas, stands for its module; any other object, as finloop.base.line.TANK,
    for the module before its last dot.
    """
    package, _, last_part = name.rpartition(".")
    module_by_object = _lazy_objects(package)
    names = {name} | {f"{name}.{module}" for module in _lazy_objects(name).values()}
    if last_part in module_by_object:
        names.add(f"{package}.{module_by_object[last_part]}")
    return set().union(*map(module_files, names))  # without the name of an object


@cache
def _lazy_objects(package: str) -> dict[str, str]:
    """Return the objects that a package imports lazily: name → its module.

    The result is {} for a package that does not import lazily, and for a module.
    """
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
    """Return the properties and methods of the class `Project`, name → syntax tree."""
    nodes = ast.parse((ROOT / PROJECT).read_text(encoding="utf-8")).body
    (project,) = (
        node for node in nodes if isinstance(node, ast.ClassDef) and node.name == "Project"
    )
    return {node.name: node for node in project.body if isinstance(node, ast.FunctionDef)}


def _members_of(tree: ast.AST, owner: str) -> set[str]:
    """Return the names of attributes that code reads from an object called `owner`.

    For the owner "project" these are x in `project.x`, `a.project.x` and `Project(…).x`.
    """

    def object_name(node: ast.AST) -> str:
        """Return the last name of an expression; of a call, the class's name in lower case."""
        if isinstance(node, ast.Call):
            return object_name(node.func).lower()
        return getattr(node, "id", getattr(node, "attr", ""))

    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    return {node.attr for node in nodes if object_name(node.value) == owner}


def main() -> None:
    """Write data/code/<stage>.txt for every stage of finloop's dvc.yaml; print which finloop runs.

    data/code/declared.yaml gets what each stage declares in `meta`: the parameters that it uses and
    the paths whose digests it notes.
    """
    print(f"code: {describe_program()}")
    with whole_folder(OUT) as folder:
        for name, text in file_lists().items():
            (folder / name).write_text(text, encoding="utf-8")
        declared = {
            name: {"params": stage["meta"]["params"], "noted": paths_to_note(stage)}
            for name, stage in read_stages().items() if "meta" in stage
        }  # fmt: skip
        (folder / DECLARED.name).write_text(yaml.safe_dump(declared), encoding="utf-8")


if __name__ == "__main__":
    run(main)
