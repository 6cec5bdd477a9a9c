"""When the rules of a mission program came into force: counted over blocks of members, and in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from glider_jax.products.quantiles import Quantiles
from glider_jax.records import Track


class RuleTimes:
    """First times and counts of every rule over members that arrive in blocks.

    Parameters
    ----------
    rules : the rules in words; none for a mission without a program.
    limit : number of members up to which values are kept.
    """

    def __init__(self, rules: tuple[str, ...], limit: int) -> None:
        self.rules = rules
        self._first = Quantiles(len(rules), limit)
        self._count = np.zeros(len(rules))

    def add(self, block: Track) -> None:
        """Take in the members of a block."""
        if self.rules and block.n:
            self._first.add(np.asarray(block.program_time, float) - block.time[0])
            self._count += np.asarray(block.program_count).sum(axis=0)

    def entries(self, dates: Callable[[Quantiles, int], dict[str, Any]]) -> list[dict[str, Any]]:
        """One mapping per rule; ``dates`` gives hours and times of a column's percentiles."""
        members = max(self._first.members, 1)
        return [
            {
                "number": k + 1,
                "rule": words,
                "probability": round(int(self._first.finite[k]) / members, 6),
                **dates(self._first, k),
                "count": round(float(self._count[k]) / members, 4),
            }
            for k, words in enumerate(self.rules)
        ]


def program_lines(summary: Mapping[str, Any]) -> list[str]:
    """One line per rule of the mission's program: in how many members it fired, and on which day (5 to 95 %)."""
    lines = []
    for entry in summary.get("program", ()):
        line = f"{entry['rule']} fired in {100 * entry['probability']:.0f} % of members"
        hours = entry["hours"]
        if hours["median"] is not None:
            days = {key: hours[key] / 24.0 for key in ("median", "p05", "p95")}
            line += f", median day {days['median']:.1f} ({days['p05']:.1f}-{days['p95']:.1f})"
        lines.append(line)
    return lines
