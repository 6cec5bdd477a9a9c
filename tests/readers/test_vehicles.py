"""Vehicle files: presets, the flat form with sigmas, units, batteries, devices, covariances, and every refusal."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.errors import ConfigError, DataError
from glider_jax.readers.battery_packs import PACKS, mean_voltage, pack
from glider_jax.readers.device_catalogue import DEVICES, GROUPS, STATES
from glider_jax.readers.quantities import QUANTITIES
from glider_jax.readers.toml_checks import UNITS, parse_toml, si_factor
from glider_jax.readers.vehicles import presets, read_vehicle

PILOT = """
[vehicle]
name = "pilot"
mass = { value = 52.5, sigma = 0.003 }   # kg
volume = 0.05125
wing_area = 0.1
parasite_drag = { value = 0.16, sigma = 0.004 }
induced_drag = 10.5
lift_slope = 7.5
pump_volume = 225.0    # cc
pump_rate = 11.0       # cc/s
[energy]
hotel = { value = 1.2, sigma = 0.015 }
pump_dive_to_climb = { intercept = 100.0, intercept_sigma = 5.0, slope = 6.5, slope_sigma = 0.15 }
pump_climb_to_dive = { value = 80.0, sigma = 4.0 }
brake = { value = 44.0, sigma = 2.0 }
surface = { value = 2.4, sigma = 0.05 }
battery_capacity = 7200000.0
open_circuit_voltage = { full = 15.0, empty = 11.0 }
"""


def write(tmp_path, text, name="vehicle.toml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_default_is_the_shallow_preset_and_says_everything():
    vehicle = read_vehicle()
    assert vehicle.name == "slocum_g1_shallow"
    assert set(vehicle.quantities) == set(QUANTITIES)
    assert read_vehicle("slocum_g1_shallow") == vehicle
    # About 940 J for a yo to 100 m: line, climb-to-dive and two brakes.
    line = vehicle.value("energy.pump_dive_to_climb.intercept") + 100.0 * vehicle.value(
        "energy.pump_dive_to_climb.slope"
    )
    yo = line + vehicle.value("energy.pump_climb_to_dive") + 2.0 * vehicle.value("energy.brake")
    assert 900.0 <= yo <= 960.0
    assert vehicle.value("energy.hotel") == 0.25
    assert vehicle.battery.name == "alkaline"


@pytest.mark.parametrize("name", presets())
def test_every_preset_states_source_and_is_neutral_in_sea_water(name):
    vehicle = read_vehicle(name)
    for key, quantity in vehicle.quantities.items():
        assert quantity.source, key
        assert quantity.unit == QUANTITIES[key].unit
        assert QUANTITIES[key].low <= quantity.value <= QUANTITIES[key].high
    density = vehicle.value("flight.mass") / vehicle.value("flight.volume")
    assert 1023.0 <= density <= 1027.5
    assert all(not line.startswith(("flight.mass", "energy.hotel")) for line in vehicle.assumed)


def test_all_presets_are_there():
    assert set(presets()) == {"slocum_g1_shallow", "slocum_g1_comet", "slocum_g2_deep", "slocum_g3"}


def test_comet_preset_carries_the_measured_line_and_its_covariance():
    vehicle = read_vehicle("slocum_g1_comet")
    names = vehicle.covariances[0].names
    matrix = np.array(vehicle.covariances[0].matrix)
    assert names == ("energy.pump_dive_to_climb.intercept", "energy.pump_dive_to_climb.slope")
    at = np.array([1.0, 37.0])
    # Well known in the middle of the events although neither coefficient is.
    assert math.sqrt(at @ matrix @ at) < 6.0
    assert vehicle.value(names[0]) + 41.0 * vehicle.value(names[1]) == pytest.approx(426.0, abs=30.0)


def test_flat_form_in_si_with_cc_for_the_pump(tmp_path):
    vehicle = read_vehicle(write(tmp_path, PILOT))
    assert vehicle.value("flight.pump_volume") == pytest.approx(225e-6)
    assert vehicle.value("flight.pump_rate") == pytest.approx(11e-6)
    assert vehicle.quantities["flight.mass"].sigma == 0.003
    assert vehicle.quantities["flight.volume"].sigma == 0.0
    assert vehicle.quantities["energy.pump_dive_to_climb.slope"].value == 6.5
    assert vehicle.quantities["energy.pump_dive_to_climb.slope"].sigma == 0.15
    assert vehicle.value("energy.pump_dive_to_climb.reference_volume") == pytest.approx(450e-6)
    # What the file does not name is left out: it must not come from a preset.
    assert vehicle.value("flight.hull_compressibility") == 0.0
    assert vehicle.value("flight.thermal_expansion") == 0.0
    assert vehicle.devices == ()
    battery = vehicle.battery
    assert battery.voltage_curve == ((0.0, 11.0), (1.0, 15.0))
    assert battery.energy.value == 7.2e6
    assert battery.capacity.value == pytest.approx(7.2e6 / 13.0)
    assert battery.internal_resistance.value == 0.0
    assert any(line.startswith("flight.volume: given without sigma") for line in vehicle.assumed)
    assert any(line.startswith("perturbation.current_error:") for line in vehicle.assumed)


@pytest.mark.parametrize("case", range(1, 9))
def test_files_of_the_concealed_effect_format_are_read_as_they_are(real, case):
    folder = real().parent / "blind-practice" / f"practice{case}"
    if not folder.exists():
        pytest.skip("the practice cases are not here")
    vehicle = read_vehicle(folder / "vehicle.toml")
    assert vehicle.value("flight.mass") == 52.0
    assert vehicle.value("flight.pump_volume") == pytest.approx(230e-6)
    assert vehicle.value("energy.pump_dive_to_climb.intercept") == 110.0
    assert vehicle.value("energy.pump_dive_to_climb.reference_volume") == pytest.approx(460e-6)
    assert vehicle.battery.voltage_curve == ((0.0, 11.0), (1.0, 15.0))


def test_a_preset_fills_what_the_file_leaves_out_and_says_so(tmp_path):
    text = '[vehicle]\npreset = "slocum_g1_comet"\nmass = { value = 73.4, sigma = 0.002 }\n'
    vehicle = read_vehicle(write(tmp_path, text))
    comet = read_vehicle("slocum_g1_comet")
    assert vehicle.value("flight.mass") == 73.4
    assert vehicle.value("flight.parasite_drag") == comet.value("flight.parasite_drag")
    assert vehicle.covariances == comet.covariances
    assert vehicle.battery == comet.battery
    assert any(line.startswith("flight.parasite_drag:") and "slocum_g1_comet" in line for line in vehicle.assumed)
    assert not any(line.startswith("flight.mass:") for line in vehicle.assumed)
    assert len(vehicle.source.files) == 2


def test_a_new_pump_line_drops_the_preset_covariance(tmp_path):
    text = '[vehicle]\npreset = "slocum_g1_comet"\n[energy.pump_dive_to_climb]\nintercept = 200.0\nslope = 6.0\n'
    vehicle = read_vehicle(write(tmp_path, text))
    assert vehicle.covariances == ()
    assert vehicle.quantities["energy.pump_dive_to_climb.slope"].sigma == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("line", "name", "value", "sigma"),
    [
        ("pump_volume_cc = 240", "flight.pump_volume", 240e-6, 0.0),
        ('pump_volume = { value = 0.00024, unit = "m3" }', "flight.pump_volume", 240e-6, 0.0),
        ('pump_volume = { value = 0.24, sigma = 0.01, unit = "L" }', "flight.pump_volume", 240e-6, 10e-6),
        ("pump_volume = 240\npump_volume_sigma = 5", "flight.pump_volume", 240e-6, 5e-6),
        ("pump_rate_cc_per_s = 30", "flight.pump_rate", 30e-6, 0.0),
        ('mass = { value = 52300, sigma = 4, unit = "g" }', "flight.mass", 52.3, 0.004),
        ('hull_compressibility = { value = 5e-6, unit = "1/dbar" }', "flight.hull_compressibility", 5e-10, 0.0),
    ],
)
def test_units_are_converted(tmp_path, line, name, value, sigma):
    quantity = read_vehicle(write(tmp_path, f"[vehicle]\nvolume = 0.051\n{line}\n")).quantities[name]
    assert quantity.value == pytest.approx(value)
    assert quantity.sigma == pytest.approx(sigma)


def test_perturbations_in_the_units_people_speak(tmp_path):
    text = (
        "[perturbation]\nheading_deg = 2.0\ncurrent_error = 0.05\ncurrent_error_time_h = 12\n"
        "current_error_length_km = 30\ninitial_position = 50\nspeed = 0.1\n"
    )
    vehicle = read_vehicle(write(tmp_path, text))
    assert vehicle.value("perturbation.heading") == pytest.approx(math.radians(2.0))
    assert vehicle.value("perturbation.current_error_time") == 43200.0
    assert vehicle.value("perturbation.current_error_length") == 30e3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[vehicle]\nmas = 52\n", r"vehicle.toml: \[vehicle\] unknown key 'mas'. Did you mean 'mass'\?"),
        ("[vehicle]\nmass = true\n", "finite number"),
        ("[vehicle]\nmass = nan\n", "finite number"),
        ("[vehicle]\nmass = 5200\n", "expected 20 to 200 kg"),
        ("[vehicle]\nmass = { sigma = 1 }\n", "no 'value'"),
        ("[vehicle]\nmass = { value = 52, sigma = -1 }\n", "at least 0"),
        ('[vehicle]\nmass = { value = 52, unit = "m" }\n', "converts to kg"),
        ('[vehicle]\nmass = { value = 52, unit = "stone" }\n', "unknown unit 'stone'"),
        ("[vehicle]\nmass = { value = 52, sgima = 1 }\n", "Did you mean 'sigma'"),
        ("[vehicle]\npump_volume = 230\npump_volume_cc = 230\n", "say the same thing twice"),
        ("[vehicle]\nmass_sigma = 0.1\n", "expected 'mass' beside it"),
        ("[vehicle]\npump_volume = 0.00023\n", "flight|cc|unit"),
        ('[vehicle]\npreset = "slocum_g1_shalow"\n', "Did you mean 'slocum_g1_shallow'"),
        ("[vehicle]\nmass = 60\nvolume = 0.0507\n", "density of water"),
        ("[vehicles]\nmass = 60\n", "Did you mean 'vehicle'"),
        ("[energy]\npump_dive_to_climb = 600\n", "expected a table"),
        ("[energy]\npump_dive_to_climb = { intercept = 1, slop = 2 }\n", "Did you mean 'slope'"),
        ("[energy]\nbattery_capacity = -1\n", "more than 0 J"),
        ("[energy]\nopen_circuit_voltage = { full = 10, empty = 15 }\n", "at or above"),
        ("[perturbation]\nheading = 3\n", "0 to 1 rad"),
        ('[battery]\npack = "alkalin"\n', "Did you mean 'alkaline'"),
        ("[battery]\nvoltage_curve = [[1, 15], [0, 10]]\n", "ascending"),
        ("[battery]\nusable_fraction = 1.5\n", "0.01 to 1"),
        ('devices = ["ctdd"]\n', "Did you mean 'ctd'"),
        ('devices = ["ctd", "ctd"]\n', "stands twice"),
        ("devices = [3]\n", "a name or a table"),
        ('[[devices]]\nname = "winch"\n', "expected the power of 'winch'"),
        ('[[devices]]\nname = "winch"\npower = 3\ngroup = "scince"\n', "one of hotel, science"),
        ('[[devices]]\nname = "winch"\npower = 3\nstates = ["diving"]\n', "dive, climb, hover, surface"),
        ('[[devices]]\nname = "winch"\npower = 3\nduty = 1.5\n', "between 0 and 1"),
        ('[[devices]]\npower = 3\n', "device's name"),
        ('[[devices]]\nname = "winch"\npower = 3\nminimum_depth = 9\nmaximum_depth = 3\n', "at most maximum_depth"),
        ('[[covariance]]\nnames = ["energy.hotl"]\nmatrix = [[1]]\n', "Did you mean 'energy.hotel'"),
        ('[[covariance]]\nnames = ["energy.hotel"]\nmatrix = [[1, 2]]\n', "square matrix"),
        (
            '[[covariance]]\nnames = ["energy.hotel", "energy.brake"]\nmatrix = [[1, 2], [2, 1]]\n',
            "positive semi-definite",
        ),
        ('[[covariance]]\nnames = ["energy.hotel", "energy.brake"]\nmatrix = [[1, 0], [0.5, 1]]\n', "symmetric"),
        ('[[covariance]]\nnames = ["energy.hotel"]\nmatrix = [[-1]]\n', "variances of at least 0"),
        ('[speeds]\nfile = "a.json"\ndistribution = "paper2010"\n', "contradict"),
        ("[terms.\"flight.drag_growth\"]\ndrag_rate = { sigma = 1 }\n", "expected a number"),
        ("[vehicle\n", "not valid TOML"),
    ],
)  # fmt: skip
def test_bad_vehicles_are_refused_in_one_sentence(tmp_path, text, message):
    path = write(tmp_path, text)
    with pytest.raises(ConfigError, match=message) as caught:
        read_vehicle(path)
    assert "vehicle.toml" in str(caught.value)


def test_unreadable_files(tmp_path):
    with pytest.raises(DataError, match="Check the path"):
        read_vehicle(tmp_path / "absent.toml")
    with pytest.raises(DataError):
        read_vehicle(tmp_path)
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b'[vehicle]\nname = "\xb0"\n')
    with pytest.raises(ConfigError, match="UTF-8"):
        read_vehicle(binary)


def test_devices_by_name_and_as_tables(tmp_path):
    text = (
        'devices = ["ctd", "gps", { name = "iridium", seconds_per_surfacing = 600 },'
        ' { name = "winch", group = "science", power = { value = 4, sigma = 1, unit = "W" }, states = ["dive"],'
        " duty = 0.5, sensor_types = [77], joules_per_inflection = 12, maximum_depth = 50 }]\n"
    )
    ctd, gps, iridium, winch = read_vehicle(write(tmp_path, text)).devices
    assert ctd == DEVICES["ctd"] and gps == DEVICES["gps"]
    assert iridium.seconds_per_surfacing == 600.0
    assert iridium.power == DEVICES["iridium"].power
    assert (winch.power.value, winch.power.sigma, winch.duty, winch.sensor_types) == (4.0, 1.0, 0.5, (77,))
    assert winch.states == frozenset({"dive"}) and winch.joules_per_inflection == 12.0


def test_catalogue_holds_the_published_tables():
    watts = {name: device.power.value for name, device in DEVICES.items()}
    assert watts["science_computer_stock"] == 0.19
    assert watts["science_computer_deployed"] == 0.71
    assert watts["science_computer_development_3mhz"] == 0.35
    assert watts["science_computer_development_7mhz"] == 0.49
    assert watts["measurement_board_8"] == 0.76 and watts["measurement_board_6"] == 0.58
    needed = {"ctd", "pitch_servo", "fin_servo", "gps", "iridium", "air_pump", "argos", "altimeter", "adcp", "dvl"}
    assert needed | {"acoustic_modem", "thruster", "fluorometer", "oxygen"} <= set(DEVICES)
    for device in DEVICES.values():
        assert device.power.source and device.group in GROUPS and device.states <= set(STATES)


@pytest.mark.parametrize("name", PACKS)
def test_packs_agree_with_themselves(name):
    battery = pack(name)
    curve = battery.voltage_curve
    assert [s for s, _ in curve] == sorted({s for s, _ in curve}) and curve[0][0] == 0.0 and curve[-1][0] == 1.0
    assert [v for _, v in curve] == sorted(v for _, v in curve)
    rated = battery.energy.value / battery.capacity.value
    # The alkaline rating is charge times 15 V, which no load ever gets.
    assert mean_voltage(curve) == pytest.approx(rated, rel=0.15 if name == "alkaline" else 0.025)
    assert 0.7 <= battery.usable_fraction.value <= 0.93
    assert curve[0][1] <= battery.undervolts <= curve[-1][1]


def test_lithium_knees():
    four = np.array(pack("lithium_primary_4s").voltage_curve)
    three = np.array(pack("lithium_primary_3s").voltage_curve)
    soc = np.array([0.10, 0.25, 0.9])
    low, high, full = np.interp(soc, *four.T)
    assert low < 12.0 < 14.0 < high and full - high < 1.0
    # 3S is flat until nothing is left.
    assert np.interp(0.1, *three.T) > 10.5


def test_battery_overrides_in_amp_hours(tmp_path):
    text = '[battery]\npack = "lithium_primary_3s"\ncapacity_ah = 700\nundervolts = 10.2\nreserve_fraction = 0.2\n'
    battery = read_vehicle(write(tmp_path, text)).battery
    assert battery.capacity.value == 700.0 * 3600.0
    assert battery.energy.value == pytest.approx(700.0 * 3600.0 * mean_voltage(battery.voltage_curve))
    assert (battery.undervolts, battery.reserve_fraction) == (10.2, 0.2)
    joules = read_vehicle(write(tmp_path, "[battery]\nenergy_wh = 2000\n")).battery
    assert joules.energy.value == 7.2e6
    assert joules.capacity.value == pytest.approx(7.2e6 / mean_voltage(joules.voltage_curve))


def test_terms_speeds_and_covariance(tmp_path):
    text = (
        '[terms."flight.drag_growth"]\ndrag_rate = { value = 2e-8, sigma = 1e-8, unit = "s-1" }\nshape = 1\n'
        '[terms."energy.surface_load"]\n[speeds]\nfile = "own.json"\nkind = "through_water"\nshoebox = 0.3\n'
        '[[covariance]]\nnames = ["energy.hotel", "energy.brake"]\nmatrix = [[0.04, 0.0], [0.0, 9.0]]\nsource = "fit"\n'
    )
    vehicle = read_vehicle(write(tmp_path, text))
    assert vehicle.terms["flight.drag_growth"]["drag_rate"].sigma == 1e-8
    assert vehicle.terms["energy.surface_load"] == {}
    assert vehicle.speeds == {"file": str(tmp_path / "own.json"), "kind": "through_water", "shoebox": 0.3}
    # The block's diagonal is the sigma of each quantity.
    assert vehicle.quantities["energy.hotel"].sigma == pytest.approx(0.2)
    assert vehicle.quantities["energy.brake"].sigma == pytest.approx(3.0)
    assert vehicle.covariances[0].source == "fit"


def test_units_convert_only_to_their_own_kind():
    assert si_factor("cc/s", "m3 s-1", "x") == pytest.approx(1e-6)
    assert si_factor("Wh", "J", "x") == 3600.0
    assert si_factor("deg", "rad", "x") == pytest.approx(math.pi / 180.0)
    for unit, (si, factor) in UNITS.items():
        assert factor > 0.0 and UNITS[si] == (si, 1.0), unit
        with pytest.raises(ConfigError, match="converts to"):
            si_factor(unit, "C" if si != "C" else "J", "x")


@settings(max_examples=40, deadline=None)
@given(
    st.floats(25.0, 150.0), st.floats(0.0, 1.0), st.floats(1001.0, 1040.0), st.floats(1.0, 1900.0), st.floats(0.0, 50.0)
)
def test_numbers_come_back_as_written(tmp_path_factory, mass, sigma, density, cc, hotel):
    path = tmp_path_factory.mktemp("v") / "v.toml"
    volume = min(max(mass / density, 0.0201), 0.199)
    path.write_text(
        f"[vehicle]\nmass = {{ value = {mass!r}, sigma = {sigma!r} }}\nvolume = {volume!r}\n"
        f"pump_volume = {cc!r}\n[energy]\nhotel = {hotel!r}\n"
    )
    vehicle = read_vehicle(path)
    assert vehicle.quantities["flight.mass"].value == mass and vehicle.quantities["flight.mass"].sigma == sigma
    assert vehicle.value("flight.pump_volume") == pytest.approx(cc * 1e-6, rel=1e-15)
    assert vehicle.quantities["energy.hotel"].sigma == pytest.approx(0.05 * hotel)


@settings(max_examples=150, deadline=None)
@given(st.one_of(st.binary(max_size=200), st.text(max_size=200).map(lambda t: t.encode("utf-8", "replace"))))
def test_any_bytes_are_read_or_refused(tmp_path_factory, raw):
    path = tmp_path_factory.mktemp("f") / "f.toml"
    path.write_bytes(raw)
    try:
        read_vehicle(path)
    except (ConfigError, DataError) as error:
        assert "f.toml" in str(error)


@pytest.mark.parametrize("value", ["[]", "{}", '"x"', "1e400", "[[1]]", "[{}]", "2020-01-01", "9" * 400])
@pytest.mark.parametrize(
    "key",
    [
        "devices", "covariance", "terms", "speeds", "battery", "energy", "vehicle", "perturbation", "vehicle.mass",
        "vehicle.preset", "vehicle.name", "energy.pump_dive_to_climb", "energy.open_circuit_voltage", "battery.pack",
        "energy.battery_capacity", "battery.voltage_curve", "speeds.file", "terms.x", "vehicle.pump_volume",
    ],
)  # fmt: skip
def test_values_of_the_wrong_kind_never_crash(tmp_path, key, value):
    path = write(tmp_path, f"{key} = {value}\n")
    try:
        read_vehicle(path)
    except (ConfigError, DataError) as error:
        assert "vehicle.toml" in str(error)


def test_syntax_error_names_the_line():
    with pytest.raises(ConfigError, match="line 2"):
        parse_toml(b"[vehicle]\nmass = = 3\n", "v.toml")
