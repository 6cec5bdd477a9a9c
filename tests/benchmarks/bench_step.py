"""The mission step against the same step in C and numba: python -m tests.benchmarks.bench_step [--quick] [--out FILE].

The bundled default mission, its random numbers and its records at every output; everybody gets the same members and
fields, takes turns with the others in one process and may use every core. Compiling is left out. Drawing the
members on the host is timed apart, as the yardsticks get them drawn.
"""

from __future__ import annotations

import os

from tests.benchmarks.flights import calm_run, default_run, draw, engine, fly, full_run, home
from tests.benchmarks.measuring import (
    alternated,
    command_line,
    least,
    least_and_median,
    middle,
    once,
    part,
    repeated,
    table,
)
from tests.benchmarks.yardsticks.agreement import differences
from tests.benchmarks.yardsticks.arrays import arrays_of
from tests.benchmarks.yardsticks.in_c import CStep
from tests.benchmarks.yardsticks.in_numba import NumbaStep


def measure(n: int, days: float, repeat: int, *, full_members: int, full_days: float) -> dict:
    """Time forecaster and yardsticks in turns, and how far their results lie apart."""
    import numpy as np

    engine()
    threads = len(os.sched_getaffinity(0))
    run = default_run(n, days)[1]
    drawing = repeated(lambda: draw(run, n), repeat)
    members, available = draw(run, n)
    given = arrays_of(run, members)
    first, flown = once(lambda: fly(run, members))
    track = home(run, members, available, flown)
    calm = calm_run(min(n, 500), min(days, 5.0))
    calm_members, calm_available = draw(calm, min(n, 500))
    calm_track = home(calm, calm_members, calm_available, fly(calm, calm_members))
    calm_given = arrays_of(calm, calm_members)
    works, yardsticks = {"glider_jax": lambda: fly(run, members)}, {}
    for step in (CStep(), CStep(vectors=False), NumbaStep()):
        if step.reason:
            yardsticks[step.name] = {"skipped": step.reason}
            continue
        result = step.fly(given, threads)
        yardsticks[step.name] = {
            "version": step.version,
            "same_draws": differences(run, track, result),
            "without_current_error": differences(calm, calm_track, step.fly(calm_given, threads)),
            "steps_per_member": float(result.final[1].mean()),
        }
        works[step.name] = lambda step=step: step.fly(given, threads)
    times = alternated(works, repeat)
    for name, found in yardsticks.items():
        if name in times:
            found |= times[name]
            found["cpu_ratio"] = least(times["glider_jax"]["cpu_s"]) / least(found["cpu_s"])
            found["wall_ratio"] = middle(times["glider_jax"]["wall_s"]) / middle(found["wall_s"])
    own = times["glider_jax"] | {"steps_per_member": float(np.mean(np.asarray(flown[0].steps))), "first_s": first}
    found = {"n": n, "days": days, "threads": threads, "draw": drawing, "glider_jax": own, "yardsticks": yardsticks}
    if full_members:
        found["full"] = _full(full_members, full_days, max(1, repeat // 2))
    return found


def _full(n: int, days: float, repeat: int) -> dict:
    """The same with the flight model in stratified water, currents with depth and every device."""
    run = full_run(n, days)
    members, _ = draw(run, n)
    first, _ = once(lambda: fly(run, members))
    spent = repeated(lambda: fly(run, members), repeat)
    return spent | {"n": n, "days": days, "devices": len(run.vehicle.devices), "first_s": first}


def tables(found: dict) -> list[dict]:
    """One table of seconds, one of agreement."""
    n, days, own = found["n"], found["days"], found["glider_jax"]

    def row(what, spent, ratio_cpu="", ratio_wall=""):
        return [what, *least_and_median(spent["wall_s"]), *least_and_median(spent["cpu_s"]), ratio_cpu, ratio_wall]

    rows = [row("glider_jax: draw members", found["draw"]), row("glider_jax: fly", own, "1", "1")]
    apart = []
    for name, one in found["yardsticks"].items():
        if "skipped" in one:
            rows.append([f"{name}: not run, {one['skipped']}", *[""] * 6])
            continue
        rows.append(row(f"{name} ({one['version']})", one, f"{one['cpu_ratio']:.2f}", f"{one['wall_ratio']:.2f}"))
        for what, label in (("without_current_error", "currents without error"), ("same_draws", "as forecast")):
            d = one[what]
            apart.append([
                f"{name}, {label}", f"{d['position_median']:.2f}", f"{d['position_p99']:.2f}",
                f"{100 * d['energy_median']:.4f}", f"{100 * d['energy_p99']:.4f}", f"{d['mean_apart']:.1f}",
                f"{d['spread']:.4f}", f"{100 * d['outcomes']:.2f}",
            ])  # fmt: skip
    if "full" in found:
        full = found["full"]
        rows.append(row(
            f"glider_jax: fly {full['n']:,} members {full['days']:g} days by the flight model, stratified water, "
            f"currents with depth, {full['devices']} devices", full,
        ))  # fmt: skip
    rates = least(own["wall_s"]) / (n * days) * 1e6
    return [
        table(
            f"Step: {n:,} members, {days:g} days, {found['threads']} threads",
            ["what", "wall s, least", "wall s, median", "CPU s, least", "CPU s, median", "glider_jax over it, CPU",
             "glider_jax over it, wall"],
            rows,
            f"glider_jax takes {own['steps_per_member']:.0f} steps a member and {rates:.2f} µs of wall time a member "
            "and day; compiling, or loading what was kept, took "
            f"{own['first_s']['wall_s']:.1f} s once. CPU ratios are of the least, wall ratios of the medians.",
        ),
        table(
            "Step: distance of the yardsticks' results",
            ["yardstick", "position, median m", "position, p99 m", "energy, median %", "energy, p99 %",
             "mean end apart, m", "spread, ratio", "same outcome, %"],
            apart,
        ),
    ]  # fmt: skip


def main() -> None:
    """Command line of the benchmark."""
    given = command_line(__doc__)
    if given.quick:
        found = measure(500, 2.0, 3, full_members=100, full_days=1.0)
    else:
        found = measure(5000, 15.0, 11, full_members=5000, full_days=15.0)
    part("step", found, tables(found), given.out)


if __name__ == "__main__":
    main()
