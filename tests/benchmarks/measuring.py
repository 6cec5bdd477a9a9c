"""What every benchmark shares: seconds of a call or a command, the machine, and tables as JSON and Markdown.

CPU seconds are those of all threads of a process; on a machine that others use too they say more than the wall's.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

Times = dict[str, list[float]]
#: What a number depends on, beside the machine.
PACKAGES = ("glider-jax", "jax", "jaxlib", "numpy", "equinox", "xarray", "numba")


def once(work: Callable[[], Any]) -> tuple[dict[str, float], Any]:
    """Wall and CPU seconds of one call, and what it returned."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return {"wall_s": time.perf_counter() - wall, "cpu_s": time.process_time() - cpu}, result


def repeated(work: Callable[[], Any], count: int) -> Times:
    """Wall and CPU seconds of every one of several calls."""
    runs = [once(work)[0] for _ in range(count)]
    return {name: [run[name] for run in runs] for name in ("wall_s", "cpu_s")}


def alternated(works: dict[str, Callable[[], Any]], count: int) -> dict[str, Times]:
    """Seconds of several calls that take turns, so that all meet the same load of the machine."""
    found: dict[str, Times] = {name: {"wall_s": [], "cpu_s": []} for name in works}
    for _ in range(count):
        for name, work in works.items():
            run, _ = once(work)
            for key, value in run.items():
                found[name][key].append(value)
    return found


def command(arguments: Sequence[str], environment: dict[str, str] | None = None) -> dict[str, float]:
    """Wall and CPU seconds and peak memory (MB) of one process and its children.

    Raises
    ------
    RuntimeError : it ended with another code than 0; the message holds the end of what it said.
    """
    import tempfile

    begin = time.perf_counter()
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            list(arguments), env=os.environ | (environment or {}), stdout=subprocess.DEVNULL, stderr=said
        )
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - begin
        if process.returncode:
            said.seek(0)
            words = said.read().decode(errors="replace").strip()[-500:]
            raise RuntimeError(f"{' '.join(arguments)} ended with {process.returncode}: {words}")
    return {"wall_s": wall, "cpu_s": usage.ru_utime + usage.ru_stime, "peak_mb": usage.ru_maxrss / 1024.0}


def least(values: Sequence[float]) -> float:
    """The smallest of some seconds."""
    return float(min(values))


def middle(values: Sequence[float]) -> float:
    """The median of some seconds."""
    return float(np.median(values))


def seconds(value: float) -> str:
    """Seconds with three digits that count."""
    return f"{value:.3g}" if value < 100.0 else f"{value:.0f}"


def least_and_median(values: Sequence[float]) -> tuple[str, str]:
    """Two cells of a table."""
    return seconds(least(values)), seconds(middle(values))


def machine() -> dict[str, Any]:
    """The processor, its cores that may be used, memory, system, load, and versions."""
    model = platform.processor() or platform.machine()
    cpu = Path("/proc/cpuinfo")
    if cpu.exists():
        named = [line.split(":", 1)[1] for line in cpu.read_text().splitlines() if line.startswith("model name")]
        model = named[0].strip() if named else model
    versions = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return {
        "processor": model,
        "cores": len(os.sched_getaffinity(0)),
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "system": f"{platform.system()} {platform.release()}",
        "load": [round(x, 2) for x in os.getloadavg()],
        "versions": versions,
    }


def machine_words(found: dict[str, Any]) -> str:
    """The machine in two sentences; how busy it was belongs to every number."""
    versions = ", ".join(f"{name} {version}" for name, version in found["versions"].items())
    return (
        f"{found['processor']}, {found['cores']} cores, {found['memory_gb']:g} GB, {found['system']}; {versions}. "
        f"Load when the run began: {found['load'][0]:g}."
    )


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], note: str = "") -> dict[str, Any]:
    """One table: cells are text."""
    return {"title": title, "columns": list(columns), "rows": [[str(c) for c in row] for row in rows], "note": note}


def markdown(tables: Sequence[dict[str, Any]], level: int = 2) -> str:
    """Tables as Markdown; columns of numbers are aligned right."""
    pieces = []
    for one in tables:
        numeric = [
            any(row[k][:1].isdigit() for row in one["rows"])
            and all(not row[k] or row[k][0].isdigit() for row in one["rows"])
            for k in range(len(one["columns"]))
        ]
        lines = [f"{'#' * level} {one['title']}", "", "| " + " | ".join(one["columns"]) + " |"]
        lines.append("| " + " | ".join("---:" if right else "---" for right in numeric) + " |")
        lines += ["| " + " | ".join(cell.replace("|", "/") for cell in row) + " |" for row in one["rows"]]
        pieces.append("\n".join(lines) + (f"\n\n{one['note']}" if one["note"] else ""))
    return "\n\n".join(pieces) + "\n"


def part(name: str, data: dict[str, Any], tables: Sequence[dict[str, Any]], out: Path | None) -> None:
    """Print a benchmark's tables and write its numbers."""
    print(markdown(tables))
    if out is not None:
        content = {"name": name, "machine": machine(), "data": data, "tables": list(tables)}
        out.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n")


def command_line(about: str | None, *, peers: bool = False, sizes: bool = False) -> argparse.Namespace:
    """The arguments that every benchmark takes; with ``sizes`` also those that choose members, days and repeats."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small sizes, few repeats: that it runs, not how fast")
    parser.add_argument("--out", type=Path, help="file for the numbers (JSON)")
    if peers:
        parser.add_argument("--peers", type=Path, help="folder with one virtual environment per peer")
    if sizes:
        parser.add_argument("--repeat", type=int, help="of every command and row")
        parser.add_argument("--members", type=int, nargs="+", help="of the rows; the largest command is then left out")
        parser.add_argument("--days", type=float, nargs="+", help="of the rows; the largest command is then left out")
    return parser.parse_args()


def forecaster(*arguments: str) -> list[str]:
    """A command of the forecaster under this Python."""
    return [sys.executable, "-m", "glider_jax_cli.main", *arguments]
