"""Time of a whole diagnosis: python -m tests.benchmarks.bench_diagnosis [--quick] [--out FILE].

``diagnose`` on one recording of three and a half days, a process with an empty cache folder and then one with a
filled one. With --quick, or where the recording is not at hand, it is left out and says so.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from tests.benchmarks.bench_scaling import CASE
from tests.benchmarks.measuring import command, command_line, forecaster, part, seconds, table


def measure(repeat: int) -> dict:
    """Cold and warm times of the command."""
    if not CASE.exists():
        return {"skipped": "no recording is at hand; GLIDER_JAX_SHARED names the folder that holds it"}
    with tempfile.TemporaryDirectory() as folder:
        given = forecaster("diagnose", str(CASE), "--quiet", "--out", str(Path(folder) / "out"))
        around = {"GLIDER_JAX_CACHE": str(Path(folder) / "cache")}
        return {"cold": command(given, around), "warm": [command(given, around) for _ in range(repeat)]}


def tables(found: dict) -> list[dict]:
    """One row a run."""
    if "skipped" in found:
        rows = [[f"not run: {found['skipped']}", "", "", "", ""]]
    else:
        runs = [("cold", found["cold"], "180"), *(("warm", run, "60") for run in found["warm"])]
        rows = [
            [name, seconds(run["wall_s"]), seconds(run["cpu_s"]), f"{run['peak_mb']:.0f}", wanted]
            for name, run, wanted in runs
        ]
    return [
        table("Diagnosis of a recording of 3.5 days", ["run", "wall s", "CPU s", "peak MB", "wanted, wall s"], rows)
    ]


def main() -> None:
    """Command line of the benchmark."""
    given = command_line(__doc__)
    found = {"skipped": "a quick run"} if given.quick else measure(2)
    part("diagnosis", found, tables(found), given.out)


if __name__ == "__main__":
    main()
