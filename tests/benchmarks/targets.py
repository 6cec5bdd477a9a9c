"""What is wanted of the forecaster's speed and accuracy, beside what a run of the benchmarks found.

Times are wall seconds, least of the repeats; CPU seconds stand beside them, as a machine that others use makes the
first too long.
"""

from __future__ import annotations

from typing import Any

from tests.benchmarks.measuring import least, seconds, table


def _time(what: str, wall: float, cpu: float, limit: float) -> list[str]:
    return [what, f"{seconds(wall)} s, CPU {seconds(cpu)} s", f"{limit:g} s", "yes" if wall <= limit else "no"]


def _most(what: str, value: float, limit: float, unit: str = "") -> list[str]:
    return [what, f"{seconds(value)}{unit}", f"at most {limit:g}{unit}", "yes" if value <= limit else "no"]


def _spent(runs: list[dict[str, float]], key: str) -> float:
    return min(run[key] for run in runs)


def _step(data: dict[str, Any]) -> list[list[str]]:
    own, drawn = data["glider_jax"], data["draw"]
    both = [least(own[key]) + least(drawn[key]) for key in ("wall_s", "cpu_s")]
    rows = [_time(f"{data['n']:,} members, {data['days']:g} days, drawn and flown", *both, 0.15)]
    for name, limit in (("numba", 1.0), ("C", 1.5)):
        one = data["yardsticks"].get(name, {})
        if "cpu_ratio" in one:
            rows.append(_most(f"CPU seconds over those of the step in {name}", one["cpu_ratio"], limit))
    if "full" in data:
        full = data["full"]
        what = "the same by the flight model in stratified water, currents with depth, all devices"
        rows.append(_time(what, least(full["wall_s"]), least(full["cpu_s"]), 1.0))
    return rows


def _peers(data: dict[str, Any]) -> list[list[str]]:
    rows = []
    for one in data["peers"].values():
        if "cpu_ratio" in one:
            ratio, apart = one["cpu_ratio"], one["apart_km"]["max"]
            good = ratio >= 10.0 and apart <= 0.2
            rows.append([
                f"drift against {one['version']}", f"{ratio:.1f} times fewer CPU s, ends within {apart:.3f} km",
                "10 times, 0.2 km", "yes" if good else "no",
            ])  # fmt: skip
    return rows


def _accuracy(data: dict[str, Any]) -> list[list[str]]:
    share = 100.0 * data["members_within_50_m"]
    return [
        _most("position against small steps, p99", data["position_m"]["p99"], 50.0, " m"),
        ["members always within 50 m", f"{share:.1f} %", "99 %", "yes" if share >= 99.0 else "no"],
        _most("energy against small steps, p99", 100.0 * data["energy"]["p99"], 0.1, " %"),
    ]


def _scaling(data: dict[str, Any]) -> list[list[str]]:
    commands = data["commands"]
    plain, drawn = (commands.get(f"ensemble --n 5000 --format nc,json{more}") for more in ("", ",map,battery"))
    following = commands.get("next --recording recording.nc --now data", {"skipped": ""})
    rows = []
    if plain:
        rows.append(_time("`ensemble --n 5000`, first run", plain["first"]["wall_s"], plain["first"]["cpu_s"], 3.0))
        rows.append(_time("`ensemble --n 5000`, warm", *(_spent(plain["warm"], k) for k in ("wall_s", "cpu_s")), 1.5))
    if plain and drawn:
        more = (_spent(drawn["warm"], k) - _spent(plain["warm"], k) for k in ("wall_s", "cpu_s"))
        rows.append(_time("map and fan chart, warm, on top", *more, 2.0))
    if "warm" in following:
        rows.append(_time("`next`, warm", *(_spent(following["warm"], k) for k in ("wall_s", "cpu_s")), 5.0))
    if "million" in data:
        one = data["million"]
        rows.append(_time(f"{one['n']:,} members, 15 days, streamed", one["wall_s"], one["cpu_s"], 30.0))
        rows.append(_most("its peak memory", one["peak_mb"], 1000.0, " MB"))
    return rows


def _diagnosis(data: dict[str, Any]) -> list[list[str]]:
    if "skipped" in data:
        return []
    return [
        _time("diagnosis of 3.5 days, cold", data["cold"]["wall_s"], data["cold"]["cpu_s"], 180.0),
        _time("diagnosis of 3.5 days, warm", *(_spent(data["warm"], k) for k in ("wall_s", "cpu_s")), 60.0),
    ]


_ROWS = {"step": _step, "peers": _peers, "scaling": _scaling, "diagnosis": _diagnosis, "accuracy": _accuracy}


def targets(found: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """The table of what is wanted, from the numbers of each benchmark by name; none where nothing was measured."""
    rows = [row for name, rows_of in _ROWS.items() if name in found for row in rows_of(found[name])]
    if not rows:
        return []
    note = "Wall seconds are the least of the repeats."
    return [table("What is wanted", ["what", "found", "wanted", "met"], rows, note)]
