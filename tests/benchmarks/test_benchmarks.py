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


def test_scaling_benchmark(capsys):
    from tests.benchmarks import bench_scaling

    found = {"commands": bench_scaling.commands(1), "scaling": bench_scaling.scaling([100, 5000], [1.0, 15.0])}
    with capsys.disabled():
        print(f"\n{bench_scaling.table(found | {'machine': '', 'cpus': 0, 'jax': ''})}")
    assert {(row["n"], row["days"]) for row in found["scaling"]} == {(100, 1.0), (100, 15.0), (5000, 15.0)}
    assert all(run["cpu_s"] > 0 for runs in found["commands"].values() for run in runs.values())
