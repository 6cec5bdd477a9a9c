"""Time and memory of the main job: python -m tests.benchmarks.bench_ensemble [--n 5000] [--repeat 5] [--out FILE].

Each stage is timed apart: imports, reading, tabulating, compiling, flying (warm), netCDF, summary, pictures. CPU
seconds are those of the whole process; on a shared machine they say more than the wall's.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import tempfile
import time
from pathlib import Path


class Clock:
    """Wall and CPU seconds of named stages."""

    def __init__(self):
        self.stages: dict[str, dict[str, float]] = {}

    def __call__(self, name, work):
        wall, cpu = time.perf_counter(), time.process_time()
        result = work()
        entry = {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}
        best = self.stages.get(name)
        if best is None or entry["wall_s"] < best["wall_s"]:
            self.stages[name] = entry
        return result


def measure(n: int, repeat: int, speed: str, days: float) -> dict:
    """Run the default mission and return the stages' times (the least of the repeats), memory and versions."""
    clock = Clock()

    def imports():
        from glider_jax_cli.session import compiled_cache

        compiled_cache()
        import glider_jax.mission.forecast
        import glider_jax.products.maps  # noqa: F401

    clock("import", imports)
    import jax
    import numpy as np

    from glider_jax.mission.ensemble import run_members
    from glider_jax.mission.forecast import bring_home, draw_run
    from glider_jax.products.fan import plot_battery
    from glider_jax.products.job import Options, prepare_run, read_inputs
    from glider_jax.products.maps import plot_map
    from glider_jax.products.netcdf import write_netcdf
    from glider_jax.products.summary import summarise

    options = Options(n=n, speed=speed, days=days)
    inputs = clock("read", lambda: read_inputs(options))
    run = clock("tabulate", lambda: prepare_run(options, inputs))

    def flown():
        members, available = draw_run(run, 0, n)
        state, out = run_members(members, run.plan, run.shape, run.environment, run.column, 0.0, 0.0)
        jax.block_until_ready(out)
        return members, available, state, out

    clock("compile and first flight", flown)
    for _ in range(repeat):
        members, available, state, out = clock("draw and fly", flown)
    track = clock("to host", lambda: bring_home(run, members, available, state, out))
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(min(repeat, 3)):
            clock("netCDF", lambda: write_netcdf(track, Path(folder) / "forecast.nc"))
            summary = clock("summary", lambda: summarise(track))
        clock("map", lambda: plot_map(track, Path(folder) / "map.png", bathymetry=inputs.bathymetry,
                                      currents=inputs.currents, summary=summary))  # fmt: skip
        clock("battery chart", lambda: plot_battery(track, Path(folder) / "battery.png", summary=summary))
    return {
        "members": n,
        "days": days,
        "speed": speed,
        "steps_per_member": float(np.mean(np.asarray(state.steps))),
        "stages": clock.stages,
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "devices": [str(d) for d in jax.devices()],
        "versions": {"python": platform.python_version(), "jax": jax.__version__, "numpy": np.__version__},
        "cpus": len(os.sched_getaffinity(0)),
        "machine": platform.processor() or platform.machine(),
    }


def table(result: dict) -> str:
    """The stages as a Markdown table."""
    rows = ["| stage | wall s | CPU s |", "| --- | ---: | ---: |"]
    rows += [f"| {name} | {t['wall_s']:.3f} | {t['cpu_s']:.3f} |" for name, t in result["stages"].items()]
    return "\n".join(rows) + f"\n\npeak memory {result['peak_rss_mb']:.0f} MB, {result['members']} members"


def main() -> None:
    """Command line of the benchmark."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--n", type=int, default=5000)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--days", type=float, default=15.0)
    parser.add_argument("--speed", default="distribution")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    result = measure(given.n, given.repeat, given.speed, given.days)
    print(table(result))
    if given.out:
        given.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
