"""Whole commands, and cost against members and days: python -m tests.benchmarks.bench_scaling [--quick] [--out FILE].

Commands and rows run in processes of their own, so that wall and CPU seconds and the largest memory are theirs. A
command runs first with an empty cache folder, then with a filled one. A row of the scaling table flies and summarises
without writing files; the largest ensemble is the whole command with streamed products, once.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from tests.benchmarks.measuring import (
    command,
    command_line,
    forecaster,
    least,
    least_and_median,
    part,
    repeated,
    seconds,
    table,
)

_COMMANDS = {
    "ensemble --n 5000 --format nc,json": ["ensemble", "--n", "5000", "--format", "nc,json"],
    "ensemble --n 5000 --format nc,json,map,battery": ["ensemble", "--n", "5000", "--format", "nc,json,map,battery"],
    "ensemble --n 5000 (all products)": ["ensemble", "--n", "5000"],
    "ensemble --n 5000 --speed flight --format nc,json": [
        "ensemble", "--n", "5000", "--speed", "flight", "--format", "nc,json",
    ],
    "next --recording recording.nc --now data": ["next", "--now", "data", "--recording"],
    "--help": ["--help"],
}  # fmt: skip
_QUICK = ("ensemble --n 5000 --format nc,json", "--help")
#: A recording of some days for ``next`` and ``diagnose``; its folder is named by the environment or lies beside.
SHARED = Path(os.environ.get("GLIDER_JAX_SHARED", Path(__file__).resolve().parents[3] / "shared"))
CASE = SHARED / "blind-practice" / "practice1"
MEMBERS = (100, 1000, 5000, 50_000)
DAYS = (1.0, 5.0, 15.0, 30.0, 60.0)
MILLION = 1_000_000


def commands(repeat: int, names: tuple[str, ...] = tuple(_COMMANDS), shrink: bool = False) -> dict[str, dict]:
    """Every command with an empty cache and then warm; ``shrink`` flies fewer members, to see that all of it runs."""
    found = {}
    for name in names:
        arguments = list(_COMMANDS[name])
        if shrink:
            arguments, name = ["200" if a == "5000" else a for a in arguments], name.replace("5000", "200")
        if arguments[0] == "next":
            if not CASE.exists():
                found[name] = {"skipped": "no recording is at hand"}
                continue
            arguments.append(str(CASE / "recording.nc"))
        with tempfile.TemporaryDirectory() as folder:
            where = ["--out", str(Path(folder) / "out")] if arguments[0] in ("ensemble", "next") else []
            given, around = forecaster(*arguments, *where), {"GLIDER_JAX_CACHE": str(Path(folder) / "cache")}
            first = command(given, around)
            warm = [command(given, around) for _ in range(repeat)]
        found[name] = {"first": first, "warm": warm}
    return found


def million(n: int) -> dict:
    """The streamed command on many members, once, with programs already kept."""
    with tempfile.TemporaryDirectory() as folder:
        around = {"GLIDER_JAX_CACHE": str(Path(folder) / "cache")}

        def given(count):
            return forecaster(
                "ensemble", "--n", str(count), "--format", "json,map", "--out", str(Path(folder) / "out")
            )

        command(given(5000), around)
        return command(given(n), around) | {"n": n}


def long_run(n: int, days: float):
    """Inputs and run of any length: beyond the bundled currents they start again, the glider sails to and fro, and
    its pack is large enough."""
    import numpy as np

    from glider_jax.products.job import Options, prepare_run, read_inputs

    inputs = read_inputs(Options(n=n, days=min(days, 15.0)))
    if days > 15.0:
        grid = inputs.currents
        copies = int(np.ceil((days + 1.0) / 15.0))
        step = grid.time[1] - grid.time[0]
        time = grid.time[0] + step * np.arange(copies * grid.time.size)
        tiled = {name: np.tile(getattr(grid, name), (copies, 1, 1, 1)) for name in ("east", "north")}
        battery = inputs.vehicle.battery
        more = {
            name: replace(getattr(battery, name), value=20.0 * getattr(battery, name).value)
            for name in ("capacity", "energy")
        }
        sd = {} if grid.east_sd is None else {
            name: np.tile(getattr(grid, name), (copies, 1, 1, 1)) for name in ("east_sd", "north_sd")
        }  # fmt: skip
        inputs = replace(
            inputs,
            currents=replace(grid, time=time, **tiled, **sd),
            mission=replace(inputs.mission, legs=-1),
            vehicle=replace(inputs.vehicle, battery=replace(battery, **more)),
            days=days,
        )
    options = Options(n=n, days=days, outputs=frozenset())
    return options, prepare_run(options, inputs)


def row(n: int, days: float, repeat: int) -> dict:
    """Flying and summarising in this process, warm."""
    import resource

    from glider_jax.products.running import fly_products
    from tests.benchmarks.flights import engine

    engine()
    options, run = long_run(n, days)
    track, _, _ = fly_products(run, options, None, (), None, resume=False)
    times = repeated(lambda: fly_products(run, options, None, (), None, resume=False), repeat)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    flying = float((track.outcome == 0).mean() + (track.outcome == 1).mean())
    return times | {"n": n, "days": days, "peak_mb": peak, "flying_or_arrived": flying}


def scaling(members, days, repeat: int) -> list[dict]:
    """Rows for every number of members at fifteen days (or the longest), and for every length at 5,000 (or most)."""
    base = 15.0 if 15.0 in days else max(days)
    usual = 5000 if 5000 in members else max(members)
    asked = [(n, base) for n in members] + [(usual, length) for length in days if length != base]
    found = []
    for n, length in asked:
        made = subprocess.run(
            [sys.executable, "-m", "tests.benchmarks.bench_scaling", "--row", str(n), str(length), str(repeat)],
            capture_output=True, text=True,
        )  # fmt: skip
        if made.returncode:
            raise RuntimeError(made.stderr.strip()[-500:])
        found.append(json.loads(made.stdout.strip().splitlines()[-1]))
    return found


def tables(found: dict) -> list[dict]:
    """Commands, and cost against members and days."""
    rows = []
    for name, runs in found["commands"].items():
        if "skipped" in runs:
            rows.append([f"`{name}`: not run, {runs['skipped']}", *[""] * 7])
            continue
        first, warm = runs["first"], runs["warm"]
        peak = max(run["peak_mb"] for run in [first, *warm])
        rows.append([
            f"`{name}`", seconds(first["wall_s"]), seconds(first["cpu_s"]),
            *least_and_median([run["wall_s"] for run in warm]), *least_and_median([run["cpu_s"] for run in warm]),
            f"{peak:.0f}",
        ])  # fmt: skip
    costs = []
    for one in found["scaling"]:
        each = 1e6 * least(one["cpu_s"]) / (one["n"] * one["days"])
        costs.append([
            f"{one['n']:,}", f"{one['days']:g}", *least_and_median(one["wall_s"]), *least_and_median(one["cpu_s"]),
            f"{each:.2f}", f"{one['peak_mb']:.0f}", f"{100 * one['flying_or_arrived']:.0f}",
        ])  # fmt: skip
    if "million" in found:
        one = found["million"]
        each = 1e6 * one["cpu_s"] / (one["n"] * 15.0)
        costs.append([f"{one['n']:,} (command)", "15", seconds(one["wall_s"]), "", seconds(one["cpu_s"]), "",
                      f"{each:.2f}", f"{one['peak_mb']:.0f}", ""])  # fmt: skip
    return [
        table(
            "Whole commands",
            ["command", "first run: wall s", "CPU s", "warm: wall s, least", "wall s, median", "CPU s, least",
             "CPU s, median", "peak MB"],
            rows,
            "Processes with their start and end; the first run has an empty cache folder.",
        ),
        table(
            "Cost against members and days",
            ["members", "days", "wall s, least", "wall s, median", "CPU s, least", "CPU s, median",
             "CPU µs per member and day", "peak MB", "flying or arrived, %"],
            costs,
            "Flying and summarising, warm, without files; each row is a process. Beyond 15 days the bundled currents "
            "start again, the mission sails to and fro, and the pack is enlarged. The largest is the whole command "
            "`ensemble --format json,map`, once.",
        ),
    ]  # fmt: skip


def main() -> None:
    """Command line of the benchmark; ``--row N DAYS REPEAT`` prints one row as JSON, for ``scaling``."""
    if "--row" in sys.argv:
        parser = argparse.ArgumentParser()
        parser.add_argument("--row", nargs=3)
        n, days, repeat = parser.parse_args().row
        print(json.dumps(row(int(n), float(days), int(repeat))))
        return
    given = command_line(__doc__, sizes=True)
    members, days = ((100, 200), (1.0, 16.0)) if given.quick else (MEMBERS, DAYS)
    repeat = given.repeat or (1 if given.quick else 5)
    found = {
        "commands": commands(repeat, _QUICK, shrink=True) if given.quick else commands(repeat),
        "scaling": scaling(given.members or members, given.days or days, min(repeat, 3)),
    }
    if not (given.quick or given.members or given.days):
        found["million"] = million(MILLION)
    part("scaling", found, tables(found), given.out)


if __name__ == "__main__":
    main()
