"""Effects put into recordings: each changes what it should, by as much as it should."""

from __future__ import annotations

import re

import netCDF4
import numpy as np
import pytest

from glider_jax.diagnosis.proof import spikes
from glider_jax.diagnosis.proof.metrics import judge, summary
from glider_jax.diagnosis.proof.protocol import draw_spikes
from glider_jax.errors import ConfigError, DataError

N = 200


@pytest.fixture
def columns():
    time = 1.5e9 + 4.0 * np.arange(N)
    fixes = np.full(N, np.nan)
    fixes[[0, 100, 199]] = 54.5
    return {
        "time": time, "m_pitch": np.where(np.arange(N) % 40 < 20, -0.45, 0.45), "m_heading": np.full(N, 0.1),
        "m_depth": np.full(N, 20.0), "m_battery": np.where(np.arange(N) % 7, np.nan, 14.0),
        "m_coulomb_current": np.full(N, 0.2), "m_coulomb_amphr_total": 5.0 + 0.2 * 4.0 * np.arange(N) / 3600.0,
        "m_gps_lat": fixes, "m_gps_lon": fixes - 47.0, "m_lat": np.full(N, 54.5), "m_lon": np.full(N, 7.5),
    }  # fmt: skip


def test_pitch_and_heading_are_undone_by_the_effect(columns):
    gained = spikes.spiked(columns, {"flight.pitch_gain.gain": -0.12})["m_pitch"]
    assert gained * (1 - 0.12) == pytest.approx(columns["m_pitch"])
    off = spikes.spiked(columns, {"flight.pitch_offset.offset": 0.05})["m_pitch"]
    assert off + 0.05 == pytest.approx(columns["m_pitch"])
    turned = spikes.spiked(columns, {"navigation.magnetic_declination.angle": 0.25})["m_heading"]
    assert np.mod(turned + 0.25, 2 * np.pi) == pytest.approx(columns["m_heading"])


def test_loads_draw_their_charge(columns):
    out = spikes.spiked(columns, {"energy.dive_only_load.power": 1.4})
    extra = out["m_coulomb_current"] - columns["m_coulomb_current"]
    assert extra[columns["m_pitch"] < 0] == pytest.approx(0.1)
    assert extra[columns["m_pitch"] > 0] == pytest.approx(0.0)
    charge = np.ptp(out["m_coulomb_amphr_total"]) - np.ptp(columns["m_coulomb_amphr_total"])
    assert charge == pytest.approx(0.1 * 400 / 3600.0, rel=0.02)
    more = spikes.spiked(columns, {"sensor.current_gain.gain": 0.1})
    assert np.ptp(more["m_coulomb_amphr_total"]) == pytest.approx(
        1.1 * np.ptp(columns["m_coulomb_amphr_total"])
    )
    sag = spikes.spiked(columns, {"energy.internal_resistance.resistance": 0.5})["m_battery"]
    assert np.nanmean(sag) == pytest.approx(13.9)


def test_a_current_carries_fixes_and_what_follows_them(columns):
    effects = {"navigation.mean_current.east": 0.15, "navigation.mean_current.north": 0.0}
    out = spikes.spiked(columns, effects)
    metres = (out["m_gps_lon"] - columns["m_gps_lon"]) * 111.32e3 * np.cos(np.radians(54.5))
    assert metres[100] == pytest.approx(0.15 * 400.0, rel=0.005)
    reckoned = out["m_lon"] - columns["m_lon"]
    assert reckoned[150] == pytest.approx(out["m_gps_lon"][100] - columns["m_gps_lon"][100])
    assert np.all(reckoned[:100] == 0.0)
    assert out["m_lat"] == pytest.approx(columns["m_lat"])


def test_pumps_gauges_counters_and_climbs(columns):
    columns |= {"m_ballast_pumped": np.full(N, 230.0), "m_pressure": np.full(N, 2.0)}
    oil = spikes.spiked(columns, {"flight.oil_gain.gain": 0.15})
    assert oil["m_ballast_pumped"] * 1.15 == pytest.approx(columns["m_ballast_pumped"])
    deep = spikes.spiked(columns, {"sensor.pressure_offset.offset": 0.7})
    assert deep["m_depth"] == pytest.approx(columns["m_depth"] + 0.7)
    assert deep["m_pressure"] - columns["m_pressure"] == pytest.approx(np.full(N, 0.0704), rel=0.01)
    counted = spikes.spiked(columns, {"sensor.coulomb_gain.gain": 0.05})
    assert set(counted) == {"m_coulomb_amphr_total"}
    assert np.ptp(counted["m_coulomb_amphr_total"]) == pytest.approx(1.05 * np.ptp(columns["m_coulomb_amphr_total"]))
    climbs = spikes.spiked(columns, {"energy.climb_only_load.power": 1.4})["m_coulomb_current"]
    assert (climbs - columns["m_coulomb_current"])[columns["m_pitch"] > 0] == pytest.approx(0.1)
    assert (climbs - columns["m_coulomb_current"])[columns["m_pitch"] < 0] == pytest.approx(0.0)


