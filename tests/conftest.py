"""Shared fixtures: JAX in double precision, the folder of real files, and markers that must be asked for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

os.environ.setdefault("MPLBACKEND", "Agg")

SHARED = Path(os.environ.get("GLIDER_JAX_SHARED", Path(__file__).resolve().parents[2] / "shared"))


def pytest_addoption(parser):
    """Markers for long runs are off unless asked for."""
    for name in ("slow", "validation", "benchmarks"):
        parser.addoption(f"--{name}", action="store_true", default=False, help=f"run tests marked {name}")


def pytest_collection_modifyitems(config, items):
    """Skip marked tests whose option was not given."""
    for name in ("slow", "validation", "benchmarks"):
        if config.getoption(f"--{name}"):
            continue
        skip = pytest.mark.skip(reason=f"needs --{name}")
        for item in items:
            # By the marker itself: a folder of the same name is a keyword too.
            if item.get_closest_marker(name) is not None:
                item.add_marker(skip)


#: Bytes of resident memory beyond which compiled programs are let go between modules.
ROOM = 4e9


@pytest.fixture(autouse=True, scope="module")
def _room():
    """Programs of modules that are done do not pile up: the suite compiles some thousands of them."""
    yield
    pages = Path("/proc/self/statm")
    if pages.exists() and int(pages.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") > ROOM:
        import jax

        jax.clear_caches()


@pytest.fixture(scope="session")
def real():
    """Return a function that gives the path of a real file, or skips the test with a reason."""

    def path(*parts: str) -> Path:
        found = SHARED.joinpath("real", *parts)
        if not found.exists():
            pytest.skip(f"real file {'/'.join(parts)} is not here (looked under {SHARED / 'real'})")
        return found

    return path
