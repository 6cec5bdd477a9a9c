"""Counts to amperes: scale and sign, uncertainty, zeros and drift, and the instrument's own power."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.board import calibration as cal
from glider_jax.board import power
from glider_jax.errors import ConfigError, DataError


def test_one_count_is_what_the_data_sheets_say():
    board = cal.nominal()
    assert board["main"].amperes_per_count == pytest.approx(0.0488, rel=1e-3)
    assert board["pump_a"].amperes_per_count == pytest.approx(0.0264, rel=1e-3)
    assert board["main"].noise == pytest.approx(np.hypot(0.018, 0.0141), rel=1e-2)
    assert board["pump_a"].noise == pytest.approx(np.hypot(0.0189, 0.0076), rel=1e-2)


def test_sign_and_scale():
    board = cal.nominal()
    amps = board.amperes("pump_a", [512, 612, 412])
    np.testing.assert_allclose(amps.value, [0.0, 2.6393, -2.6393], rtol=1e-4)


def test_a_sample_on_a_rail_is_not_a_number():
    value = cal.nominal().amperes("fin", [0, 1023, 512]).value
    assert np.isnan(value[:2]).all() and value[2] == 0.0


def test_uncertainty_keeps_noise_and_shared_errors_apart():
    board = cal.nominal().with_zero("pump_a", 512.0, 0.05)
    amps = board.amperes("pump_a", [512, 700], temperature=25.0)
    assert amps.systematic[0] == pytest.approx(0.05 * 0.02639, rel=1e-3)
    assert amps.systematic[1] == pytest.approx(np.hypot(0.05 * 0.02639, 0.015 * amps.value[1]), rel=1e-6)
    assert amps.sigma[0] == pytest.approx(np.hypot(amps.random, amps.systematic[0]))
    # Ten kelvin of unknown temperature move the zero by 14 mA on a 5 A sensor, 34 mA on a 20 A one.
    assert board.amperes("pump_a", 512).systematic == pytest.approx(0.0141, rel=0.02)
    assert cal.nominal().with_zero("main", 512.0, 0.0).amperes("main", 512).systematic == pytest.approx(
        0.034, rel=0.01
    )


def test_zero_sd_is_honest():
    rng = np.random.default_rng(0)
    errors, stated = [], []
    for _ in range(300):
        truth = 512 + rng.uniform(-1, 1)
        counts = np.rint(truth + rng.normal(0, 0.5, 900)).astype(int)
        zero, sd = cal.zero_when_off(counts)
        errors.append(zero - truth)
        stated.append(sd)
    assert 0.8 < np.std(errors) / np.mean(stated) < 1.2


def test_a_zero_without_noise_keeps_the_error_of_quantisation():
    zero, sd = cal.zero_when_off(np.full(10_000, 512))
    assert zero == 512 and sd > 0.2


def test_zero_of_a_running_motor_is_refused():
    counts = np.r_[np.full(500, 512), np.full(200, 600)]
    with pytest.raises(DataError, match="nothing runs"):
        cal.zero_when_off(counts, "brake")
    with pytest.raises(DataError, match="at least 16"):
        cal.zero_when_off(counts[:5])


def test_drift_of_the_zero():
    temperature = np.array([5.0, 15.0, 25.0])
    zero = 512.0 + 0.07 * (temperature - 25.0)
    at, sd, drift, drift_sd = cal.fit_drift(temperature, zero, np.full(3, 0.05))
    assert (at, drift) == (pytest.approx(512.0), pytest.approx(0.07))
    assert drift_sd == pytest.approx(0.05 / 200**0.5, rel=1e-6)
    with pytest.raises(DataError, match="1 K apart"):
        cal.fit_drift(np.array([20.0, 20.2]), zero[:2], np.full(2, 0.1))


def test_file_round_trip(tmp_path):
    board = cal.nominal().with_zero("fin", 498.25, 0.031)
    cal.write_calibration(board, tmp_path / "c.toml")
    again = cal.read_calibration(tmp_path / "c.toml")
    assert again.channels == board.channels


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[channels.bracke]\nzero = 5.0", "Did you mean 'brake'"),
        ("[channels.brake]\nzerro = 5.0", "Did you mean 'zero'"),
        ("[channels.brake]\nzero = 'x'", "expected a number"),
        ("[channels.brake]\nsensor = 'hall_6A'", "unknown sensor"),
        ("x = [", "expected TOML"),
        ("source = 'x'", "found none"),
    ],
)
def test_bad_files_are_explained(tmp_path, text, message):
    path = tmp_path / "c.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        cal.read_calibration(path)


def test_absent_file_and_channel(tmp_path):
    with pytest.raises(ConfigError, match="found nothing"):
        cal.read_calibration(tmp_path / "no.toml")
    with pytest.raises(ConfigError, match="Did you mean 'pump_"):
        cal.nominal()["pump"]


def test_power_of_the_instrument_is_the_papers():
    assert power.instrument_power() == pytest.approx(0.76 + 0.71 - 0.19)
    assert power.instrument_power(
        "measurement_board_6", "science_computer_development_3mhz"
    ) == pytest.approx(0.58 + 0.35 - 0.19)
    assert power.BOARDS["measurement_board_8"].power - power.BOARDS[
        "measurement_board_6"
    ].power == pytest.approx(0.18)
    assert (
        power.ctd_interval("science_computer_development_3mhz"),
        power.ctd_interval("science_computer_deployed"),
    ) == (4.0, 2.0)
    devices = power.instrument_devices("measurement_board_6", "science_computer_stock")
    assert [d.group for d in devices] == ["instrument", "instrument"]
    assert all("Table" in d.power.source for d in devices)
    with pytest.raises(ConfigError, match="Did you mean 'measurement_board"):
        power.instrument_power("measurement_board_9")


def test_device_tables_are_read_back(tmp_path):
    from glider_jax.readers.vehicles import read_vehicle

    path = tmp_path / "v.toml"
    path.write_text(
        power.device_toml("measurement_board_6", "science_computer_development_7mhz")
        + '[vehicle]\nname = "x"\n'
    )
    powers = {d.name: d.power.value for d in read_vehicle(path).devices}
    assert powers["measurement_board_6"] == 0.58 and powers["science_computer_development_7mhz"] == 0.49
