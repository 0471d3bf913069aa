"""Limits that keep the code readable: lines of a module, function, pipeline, kernels' arguments.

Ruff (PLR0913, `max-args` in pyproject.toml) counts the arguments of all other functions.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
MODULE_LINES, FUNCTION_LINES, KERNEL_ARGUMENTS, PIPELINE_LINES = 900, 80, 9, 250


def above(path: str, text: str) -> Iterator[str]:
    """What is above a limit in a module: its path, or path::function."""
    if len(text.splitlines()) > MODULE_LINES:
        yield path
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            lines = node.end_lineno - node.lineno + 1
            kernel = any("kernel" in ast.unparse(decorator) for decorator in node.decorator_list)
            arguments = len(node.args.posonlyargs + node.args.args + node.args.kwonlyargs)
            if lines > FUNCTION_LINES or (kernel and arguments > KERNEL_ARGUMENTS):
                yield f"{path}::{node.name}"


def test_modules_functions_and_kernels_keep_their_limits():
    found = {
        name
        for room in ("finloop", "stages", "hydra_plugins")
        for path in (ROOT / room).rglob("*.py")
        for name in above(path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8"))
    }
    assert found == set()


def test_the_pipeline_is_read_on_a_few_screens():
    assert len((ROOT / "dvc.yaml").read_text(encoding="utf-8").splitlines()) <= PIPELINE_LINES


def test_what_is_above_a_limit_is_found():
    long = "def f():\n" + "    pass\n" * FUNCTION_LINES
    assert list(above("a.py", long)) == ["a.py::f"]
    assert list(above("a.py", "x = 1\n" * (MODULE_LINES + 1))) == ["a.py"]
    crowd = "(a, b, c, d, e, f, g, h, i, j):\n    pass\n"
    assert list(above("a.py", f"@kernel(cache=True)\ndef f{crowd}\ndef g{crowd}")) == ["a.py::f"]


# --- tests


WAITS = {"conftest.py"}  # the home of `wait_for`


def bad_habits(text: str) -> Iterator[str]:
    """What a test module imports of another, and where it looks at the clock, sleeps, or is hasty.

    Who waits for something waits for `conftest.PATIENCE_S`.
    """
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names if one.name.startswith(("test_", "tests.")))
        elif isinstance(node, ast.ImportFrom):
            yield from [node.module or "."] * (node.module or "test_").startswith(
                ("test_", "tests.")
            )
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield from [f"time.{node.attr}"] * (node.value.id == "time")
        elif isinstance(node, ast.Call):
            is_sleep = getattr(node.func, "attr", "") == "sleep"
            limits = [one.value for one in node.keywords if one.arg == "timeout"]
            limits += [one for one in node.args if is_sleep and ast.unparse(one) != "0"]
            yield from (ast.unparse(node) for one in limits if isinstance(one, ast.Constant))


def test_no_test_imports_another_sleeps_or_asserts_a_time():
    found = {
        (path.name, habit)
        for path in (ROOT / "tests").glob("*.py")
        if path.name not in WAITS
        for habit in bad_habits(path.read_text(encoding="utf-8"))
    }
    assert not found


def test_bad_habits_are_found():
    text = "from test_a import b\nimport tests.c\nfrom . import d\ntime.time()\nimport time"
    assert list(bad_habits(text)) == ["test_a", "tests.c", ".", "time.time"]
    text = "a.sleep(0.1)\na.sleep(0)\nb.get(timeout=5)\nb.get(timeout=PATIENCE_S)"
    assert sorted(bad_habits(text)) == ["a.sleep(0.1)", "b.get(timeout=5)"]