def test_a_missing_sensor_is_named(columns):
    del columns["m_heading"]
    with pytest.raises(
        DataError, match="expected the sensor 'm_heading' for 'navigation.magnetic_declination'"
    ):
        spikes.spiked(columns, {"navigation.magnetic_declination.angle": 0.1})


def test_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="found none"):
        spikes.available(tmp_path)


def natural(*effects, least=0.06):
    """A diagnosis of an untouched recording: what it names, and the smallest pitch gain it would have seen."""
    seen = {"id": "flight.pitch_gain", "minimum_detectable": [{"name": "gain", "minimum": least}]}
    return {"effects": list(effects), "not_found": [seen, {"id": "sensor.current_gain", "minimum_detectable": []}]}


def test_strength_is_told_against_the_smallest_size_that_would_be_seen():
    assert spikes.ratio("flight.pitch_gain", natural()) == pytest.approx(6.0 * 0.12 / 0.06)
    assert spikes.ratio("flight.pitch_gain", natural(), 0.5) == pytest.approx(6.0)
    assert spikes.ratio("sensor.current_gain", natural()) is None
    assert spikes.ratio("flight.oil_gain", natural()) is None
    twin = {"id": "flight.drag_bias", "alternatives": [{"id": "flight.pitch_gain"}]}
    assert spikes.ratio("flight.pitch_gain", natural(twin)) is None


def test_only_what_can_be_seen_is_put_in():
    drawn = draw_spikes(40, 7, {"ru28_2017": natural(), "osu684_2025": natural(least=2.0)})
    assert {one["region"] for one in drawn} == {"ru28_2017"}
    for one in drawn:
        ratio = one["strengths"]["flight.pitch_gain"]
        assert 4.0 <= ratio <= 36.0
        assert abs(one["effects"]["flight.pitch_gain.gain"]) == pytest.approx(0.06 * ratio / 6.0)
    assert len({one["effects"]["flight.pitch_gain.gain"] > 0 for one in drawn}) == 2
    with pytest.raises(ConfigError, match="none of the real recordings shows"):
        draw_spikes(4, 7, {"osu684_2025": natural(least=2.0)})


def test_only_what_was_not_there_before_is_found():
    truth = spikes.truth_of("ru28_2017", "flight.pitch_gain", 1.0, "real001", 12.0)
    effects = [{"id": "navigation.mean_current"}, {"id": "flight.pitch_gain"}]
    found = {"verdict": "unexplained", "effects": effects}
    right = judge(truth, found, 1.0, natural=["navigation.mean_current"])
    assert right["first_exact"] and right["exact_set"] and right["natural"] == ["navigation.mean_current"]
    assert not judge(truth, found, 1.0)["exact_set"]
    missed = judge(truth, found | {"effects": effects[:1]}, 1.0, natural=["navigation.mean_current"])
    assert not missed["detected"] and missed["named"] == []
    scores = summary([right, missed])["real"]
    assert scores[">=6"]["exact set"]["hits"] == 1 and scores[">=6"]["detected"]["cases"] == 2


def test_a_real_recording_is_spiked_in_place(real, tmp_path):
    folder = real("recordings")
    known = spikes.available(folder)
    truth = spikes.truth_of("comet2019_first", "flight.pitch_gain", -1.0, "real001")
    spikes.write_spiked(tmp_path / "case", folder, truth)
    spikes.write_plain(tmp_path / "plain", folder, "comet2019_first")
    spikes.write_plain(tmp_path / "later", folder, "comet2019_second")
    with (
        netCDF4.Dataset(tmp_path / "case/recording.nc") as a,
        netCDF4.Dataset(tmp_path / "plain/recording.nc") as b,
        netCDF4.Dataset(tmp_path / "later/recording.nc") as later,
    ):
        indicated, true = (np.ma.filled(one["m_pitch"][:], np.nan) for one in (a, b))
        assert indicated * 0.88 == pytest.approx(true, abs=1e-6, nan_ok=True)
        assert np.array_equal(a["m_depth"][:], b["m_depth"][:])
        assert later["time"][0] - b["time"][-1] > spikes.HOLE
        assert b["time"][0] < b["sci_time"][0] < b["sci_time"][-1] < later["time"][0]
    for recording in known:
        spikes.write_plain(tmp_path / recording, folder, recording)
        with netCDF4.Dataset(tmp_path / recording / "recording.nc") as data:
            here = set(data.variables)
        for id in spikes.SIZES:
            one = spikes.truth_of(recording, id, 1.0, "x")
            try:
                spikes.write_spiked(tmp_path / f"{recording}{id}", folder, one)
            except DataError as error:
                lacking = re.search(r"sensor '(\w+)'", str(error)).group(1)
                assert lacking not in here
