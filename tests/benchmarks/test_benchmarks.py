"""The benchmarks measure what they say: yardsticks fly the same mission, drifts end where they must, tables are whole.

Nothing here asserts a time.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks import measuring, targets
from tests.benchmarks.yardsticks import arrays

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def calm():
    """A short flight without errors of the currents: its run, track and arrays."""
    from tests.benchmarks.flights import calm_run, draw, fly, home

    run = calm_run(48, 1.0)
    members, available = draw(run, 48)
    return run, home(run, members, available, fly(run, members)), arrays.arrays_of(run, members)


def _agrees(step, calm):
    from tests.benchmarks.yardsticks.agreement import differences

    if step.reason:
        pytest.skip(step.reason)
    run, track, given = calm
    found = differences(run, track, step.fly(given, 2))
    assert found["position_median"] < 10.0 and found["position_p99"] < 50.0
    # One stroke more or less by an output time is some per mille of a day's energy.
    assert found["energy_median"] < 1e-3 and found["energy_p99"] < 1e-2 and found["outcomes"] == 1.0
    assert abs(found["spread"] - 1.0) < 1e-2 and found["mean_apart"] < 10.0
    # One thread, and members that do not fill the last block, change nothing.
    one = step.fly(given, 1)
    assert np.array_equal(one.row("east"), step.fly(given, 2).row("east"), equal_nan=True)


def test_the_c_step_flies_the_same_mission(calm):
    from tests.benchmarks.yardsticks.in_c import CStep

    _agrees(CStep(), calm)


@pytest.mark.benchmarks
def test_the_numba_step_flies_the_same_mission(calm):
    from tests.benchmarks.yardsticks.in_numba import NumbaStep

    _agrees(NumbaStep(), calm)


def test_yardsticks_refuse_physics_that_they_lack():
    from tests.benchmarks.flights import default_run, draw

    _, run = default_run(4, 1.0, speed="flight")
    with pytest.raises(ValueError, match="bundled default mission only"):
        arrays.arrays_of(run, draw(run, 4)[0])


def _names(macro: str, source: str) -> list[str]:
    body = re.search(rf"#define {macro}\(X\)((?:.*\\\n)*.*)", source).group(1)
    return re.findall(r"X\((\w+)\)", body)


def test_arrays_and_c_name_the_same_numbers_in_the_same_order():
    source = (HERE / "yardsticks" / "mission.c").read_text(encoding="utf-8")
    assert _names("MEMBER", source) == list(arrays.MEMBER)
    plan = re.search(r"typedef struct \{\s*float (.*?);\s*\} Plan;", source, re.S).group(1)
    named = []
    for word in re.findall(r"\w+(?:\[\d+\])?", plan):
        name, _, count = word.partition("[")
        named += [f"{name}_{k}" for k in range(int(count[:-1]))] if count else [name]
    assert named == list(arrays.PLAN)
    grids = re.search(r"typedef struct \{([^}]*)\} Grids;", source).group(1)
    floats, counts = (re.search(rf"{kind} (.*?);", grids, re.S).group(1) for kind in (r"\n    float", "int32_t"))
    assert re.findall(r"\w+", floats) == list(arrays.PLACES) and re.findall(r"\w+", counts) == list(arrays.COUNTS)
    assert f"#define ROWS {len(arrays.RECORD)}\n" in source


def test_drift_ends_where_small_steps_end():
    """The forecaster without forward speed against RK4 of one minute in NumPy, on the ellipsoid."""
    from tests.benchmarks.bench_peers import distance_km, ocean, own_drift
    from tests.benchmarks.peers.drifting import metres_per_degree

    field = time, latitude, longitude, u, v = ocean(1.0)
    starts, ends, _, _ = own_drift(24, 1.0, 1, field)

    def velocity(at, place):
        f = at / 3600.0
        k = int(f)
        x = (place[0] - longitude[0]) / (longitude[1] - longitude[0])
        y = (place[1] - latitude[0]) / (latitude[1] - latitude[0])
        i, j = x.astype(int), y.astype(int)
        x, y = x - i, y - j

        def here(w):
            low, high = w[:, j, i] * (1 - x) + w[:, j, i + 1] * x, w[:, j + 1, i] * (1 - x) + w[:, j + 1, i + 1] * x
            both = low * (1 - y) + high * y
            return both[k] * (1 - (f - k)) + both[k + 1] * (f - k)

        return np.stack([here(u), here(v)]) / np.stack(metres_per_degree(place[1]))

    place, step = starts.copy(), 60.0
    for at in np.arange(0.0, 86400.0, step):
        a = velocity(at, place)
        b = velocity(at + 0.5 * step, place + 0.5 * step * a)
        c = velocity(at + 0.5 * step, place + 0.5 * step * b)
        d = velocity(at + step, place + step * c)
        place = place + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    assert np.median(distance_km(starts, place)) > 5.0
    assert distance_km(ends, place).max() < 0.05


def test_a_peer_that_is_absent_or_fails_is_left_out_with_its_reason(tmp_path):
    from tests.benchmarks.bench_peers import PEERS, peer_drift, tables

    found = peer_drift(Path(sys.executable), "drift_parcels3.py", tmp_path / "none.nc", tmp_path / "none.npy", 1.0, 1)
    assert "skipped" in found and ("parcels" in found["skipped"] or "none.npy" in found["skipped"])
    one = {"wall_s": [1.0, 2.0], "cpu_s": [1.0, 3.0]}
    shown = tables({
        "n": 10, "days": 1.0, "steps_per_member": 100.0, "glider_jax": one, "displacement_km": {"median": 3.0},
        "peers": {name: found for name in PEERS},
    })[0]  # fmt: skip
    assert len(shown["rows"]) == 1 + len(PEERS) and all("not run" in row[1] for row in shown["rows"][1:])
    assert all(len(row) == len(shown["columns"]) for row in shown["rows"])


def test_tables_are_markdown_with_numbers_to_the_right():
    shown = measuring.markdown([measuring.table("One", ["what", "s"], [["a|b", 1.5], ["c", ""]], "A note.")])
    lines = ["## One", "", "| what | s |", "| --- | ---: |", "| a/b | 1.5 |", "| c |  |", "", "A note."]
    assert shown.splitlines() == lines
    assert measuring.least_and_median([0.30001, 0.1, 0.2]) == ("0.1", "0.2") and measuring.seconds(123.4) == "123"


def test_a_command_is_timed_with_its_memory_and_its_failure_says_why():
    spent = measuring.command([sys.executable, "-c", "x = bytearray(80_000_000); sum(range(3_000_000))"])
    assert spent["cpu_s"] > 0.02 and spent["wall_s"] >= 0.5 * spent["cpu_s"] and spent["peak_mb"] > 75.0
    with pytest.raises(RuntimeError, match=r"ended with 1: [\s\S]*ZeroDivisionError"):
        measuring.command([sys.executable, "-c", "1 / 0"])


def test_targets_are_judged_by_what_was_found():
    spent = {"wall_s": [0.2, 0.1], "cpu_s": [0.2, 0.15]}
    step = {"n": 5000, "days": 15.0, "draw": {"wall_s": [0.02], "cpu_s": [0.02]}, "glider_jax": spent,
            "yardsticks": {"C": {"cpu_ratio": 1.6}, "numba": {"skipped": "absent"}}}  # fmt: skip
    drift = {"version": "A 1", "cpu_ratio": 12.0, "apart_km": {"max": 0.3}}
    peers = {"peers": {"a": drift, "b": {"skipped": "absent"}}}
    rows = targets.targets({"step": step, "peers": peers})[0]["rows"]
    assert [row[3] for row in rows] == ["yes", "no", "no"]
    assert targets.targets({}) == []


def test_a_benchmark_that_fails_leaves_a_line(tmp_path):
    from tests.benchmarks.__main__ import MARK, put, run, text

    part = run("of_nothing", tmp_path, True, None)
    assert "No module named" in part["failed"]
    whole = text({"quick": True, "date": "today", "machine": measuring.machine(), "parts": [part]})
    assert "## of_nothing: failed" in whole and "Load when the run began" in whole
    page = tmp_path / "page.md"
    page.write_text(f"Words.\n\n{MARK}\n\nold\n")
    put(page, whole)
    assert page.read_text() == f"Words.\n\n{MARK}\n\n{whole}"


@pytest.mark.slow
@pytest.mark.benchmarks
def test_one_command_runs_every_benchmark(tmp_path):
    made = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks", "--quick", "--out", str(tmp_path)], capture_output=True, text=True
    )
    assert made.returncode == 0, made.stderr
    found = json.loads((tmp_path / "table.json").read_text())
    assert [part["name"] for part in found["parts"]] == ["step", "peers", "accuracy", "stages", "scaling", "diagnosis"]
    step = found["parts"][0]["data"]
    assert step["glider_jax"]["steps_per_member"] > 100 and min(step["glider_jax"]["cpu_s"]) > 0
    shown = (tmp_path / "table.md").read_text()
    assert all(one["title"] in shown for part in found["parts"] for one in part["tables"])
