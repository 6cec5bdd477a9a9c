"""Missions in one recording: parted at long holes, compared by what surely changed."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.diagnosis.regimes import compare, join, split
from glider_jax.records import Recording
from tests.diagnosis.worlds import fly


def later(recording: Recording, days: float) -> Recording:
    """The same recording, later."""
    return Recording(
        recording.name, recording.time + 86400.0 * days, recording.channels, recording.source,
        recording.segment_start + 86400.0 * days,
    )  # fmt: skip


def both(first: Recording, second: Recording) -> Recording:
    """Two recordings, one after the other."""
    channels = {k: np.concatenate([v, second.channels[k]]) for k, v in first.channels.items()}
    return Recording(
        "both", np.concatenate([first.time, second.time]), channels, first.source,
        np.concatenate([first.segment_start, second.segment_start]),
    )  # fmt: skip


def test_a_recording_is_parted_at_long_holes_only():
    """Ten hours apart is one mission, twelve days are two, and nothing is lost."""
    one = fly(0.3)
    assert len(split(one)) == 1
    assert len(split(both(one, later(one, 0.3 + 10.0 / 24.0)))) == 1
    parts = split(both(one, later(one, 12.0)))
    assert [p.time.size for p in parts] == [one.time.size, one.time.size]
    assert parts[1].time[0] - parts[0].time[0] == pytest.approx(12.0 * 86400.0)


def test_a_part_that_never_dived_is_left_out():
    """A bench file before the mission is no mission."""
    one = fly(0.3)
    bench = later(fly(0.05), -5.0)
    bench.channels["depth"][:] = 0.1
    parts = split(both(bench, one))
    assert len(parts) == 1 and parts[0].time[0] == one.time[0]


def test_what_surely_changed_is_said_with_its_direction():
    """Ten standard deviations count, one does not; the sentence has both numbers."""
    first = {"hotel power, dives": (4.48, 0.05, "W", "hotel power, dives"), "flight.mass": (73.30, 0.01, "kg", "mass")}
    second = {"hotel power, dives": (1.72, 0.05, "W", "hotel power, dives"), "flight.mass": (73.31, 0.01, "kg", "mass")}
    changes = compare(first, second)
    assert [one["name"] for one in changes] == ["hotel power, dives"] and changes[0]["z"] < -30.0
    contents = [
        {"recording": {"start": 0.0, "days": 0.2, "legs": 20}, "verdict": "explained", "summary": "A.", "effects": [],
         "warnings": []},
        {"recording": {"start": 1e6, "days": 0.3, "legs": 40}, "verdict": "explained", "summary": "B.", "effects": [],
         "warnings": ["w"]},
    ]  # fmt: skip
    whole = join(contents, [first, second])
    assert "from 4.48 to 1.72 W" in whole["warnings"][0] and whole["warnings"][1] == "w"
    assert [r["number"] for r in whole["regimes"]] == [1, 2] and "Mission 1: A." in whole["summary"]
