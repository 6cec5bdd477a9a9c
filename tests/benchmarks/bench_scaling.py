"""Whole commands, and cost against members and days: python -m tests.benchmarks.bench_scaling [--quick] [--out FILE].

Commands run in processes of their own, first with an empty cache folder, then with a filled one; wall and CPU seconds
and the largest memory are those of the process. The scaling table flies and summarises without writing files.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path

_COMMANDS = {
    "ensemble --n 5000 --format nc,json": ["ensemble", "--n", "5000", "--format", "nc,json"],
    "ensemble --n 5000 (all products)": ["ensemble", "--n", "5000"],
    "ensemble --n 5000 --speed flight --format nc,json": [
        "ensemble", "--n", "5000", "--speed", "flight", "--format", "nc,json",
    ],
    "--help": ["--help"],
}  # fmt: skip


def timed(arguments: list[str], cache: Path, out: Path) -> dict[str, float]:
    """Wall and CPU seconds and peak memory (MB) of one command."""
    where = ["--out", str(out)] if arguments[0] == "ensemble" else []
    command = [sys.executable, "-m", "glider_jax_cli.main", *arguments, *where]
    begin = time.perf_counter()
    with subprocess.Popen(
        command,
        env=os.environ | {"GLIDER_JAX_CACHE": str(cache)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{' '.join(arguments)} ended with {process.returncode}")
    wall = time.perf_counter() - begin
    return {"wall_s": wall, "cpu_s": usage.ru_utime + usage.ru_stime, "peak_mb": usage.ru_maxrss / 1024.0}


def commands(repeat: int) -> dict[str, dict]:
    """Every command, first with an empty cache and then warm (the least of the repeats)."""
    found = {}
    for name, arguments in _COMMANDS.items():
        with tempfile.TemporaryDirectory() as folder:
            cache, out = Path(folder) / "cache", Path(folder) / "out"
            first = timed(arguments, cache, out)
            warm = [timed(arguments, cache, out) for _ in range(repeat)]
        found[name] = {"first": first, "warm": min(warm, key=lambda run: run["wall_s"])}
    return found


def scaling(members: list[int], days: list[float]) -> list[dict[str, float]]:
    """Wall and CPU seconds of flying and summarising, warm."""
    from glider_jax_cli.session import compiled_cache

    compiled_cache()
    from glider_jax.products.job import Options, read_inputs
    from glider_jax.products.job import prepare_run as prepare
    from glider_jax.products.running import fly_products

    rows = []
    for length in days:
        base = Options(days=length, outputs=frozenset())
        inputs = read_inputs(base)
        for n in members if length == 15.0 else members[:1]:
            options = Options(n=n, days=length, outputs=frozenset())
            run = prepare(options, inputs)
            if n <= 5000:
                fly_products(run, options, None, (), None, resume=False)
            wall, cpu = time.perf_counter(), time.process_time()
            fly_products(run, options, None, (), None, resume=False)
            rows.append(
                {"n": n, "days": length, "wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}
            )
    return rows


def table(result: dict) -> str:
    """Both tables as Markdown."""
    lines = ["| command | first run: wall s, CPU s | warm: wall s, CPU s | peak MB |", "| --- | ---: | ---: | ---: |"]
    for name, runs in result["commands"].items():
        first, warm = runs["first"], runs["warm"]
        lines.append(
            f"| `{name}` | {first['wall_s']:.1f}, {first['cpu_s']:.1f} | {warm['wall_s']:.1f}, {warm['cpu_s']:.1f} "
            f"| {max(first['peak_mb'], warm['peak_mb']):.0f} |"
        )
    lines += ["", "| members | days | wall s | CPU s | CPU µs per member and day |"]
    lines.append("| ---: | ---: | ---: | ---: | ---: |")
    for row in result["scaling"]:
        each = 1e6 * row["cpu_s"] / (row["n"] * row["days"])
        lines.append(f"| {row['n']:,} | {row['days']:g} | {row['wall_s']:.2f} | {row['cpu_s']:.2f} | {each:.1f} |")
    lines += ["", f"{result['machine']}, {result['cpus']} cores, jax {result['jax']}"]
    return "\n".join(lines)


def main() -> None:
    """Command line of the benchmark."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="few members, one repeat")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--members", type=int, nargs="+", default=[100, 1000, 5000, 20_000, 100_000])
    parser.add_argument("--days", type=float, nargs="+", default=[1.0, 5.0, 15.0])
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    result = {
        "commands": commands(1 if given.quick else given.repeat),
        "scaling": scaling([100] if given.quick else given.members, [1.0] if given.quick else given.days),
        "machine": platform.processor() or platform.machine(),
        "cpus": len(os.sched_getaffinity(0)),
    }
    import jax

    result["jax"] = jax.__version__
    print(table(result))
    if given.out:
        given.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
