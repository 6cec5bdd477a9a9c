"""Battery outlook: closed-form dates, resets, capacities that do not fit, what is not known."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.products.outlook import DAY, counter_rates, epochs, outlook
from glider_jax.readers.vehicles import read_vehicle

AH = 3600.0
NOW = 1.7e9


@pytest.fixture(scope="module")
def battery():
    return read_vehicle(None).battery


def counter(rate_ah=2.0, days=4.0, first=50.0, n=200):
    time = NOW - days * DAY + np.linspace(0.0, days * DAY, n)
    return time, AH * (first + rate_ah * (time - time[0]) / DAY)


def test_dates_follow_from_rate_and_capacity(battery):
    """58 Ah used of 200 at 2 Ah/day: 20 % is reached after (160 - 58) / 2 = 51 days."""
    found = outlook(
        now=NOW, battery=battery, simulated=np.full(50, 1.0 * AH / DAY), components={"pump": 0.6 * AH / DAY},
        counter=counter(), charge_used=58.0 * AH, capacity=200.0 * AH, reserve=0.2, way_home=3 * DAY,
    )  # fmt: skip
    assert found["ah_per_day"]["counter"]["72 h"] == pytest.approx(2.0, rel=1e-6)
    assert found["ah_per_day"]["by_component"]["pump"] == pytest.approx(1.2, rel=1e-3)
    assert found["charge_left_percent"] == pytest.approx(71.0)
    level = found["levels"][0]
    assert level["is_reserve"] and level["days"]["median"] == pytest.approx(51.0, rel=0.03)
    assert level["days"]["p05"] < 46.0 < 56.0 < level["days"]["p95"]
    assert found["last_safe_recovery"]["days"] == pytest.approx(level["days"]["p05"] - 3.0, abs=0.01)
    assert found["status"] == "green"
    assert [row["charge_left_percent"] for row in found["levels"]] == [20.0, 15.0, 10.0]


def test_a_reset_begins_a_new_epoch(battery):
    time, charge = counter(days=6.0)
    charge = np.where(time > NOW - 2 * DAY, charge - charge[time > NOW - 2 * DAY][0] + 1.0 * AH, charge * 2.0)
    assert len(epochs(time, charge)) == 2
    assert counter_rates(time, charge)["all"] * DAY / AH == pytest.approx(2.0, rel=1e-6)
    found = outlook(
        now=NOW, battery=battery, simulated=np.empty(0), components={}, counter=(time, charge),
        charge_used=charge[-1], capacity=100.0 * AH,
    )  # fmt: skip
    assert any("set back 1 times" in text for text in found["notes"])


def test_capacity_that_does_not_fit_is_said(battery):
    common = dict(now=NOW, battery=battery, simulated=np.full(9, 2.0 * AH / DAY), components={})
    changed = outlook(**common, charge_used=100.0 * AH, capacity=200.0 * AH, relative_charge=0.9)
    assert changed["charge_left_percent"] == pytest.approx(50.0)
    assert any("capacity or pack was changed" in text for text in changed["notes"])
    derived = outlook(**common, charge_used=170.659932 * AH, relative_charge=0.43113356)
    assert derived["capacity_ah"] == pytest.approx(300.0, rel=1e-6)
    over = outlook(**common, charge_used=250.0 * AH, capacity=200.0 * AH)
    assert over["charge_left_percent"] == 0.0 and over["status"] == "red"
    assert any("more charge was drawn" in text for text in over["notes"])


def test_what_is_not_known_gives_no_dates(battery):
    found = outlook(now=NOW, battery=battery, simulated=np.full(9, 2.0 * AH / DAY), components={})
    assert found["levels"] == [] and found["status"] == "unknown"
    assert any("--charge-used-ah" in text for text in found["notes"])
    assert found["ah_per_day"]["from"] == "simulation"
    short = counter(days=0.1)
    assert np.isnan(counter_rates(*short)["24 h"])
