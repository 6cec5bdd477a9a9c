"""Accuracy at the speed that is measured: python -m tests.benchmarks.bench_accuracy [--quick] [--out FILE].

The forecaster's step against the independent integrator of tests/mission/reference.py, which cuts steps of seconds
at every event, on the bundled mission with its currents without error: positions at surfacings, and energy drawn.
"""

from __future__ import annotations

from tests.benchmarks.flights import engine
from tests.benchmarks.measuring import command_line, once, part, seconds, table


def measure(n: int, days: float, step: float) -> dict:
    """Differences of positions (m), times (s) and energies (relative)."""
    import numpy as np

    engine()
    from tests.mission.test_reference import _compare, _energy_errors, _errors

    spent, (track, reference, drawn) = once(lambda: _compare(n, days, step, True))
    distance, late, known = _errors(track, reference)
    worst = np.where(known, distance, 0.0).max(axis=1)
    # Early on, one stroke more or less by an output time is a per mille by itself.
    energy = np.abs(_energy_errors(track, drawn, first_day=min(3.0, 0.5 * days)))
    return {
        "n": n, "days": days, "step_s": step, "reference": spent, "surfacings": int(known.sum()),
        "position_m": {q: float(np.percentile(distance[known], p)) for q, p in (("median", 50), ("p99", 99))},
        "members_within_50_m": float(np.mean(worst < 50.0)),
        "time_p99_s": float(np.percentile(np.abs(late[known]), 99)),
        "energy": {q: float(np.percentile(energy, p)) for q, p in (("median", 50), ("p99", 99))},
    }  # fmt: skip


def tables(found: dict) -> list[dict]:
    """The differences beside what is promised."""
    position, energy = found["position_m"], found["energy"]
    rows = [
        ["position, median", f"{position['median']:.1f} m", ""],
        ["position, p99", f"{position['p99']:.1f} m", "under 50 m"],
        ["members always within 50 m", f"{100 * found['members_within_50_m']:.1f} %", "99 %"],
        ["time of surfacing, p99", f"{found['time_p99_s']:.0f} s", ""],
        ["energy, median", f"{100 * energy['median']:.4f} %", ""],
        ["energy, p99", f"{100 * energy['p99']:.4f} %", "under 0.1 %"],
    ]
    return [
        table(
            f"Accuracy: {found['n']} members, {found['days']:g} days, against steps of {found['step_s']:g} s",
            ["what", "found", "wanted"],
            rows,
            f"{found['surfacings']:,} surfacings; the reference took {seconds(found['reference']['cpu_s'])} CPU s. "
            "The bundled mission with corrected currents; errors of the currents are left out of both.",
        )
    ]


def main() -> None:
    """Command line of the benchmark."""
    given = command_line(__doc__)
    found = measure(24, 1.0, 20.0) if given.quick else measure(100, 15.0, 5.0)
    part("accuracy", found, tables(found), given.out)


if __name__ == "__main__":
    main()
