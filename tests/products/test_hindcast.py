"""Hindcasts: baselines on real recordings, no peeking, tables; forecasts frozen to disk and scored later."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from glider_jax.errors import DataError
from glider_jax.products import frozen
from glider_jax.products.hindcast import cases_of, hindcast, issue, rows, summarise
from glider_jax.products.reliability import plot_reliability
from glider_jax.readers.recordings import read_recording
from glider_jax.readers.segments import dive_segments
from glider_jax.readers.vehicles import read_vehicle
from tests.readers.glider_layouts import simulate, write_native

N = 200


@pytest.fixture(scope="module")
def vehicle():
    return read_vehicle(None)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return read_recording(write_native(tmp_path_factory.mktemp("hind") / "unit.nc", simulate(dives=5, yos=6)))


@pytest.fixture(scope="module")
def cases(recording, vehicle):
    return hindcast(recording, vehicle, members=N, seed=1)


@pytest.mark.parametrize(
    ("name", "count", "persistence", "reckoning"),
    [("osu684_2025", 7, (0.83, 2.42), (0.46, 0.68)), ("ru28_2017", 12, (0.23, 1.43), None)],
)
def test_baselines_measured_elsewhere_are_met(real, name, count, persistence, reckoning):
    """Errors of the baselines, km, median and 90 %, as measured by others with other code."""
    from glider_jax.products.hindcast import _dead_reckoned

    pairs = cases_of(read_recording(real("recordings", name, f"{name}.nc")))
    assert len(pairs) == count
    missed = [math.hypot(b.east - a.east, b.north - a.north) / 1e3 for a, b in pairs]
    assert tuple(np.quantile(missed, [0.5, 0.9])) == pytest.approx(persistence, abs=0.01)
    if reckoning is not None:
        missed = [_dead_reckoned(a, b) / 1e3 for a, b in pairs]
        assert tuple(np.quantile(missed, [0.5, 0.9])) == pytest.approx(reckoning, abs=0.03)


def test_real_forecasts_beat_persistence(real, vehicle):
    found = hindcast(
        read_recording(real("recordings", "ru28_2017", "ru28_2017.nc")), vehicle, members=N, seed=4
    )
    table = summarise(found)
    ours, theirs = (table["position_km"][k] for k in ("forecast", "persistence"))
    assert ours["median"] < theirs["median"] and ours["p90"] < 0.5 * theirs["p90"]
    assert table["position_km"]["skill"]["skill"] > 0.3
    assert table["coverage"]["region90"]["hits"] >= 9


def test_a_steady_glider_is_forecast(cases, recording):
    assert [c.number for c in cases] == [1, 2, 3, 4]
    for case in cases:
        assert case.error < 0.2 * case.moved + 30.0
        assert case.inside90 and abs(case.time_error) < 300.0
        assert case.charge == pytest.approx(case.charge_forecast, rel=0.1)
        assert case.issued < case.surfaced and case.members_up > 0.9
        assert case.cause in case.causes
    # Dead reckoning assumes an angle of attack that this simulated glider does not have.
    assert all(c.dead_reckoning < 0.2 * c.moved for c in cases)
    assert cases[-1].persistence < 10.0


def test_nothing_later_is_looked_at(recording, vehicle):
    """Everything after the forecast is replaced by nonsense, or cut off: not one number moves."""
    truth = dive_segments(recording)[-1]
    later = recording.time > truth.start_time
    wrong = {k: np.where(later, 5.0 - v[::-1], v) for k, v in recording.channels.items()}
    cut = replace(
        recording, time=recording.time[~later], channels={k: v[~later] for k, v in recording.channels.items()}
    )
    others = (replace(recording, channels=wrong), cut)
    one, *rest = (issue(r, truth.start_time, vehicle, members=N, seed=9) for r in (recording, *others))
    for other in rest:
        for name in ("fix_time", "fix_latitude", "fix_longitude"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_tables_say_how_good_it_was(cases):
    table = summarise(cases)
    assert table["cases"] == 4 and table["coverage"]["region90"]["cases"] == 4
    assert table["position_km"]["forecast"]["median"] == pytest.approx(
        np.median([c.error for c in cases]) / 1e3
    )
    assert len(table["worst"]) == 4 and table["worst"][0]["error_km"] >= table["worst"][-1]["error_km"]
    text = json.dumps(rows(cases), allow_nan=False)
    assert json.loads(text)[0]["issued"].endswith("Z")
    with pytest.raises(DataError, match="at least two dives"):
        summarise([])


def test_reliability_is_drawn(cases, tmp_path):
    path = plot_reliability(cases, tmp_path / "reliability.png")
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.fixture(scope="module")
def flown(recording, vehicle):
    truth = dive_segments(recording)[-1]
    return issue(recording, truth.start_time, vehicle, members=N, seed=2), truth


def test_frozen_forecasts_are_scored_when_the_glider_comes_up(flown, recording, tmp_path):
    one, truth = flown
    path = frozen.freeze(one, tmp_path, seed=2, settings={"hours": 6})
    content = json.loads(path.read_text())
    assert content["seed"] == 2 and content["inputs"] and content["version"]
    assert all("/" not in name for name in content["inputs"])
    (tmp_path / "frozen" / "torn.json").write_text('{"schema": "glider_jax.froz')
    loaded, told = frozen.load(tmp_path)
    assert len(loaded) == 1 and "torn.json" in told[0]
    segments = dive_segments(recording)
    waiting = frozen.score_all(loaded, segments[:-1])
    assert waiting[0]["waiting"] and frozen.table(waiting)["scored"] == 0
    (scored,) = frozen.score_all(loaded, segments)
    direct = math.hypot(
        *(
            np.array(
                [
                    np.nanmedian(one.fix_latitude) - truth.end_latitude,
                    np.nanmedian(one.fix_longitude) - truth.end_longitude,
                ]
            )
            * math.radians(6371.0)
            * np.array([1.0, math.cos(math.radians(40.0))])
        )
    )
    assert scored["error_km"] == pytest.approx(direct, rel=0.02, abs=2e-3)
    assert scored["inside90"] and scored["time_inside90"]
    assert scored["persistence_km"] == pytest.approx(
        math.hypot(truth.east - segments[-2].east, truth.north - segments[-2].north) / 1e3, abs=5e-3
    )
    table = frozen.table([scored])
    assert table["scored"] == 1 and table["region90"]["hits"] == 1


def test_a_name_never_chooses_a_path(flown, tmp_path):
    one, _ = flown
    wild = replace(one.scenario.situation, name="../../<script>/etc\x00passwd")
    path = frozen.freeze(
        replace(one, scenario=replace(one.scenario, situation=wild)), tmp_path / "out", seed=0, settings={}
    )
    assert path.parent == tmp_path / "out" / "frozen"
    assert path.name.startswith("script-etc-passwd-")
    assert frozen.safe_name("\u202e///") == "glider"


def test_a_surfacing_after_a_gap_is_not_the_forecast_one(flown, recording):
    one, truth = flown
    content = {"fix": {"time": truth.start_time - 9 * 3600.0}, "glider": "x"}
    assert frozen.truth_of(content, [truth]) is None
    with pytest.raises(DataError, match="expected a folder with frozen"):
        frozen.load(Path("nowhere-at-all"))
