"""Double precision and strict promotion for every test of the physics."""

from __future__ import annotations

import jax
import pytest


@pytest.fixture(autouse=True)
def strict_numbers():
    """x64 on, no silent change of dtype or rank, while a test runs."""
    with jax.enable_x64(True), jax.numpy_dtype_promotion("strict"), jax.numpy_rank_promotion("raise"):
        yield
