"""Imports go one way, and commands that need no JAX do not load it."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import glider_jax

PACKAGE = Path(glider_jax.__file__).parent
ORDER = {
    "errors": 0, "records": 0, "config": 0,
    "board": 1, "readers": 1, "environment": 1,
    "physics": 2,
    "mission": 3, "inference": 3,
    "diagnosis": 4, "products": 4,
}  # fmt: skip
NO_JAX = ("board", "readers", "errors", "records", "config")


def _layer(dotted: str) -> str:
    parts = dotted.split(".")
    return parts[1] if len(parts) > 1 else ""


def _imports(path: Path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            yield node.module


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_one_way(path):
    here = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if here == "__init__":
        return
    for name in _imports(path):
        assert not name.startswith("glider_jax_cli"), f"{path.name} imports the command line"
        if name.startswith("glider_jax."):
            assert ORDER[_layer(name)] <= ORDER[here], f"{path.relative_to(PACKAGE)} imports {name}"
        if here in NO_JAX:
            assert name.split(".")[0] not in ("jax", "equinox"), f"{path.relative_to(PACKAGE)} imports {name}"


@pytest.mark.parametrize("words", [["--help"], ["ensemble", "--help"], ["terms", "--help"], ["recording", "--help"]])
def test_help_loads_no_jax(words):
    code = (
        "import sys\n"
        "from glider_jax_cli.main import main\n"
        f"sys.argv = ['glider-forecast', *{words!r}]\n"
        "try:\n    main()\nexcept SystemExit as stop:\n    assert not stop.code, stop.code\n"
        "heavy = [m for m in ('jax', 'xarray', 'netCDF4', 'matplotlib', 'scipy') if m in sys.modules]\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_no_module_called_cli_is_installed():
    code = "import importlib.util, sys; sys.exit(importlib.util.find_spec('cli') is not None)"
    assert subprocess.run([sys.executable, "-c", code], cwd="/", check=False).returncode == 0
