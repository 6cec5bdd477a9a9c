"""The benchmarks run and say what they measured; nothing here asserts a time."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.benchmarks


@pytest.mark.parametrize("speed", ["distribution", "flight"])
def test_ensemble_benchmark(speed, capsys):
    from tests.benchmarks.bench_ensemble import measure, table

    result = measure(5000, 5, speed, 15.0)
    with capsys.disabled():
        print(f"\n{speed}\n{table(result)}")
    assert {"draw and fly", "netCDF", "summary", "map"} <= set(result["stages"])
    assert result["steps_per_member"] > 100
