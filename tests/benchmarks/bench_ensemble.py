"""Stages of the main job: python -m tests.benchmarks.bench_ensemble [--quick] [--out FILE] [--speed flight].

Imports, reading, tabulating, compiling or loading, drawing, flying, netCDF, summary, pictures: each timed apart, in a
process of its own, first with an empty cache folder, then with a filled one. The command itself overlaps some of
them, so that it can take less than their sum; whole commands are timed by bench_scaling.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.benchmarks.measuring import command_line, least_and_median, once, part, seconds, table


def measure(n: int, speed: str, days: float) -> dict:
    """Run every stage of the default mission once, in this process, and return their times and the peak memory."""
    stages: dict[str, dict[str, float]] = {}

    def stage(name, work):
        stages[name], result = once(work)
        return result

    def imports():
        from tests.benchmarks.flights import engine

        engine()
        import glider_jax.mission.forecast
        import glider_jax.products.maps
        import glider_jax.products.netcdf
        import glider_jax.readers.currents  # noqa: F401

    stage("import", imports)
    from glider_jax.products.fan import plot_battery
    from glider_jax.products.job import Options, prepare_run, read_inputs
    from glider_jax.products.maps import plot_map
    from glider_jax.products.netcdf import write_netcdf
    from glider_jax.products.summary import summarise
    from glider_jax_cli.session import cache_folder
    from tests.benchmarks.flights import draw, fly, home

    options = Options(n=n, speed=speed, days=days, cache=cache_folder())
    inputs = stage("read", lambda: read_inputs(options))
    run = stage("tabulate", lambda: prepare_run(options, inputs))
    members, available = stage("draw members", lambda: draw(run, n))
    flown = stage("compile or load, and first flight", lambda: fly(run, members))
    flown = stage("flight", lambda: fly(run, members))
    track = stage("to host", lambda: home(run, members, available, flown))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        stage("netCDF", lambda: write_netcdf(track, out / "forecast.nc"))
        summary = stage("summary", lambda: summarise(track))
        stage("map", lambda: plot_map(track, out / "map.png", bathymetry=inputs.bathymetry,
                                      currents=inputs.currents, summary=summary))  # fmt: skip
        stage("battery chart", lambda: plot_battery(track, out / "battery.png", summary=summary))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return {"n": n, "days": days, "speed": speed, "stages": stages, "peak_mb": peak}


def processes(n: int, speed: str, days: float, repeat: int) -> dict:
    """Stages in processes of their own: the first with an empty cache folder, ``repeat`` more with what it left."""
    import os

    with tempfile.TemporaryDirectory() as folder:

        def one():
            given = ["--one", "--n", str(n), "--speed", speed, "--days", str(days)]
            made = subprocess.run(
                [sys.executable, "-m", "tests.benchmarks.bench_ensemble", *given],
                env=os.environ | {"GLIDER_JAX_CACHE": folder}, capture_output=True, text=True,
            )  # fmt: skip
            if made.returncode:
                raise RuntimeError(made.stderr.strip()[-500:])
            return json.loads(made.stdout.strip().splitlines()[-1])

        first = one()
        warm = [one() for _ in range(repeat)]
    return {"n": n, "days": days, "speed": speed, "first": first, "warm": warm}


def tables(found: dict) -> list[dict]:
    """The stages of one kind of run as a table."""
    rows = []
    first, warm = found["first"]["stages"], [run["stages"] for run in found["warm"]]
    for name, spent in first.items():
        walls, cpus = ([run[name][key] for run in warm] for key in ("wall_s", "cpu_s"))
        rows.append([name, seconds(spent["wall_s"]), seconds(spent["cpu_s"]), *least_and_median(walls),
                     *least_and_median(cpus)])  # fmt: skip
    sums = [[sum(s[key] for s in run.values()) for run in [first, *warm]] for key in ("wall_s", "cpu_s")]
    rows.append(["sum", seconds(sums[0][0]), seconds(sums[1][0]), *least_and_median(sums[0][1:]),
                 *least_and_median(sums[1][1:])])  # fmt: skip
    peak = max(run["peak_mb"] for run in [found["first"], *found["warm"]])
    return [
        table(
            f"Stages: {found['n']:,} members, {found['days']:g} days, {found['speed']}",
            ["stage", "first run: wall s", "CPU s", "warm: wall s, least", "wall s, median", "CPU s, least",
             "CPU s, median"],
            rows,
            f"Peak memory {peak:.0f} MB. The flight stands twice: with compiling or loading its program, and alone.",
        )
    ]  # fmt: skip


def main() -> None:
    """Command line of the benchmark; ``--one`` prints one run of this process as JSON, for ``processes``."""
    if "--one" in sys.argv:
        parser = argparse.ArgumentParser()
        parser.add_argument("--one", action="store_true")
        parser.add_argument("--n", type=int)
        parser.add_argument("--speed")
        parser.add_argument("--days", type=float)
        given = parser.parse_args()
        print(json.dumps(measure(given.n, given.speed, given.days)))
        return
    given = command_line(__doc__)
    if given.quick:
        found = {"distribution": processes(200, "distribution", 2.0, 1)}
    else:
        found = {speed: processes(5000, speed, 15.0, 5) for speed in ("distribution", "flight")}
    part("stages", found, [one for run in found.values() for one in tables(run)], given.out)


if __name__ == "__main__":
    main()
