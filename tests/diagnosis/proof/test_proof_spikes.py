"""Effects put into recordings: each changes what it should, by as much as it should."""

from __future__ import annotations

import netCDF4
import numpy as np
import pytest

from glider_jax.diagnosis.proof import spikes
from glider_jax.diagnosis.proof.metrics import judge, summary
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


def test_a_missing_sensor_is_named(columns):
    del columns["m_heading"]
    with pytest.raises(
        DataError, match="expected the sensor 'm_heading' for 'navigation.magnetic_declination'"
    ):
        spikes.spiked(columns, {"navigation.magnetic_declination.angle": 0.1})


def test_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="found none"):
        spikes.available(tmp_path)


def test_only_what_was_not_there_before_is_found():
    truth = spikes.truth_of("comet2019", "flight.pitch_gain", 1.0, "real001")
    found = judge(truth, {"verdict": "explained", "effects": [{"id": "flight.pitch_gain"}]}, 1.0)
    scores = summary([found | {"natural": []}, found | {"natural": ["flight.pitch_gain"]}])
    assert scores["real"]["found"]["hits"] == 1
    assert scores["real"]["named as found already"]["hits"] == 1


def test_a_real_recording_is_spiked_in_place(real, tmp_path):
    folder = real("recordings")
    known = spikes.available(folder)
    assert {id for _, id in known} == set(spikes.SIZES)
    truth = spikes.truth_of("comet2019", "flight.pitch_gain", 1.0, "real001")
    spikes.write_spiked(tmp_path / "case", folder, truth)
    spikes.write_spiked(tmp_path / "plain", folder, truth, plain=True)
    with (
        netCDF4.Dataset(tmp_path / "case/recording.nc") as a,
        netCDF4.Dataset(tmp_path / "plain/recording.nc") as b,
    ):
        indicated, true = (np.ma.filled(one["m_pitch"][:], np.nan) for one in (a, b))
        assert indicated * 0.88 == pytest.approx(true, abs=1e-6, nan_ok=True)
        assert np.array_equal(a["m_depth"][:], b["m_depth"][:])
    for recording, id in known:
        spikes.write_spiked(tmp_path / f"{recording}{id}", folder, spikes.truth_of(recording, id, 1.0, "x"))
