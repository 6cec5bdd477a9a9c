"""Surface dialogs: real logs, and printouts that are cut, repeated, garbled, replayed or hostile."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from glider_jax.errors import DataError
from glider_jax.readers.dialogs import read_dialog
from glider_jax.readers.geodesy import range_and_bearing
from tests.readers.dialog_layouts import MOMENT, printout

FIX = (54.0 + 12.345 / 60.0, -(10.0 + 23.456 / 60.0))


def count(log, kind: str) -> int:
    return sum(r.count for r in log.repairs if r.kind == kind)


def only(text):
    log = read_dialog(text)
    assert len(log.surfacings) == 1
    return log.surfacings[0]


class TestOnePrintout:
    def test_identity_and_clock(self):
        one = only(printout())
        assert (one.vehicle, one.mission, one.mission_number) == ("kelp7", "deep.mi", "kelp7-2027-123-0-41")
        assert one.time == MOMENT and one.mission_time == 90_000.0
        assert (one.reason, one.behavior, one.start_when) == ("no comms for a while", "surface_3", 12.0)
        assert one.in_mission and not one.resumed and one.dumps == 1

    def test_positions_have_sign_from_the_number_and_time_from_the_age(self):
        one = only(printout())
        assert (one.gps.latitude, one.gps.longitude) == pytest.approx(FIX, abs=1e-12)
        assert one.gps.age == 30.0 and one.gps.time == MOMENT - 30.0
        assert one.dead_reckoned.age == 41.25 and one.dead_reckoned.latitude == pytest.approx(54.205)
        assert one.too_far is None and one.invalid.age == 95.5

    def test_southern_and_small_negative_degrees(self):
        one = only(printout(fix=("-0030.600", "00012.000")))
        assert (one.gps.latitude, one.gps.longitude) == pytest.approx((-0.51, 0.2))

    def test_sensors_are_si(self):
        s = only(printout()).sensors
        assert (s["m_coulomb_amphr_total"].value, s["m_coulomb_amphr_total"].unit) == (361_800.0, "C")
        assert (s["m_lithium_battery_relative_charge"].value, s["m_vacuum"].unit) == (0.8025, "Pa")
        assert s["m_vacuum"].value == pytest.approx(27091.1, abs=0.1)
        assert s["c_wpt_lon"].value == pytest.approx(-10.508333, abs=1e-6)
        assert s["m_battery"].age == 5.5 and s["m_battery"].time == MOMENT - 5.5

    def test_never_set_is_absent_and_settings_are_defaults(self):
        one = only(printout())
        assert "x_last_wpt_lat" not in one.sensors and "x_last_wpt_lat" not in one.defaults
        assert "f_coulomb_battery_capacity" not in one.sensors
        assert one.capacity.value == 550 * 3600.0 and one.capacity.age == math.inf
        assert one.last_waypoint is None

    def test_no_water_velocity_is_not_zero_velocity(self):
        text = printout().replace(
            "m_water_vx(m/s)=-0.125                    70.5", "m_water_vx(m/s)=0     1e+308"
        )
        assert only(text).water_velocity is None
        water = only(printout()).water_velocity
        assert (water.x, water.y, water.age) == (-0.125, 0.25, 70.75)

    def test_waypoint_latitude_first_with_own_range_and_bearing(self):
        w = only(printout()).waypoint
        assert (w.latitude, w.longitude) == pytest.approx((54.0 + 10.0 / 60.0, -(10.0 + 30.5 / 60.0)))
        assert w.printed_range == 8765.0 and math.degrees(w.printed_bearing) == pytest.approx(245.0)
        east = (w.longitude - FIX[1]) * 111_320.0 * math.cos(math.radians(54.19))
        north = (w.latitude - FIX[0]) * 111_310.0
        assert w.range == pytest.approx(math.hypot(east, north), rel=4e-3)
        assert w.bearing == pytest.approx(math.atan2(east, north) % (2 * math.pi), abs=0.01)
        assert w.age == 3 * 3600.0 + 12 * 60.0

    def test_waypoint_in_kilometres_and_none_at_zero(self):
        assert only(printout().replace("Range: 8765m", "Range: 12.5km")).waypoint.printed_range == 12_500.0
        zero = printout(sensors=False).replace("(5410.0000,-1030.5000)", "(0.0000,0.0000)")
        assert only(zero).waypoint is None

    def test_aborts_devices_and_dive_deadline(self):
        one = only(printout())
        assert (one.aborts.total, one.aborts.cause, one.aborts.mission) == (
            2,
            "MS_ABORT_OVERDEPTH",
            "SHALLOW.MI",
        )
        assert one.aborts.time == 1809140645.0
        assert one.devices.errors == (4, 1, 0) and one.devices.oddities == (90, 12, 5)
        assert one.time_until_diving == 244.0 and one.water_complete is True

    @pytest.mark.parametrize("prompt", ["GliderDos I -3 >", "GliderDos A 8 >", "GliderLAB N -1 >"])
    def test_prompt_means_no_mission(self, prompt):
        one = only(printout() + f"\n{prompt}put x 1\n")
        assert not one.in_mission and one.state == "not in mission" and "prompt" in one.evidence
        assert one.abort_code == (8 if " A 8" in prompt else None)

    def test_menu_that_mentions_gliderdos_is_no_prompt(self):
        assert only(printout()).in_mission

    def test_positions_alone_leave_the_state_unknown(self):
        one = only(printout(number=None, menu=False))
        assert one.state == "unknown" and not one.in_mission and one.gps is not None

    def test_where_at_a_prompt(self):
        one = only("GliderDos N -1 >where\n" + printout(number=None, menu=False))
        assert one.state == "not in mission"

    def test_reason_without_its_bracket_or_cut(self):
        assert (
            only(printout().replace("[behavior surface_3", "[beh~vior surface_3")).reason
            == "no comms for a while"
        )
        plain = only(printout().replace(" [behavior surface_3 start_when = 12.0]", ""))
        assert (
            plain.reason == "no comms for a while" and plain.behavior == "" and math.isnan(plain.start_when)
        )
        assert read_dialog("Because:no com").surfacings == ()

    def test_resuming(self):
        assert only(printout() + "RESUMING MISSION\n").resumed

    def test_mission_log_names_the_mission_until_it_ends(self):
        head = "MissionSTARTDate: 4 May 2027 11:00:00 Z\nMission Name:   deep.mi\n"
        head += "Mission Number: kelp7-2027-123-0-41 (0102.0041)\n"
        log = head + printout(number=None, menu=False)
        assert only(log).in_mission and only(log).mission == "deep.mi"
        assert only(log + "post_mission_cleanup(): End of Mission\n").state == "not in mission"

    def test_later_single_readings_are_tied_to_the_clock(self):
        report = "90012 43 sensor: m_battery = 14.5 volts\n90013    sensor: m_depth = 0.25 m\n"
        one = only(printout() + report)
        assert one.battery_voltage.value == 14.5 and one.battery_voltage.time == MOMENT + 12.0
        assert one.sensors["m_depth"].time == MOMENT + 13.0

    def test_line_ends_controls_and_monitor_prefixes(self):
        plain = only(printout())
        assert only(printout().replace("\n", "\r\n")) == plain
        noisy = read_dialog(printout().replace("GPS", "G\x11P\x00S"))
        assert noisy.surfacings[0] == plain and count(noisy, "control characters") == 6
        prefix = "2027-05-04T12:30:01.123Z sfmc.kelp7."
        prefixed = "".join(
            f"{prefix}DIALOG {line}\n{prefix}POLL GliderDos I -3 >\n" for line in printout().splitlines()
        )
        assert only(prefixed) == plain

    def test_months_in_every_locale(self):
        for month, day in (("Jan", "Sun"), ("Mar", "Wed"), ("Dec", "Sun")):
            text = f"Vehicle Name: a\nCurr Time: {day} {month}  3 04:05:06 2027 MT: 7\n"
            assert math.isfinite(only(text.replace("Sun Dec  3", "Fri Dec  3")).time)


class TestDamage:
    def test_every_truncation_keeps_what_is_complete(self):
        text = printout()
        gps_end = text.index("30.000 secs ago") + len("30.000 secs ago")
        clock_end = text.index("MT:")
        whole = only(text)
        for cut in range(len(text) + 1):
            one = read_dialog(text[:cut]).latest
            if cut >= gps_end:
                assert (one.gps.latitude, one.gps.longitude) == pytest.approx(FIX), cut
                assert one.gps.time == MOMENT - 30.0
            else:
                assert one is None or one.gps is None, cut
            if cut > clock_end:
                assert one.time == MOMENT
            for name, datum in one.sensors.items() if one else ():
                assert datum == whole.sensors[name], cut

    def test_repeats_of_one_surfacing_are_one(self):
        texts = [printout(MOMENT + 60.0 * i, fix_age=30.0 + 60.0 * i) for i in range(4)]
        texts.append(printout(MOMENT + 300.0, fix=("5412.445", "-1023.456"), fix_age=20.0))
        one = only("".join(texts))
        assert one.dumps == 5 and one.time == MOMENT + 300.0 and one.first_time == MOMENT
        assert len(one.fixes) == 2 and one.gps.latitude == pytest.approx(54.0 + 12.445 / 60.0)
        assert one.gps.age == 20.0 and one.fixes[0].age == 330.0

    def test_next_segment_is_another_surfacing(self):
        second = printout(MOMENT + 7200.0, number="kelp7-2027-123-0-42", inflections=126)
        log = read_dialog(printout() + "RESUMING MISSION\n" + second)
        assert [s.mission_number[-2:] for s in log.surfacings] == ["41", "42"]
        assert [s.resumed for s in log.surfacings] == [True, False]

    def test_without_numbers_inflections_or_a_long_silence_tell_dives(self):
        first = printout(number=None)
        assert len(read_dialog(first + printout(MOMENT + 900.0, number=None)).surfacings) == 1
        assert (
            len(read_dialog(first + printout(MOMENT + 900.0, number=None, inflections=120)).surfacings) == 2
        )
        assert len(read_dialog(first + printout(MOMENT + 4000.0, number=None)).surfacings) == 2

    def test_replayed_text_counts_once(self):
        old, new = printout(), printout(MOMENT + 9000.0, number="kelp7-2027-123-0-42", inflections=130)
        log = read_dialog(old + new + "Connection Event: Carrier Detect lost.\n" + old + new[:700])
        assert [s.dumps for s in log.surfacings] == [1, 1]
        assert log.latest.time == MOMENT + 9000.0 and count(log, "replayed printout") == 2
        assert read_dialog(old + new).surfacings == log.surfacings

    def test_a_replay_that_breaks_off_does_not_restart_the_mission(self):
        log = read_dialog(
            printout() + "GliderDos N -1 >\nConnection Event: Carrier Detect found.\n" + printout()[:700]
        )
        assert log.latest.state == "not in mission"

    def test_garbled_copy_is_filled_from_its_replay(self):
        torn = (
            printout().replace("GPS Location:  5412", "GPS Loca~ion:  54").replace("m_battery(", "m_ba{tery")
        )
        assert only(torn).gps is None
        log = read_dialog(torn + printout())
        assert count(log, "garbled line") == 2 and log.surfacings == read_dialog(printout()).surfacings

    def test_garbled_line_is_left_out_and_counted(self):
        log = read_dialog(printout().replace("=14.75 ", "=14.#5 "))
        assert log.latest.battery_voltage is None and count(log, "garbled line") == 1
        assert log.latest.charge_used is not None

    def test_one_garbled_digit_of_a_fix_is_outvoted(self):
        texts = [printout(MOMENT + 60.0 * i, fix_age=30.0 + 60.0 * i) for i in range(3)]
        log = read_dialog("".join(texts[:2]) + texts[2].replace("5412.345", "5412.845"))
        assert log.latest.gps.latitude == pytest.approx(FIX[0]) and count(log, "conflicting fix") == 1

    def test_garbled_degrees_are_impossible_or_noted(self):
        first, far = printout(), printout(MOMENT + 60.0, fix=("6412.345", "-1023.456"), fix_age=10.0)
        log = read_dialog(first + far)
        assert log.latest.gps.latitude == pytest.approx(FIX[0]) and count(log, "impossible fix") == 1
        assert "50 km apart" in only(far).notes[0]
        assert only(printout(fix=("5472.345", "-1023.456"))).gps is None
        assert only(printout(fix=("0000.000", "00000.000"))).gps is None

    def test_weekday_betrays_a_garbled_date(self):
        log = read_dialog(printout().replace("May  4 12", "May  6 12"))
        assert math.isnan(log.latest.time) and log.latest.gps.age == 30.0
        assert math.isnan(log.latest.gps.time) and count(log, "undated printout") == 1
        assert only(printout().replace("Tue May", "T~e May")).time == MOMENT

    def test_undated_printout_joins_its_surfacing_and_yields_to_dated_data(self):
        lost = (
            printout(MOMENT + 60.0).replace("Curr Time", "C#rr T").replace("=14.75", "=13.75")
            + "GliderDos N -1 >\n"
        )
        one = only(printout() + lost)
        assert one.dumps == 2 and one.battery_voltage.value == 14.75 and not one.in_mission

    def test_clock_against_both_neighbours_is_mended(self):
        texts = [printout(MOMENT + 60.0 * i) for i in range(3)]
        log = read_dialog(texts[0] + texts[1].replace("12:31:00", "17:31:00") + texts[2])
        assert len(log.surfacings) == 1 and count(log, "mended clock") == 1
        assert log.latest.time == MOMENT + 120.0

    def test_lines_out_of_order_or_joined(self):
        lines = printout().splitlines()
        lines[4], lines[5] = lines[5], lines[4]
        assert only("\n".join(lines) + "\n").gps.time == MOMENT - 30.0
        assert only(printout().replace("secs ago\n", "secs ago")).gps is not None
        split = printout().replace("5412.345 N -1023", "5412.345 N\r\n -1023")
        assert only(split).gps.latitude == pytest.approx(FIX[0])

    def test_noise_between_lines(self):
        noise = ":OOD:digifin_mgr_ctrl:OUT OF DEADBAND: M_FIN:-0.0318 C_FIN:0.0000\n~\xfe\xff\n"
        clean = only(printout())
        assert only("".join(line + "\n" + noise for line in printout().splitlines())) == clean

    def test_a_garbled_unit_is_no_reading(self):
        one = only(
            printout()
            .replace("(amp-hrs)=100.5", "(amp=hrs)=100.5")
            .replace("c_wpt_lat(lat)", "c_wpt_lat(la)")
        )
        assert one.charge_used is None and "c_wpt_lat" not in one.sensors and one.battery_voltage is not None

    def test_a_number_cut_by_a_line_break_is_no_number(self):
        one = only(printout().replace("=100.5 ", "=100\n.5 "))
        assert one.charge_used is None


class TestGliders:
    def test_two_gliders_are_told_apart(self):
        other = printout(
            MOMENT + 30.0, vehicle="kelp8", number="kelp8-2027-123-0-9", fix=("6000.000", "00100.000")
        )
        log = read_dialog(printout() + other)
        assert log.vehicles == ("kelp7", "kelp8") and len(log.surfacings) == 2
        mine = read_dialog(printout() + other, vehicle="KELP7")
        assert [s.gps.latitude for s in mine.surfacings] == pytest.approx([FIX[0]])
        assert count(mine, "other glider") == 1

    def test_a_garbled_name_is_no_other_glider(self):
        texts = [printout(MOMENT + 60.0 * i) for i in range(3)]
        log = read_dialog(texts[0] + texts[1].replace("kelp7", "ke|p7").replace("kelp7", "kemp7") + texts[2])
        assert log.vehicles == ("kelp7",) and len(log.surfacings) == 1

    def test_words_of_the_glider_are_printable_and_short(self):
        one = only(printout().replace("no comms for a while", "\x1b[31m<script>\u202e" + "x" * 150))
        assert one.reason.isprintable() and one.reason.isascii() and len(one.reason) <= 200

    def test_text_never_names_a_file(self, tmp_path):
        (tmp_path / "a.log").write_text(printout())
        assert read_dialog(str(tmp_path / "a.log")).surfacings == ()
        assert len(read_dialog(tmp_path / "a.log").surfacings) == 1
        for missing in (tmp_path / "none.log", tmp_path, Path("a\0b")):
            with pytest.raises(DataError, match="expected a dialog log"):
                read_dialog(missing)


class TestReplayOfAMission:
    def test_until_uses_nothing_later(self):
        first, second = printout(), printout(MOMENT + 7200.0, number="kelp7-2027-123-0-42", inflections=126)
        then = read_dialog(first + second).until(MOMENT + 7199.0)
        assert then.surfacings == read_dialog(first).surfacings
        changed = second.replace("5412.345", "5513.999").replace("=14.75", "=11.25")
        assert read_dialog(first + changed).until(MOMENT + 7199.0).surfacings == then.surfacings
        assert read_dialog(first + second).until(MOMENT - 1.0).surfacings == ()


class TestRealLogs:
    @pytest.mark.parametrize(
        ("name", "surfacings", "printouts", "fixes"),
        [
            ("01660000.mlg", 0, 0, 0),
            ("01670000.mlg", 0, 0, 0),
            ("01680000.mlg", 1, 5, 3),
            ("01690000.mlg", 0, 0, 0),
            ("01720000.mlg", 1, 1, 1),
            ("01760000.mlg", 0, 0, 0),
            ("ZOCTerminal_Log_Calanus.txt", 2, 6, 3),
        ],
    )
    def test_counts(self, real, name, surfacings, printouts, fixes):
        log = read_dialog(real("live", "swfsc_terminal_logs", name))
        assert len(log.surfacings) == surfacings
        assert sum(s.dumps for s in log.surfacings) == printouts
        assert sum(len(s.fixes) for s in log.surfacings) == fixes
        assert set(log.vehicles) <= {"calanus"} and not any(s.in_mission for s in log.surfacings)

    @pytest.mark.parametrize(
        ("name", "readings"),
        [("ZOCTerminal_Log_Calanus.txt", 158), ("01680000.mlg", 108), ("01720000.mlg", 0)],
    )
    def test_no_reading_of_a_printout_is_lost(self, real, name, readings):
        """Counted by one plain search: readings with an age, lines in all, lines never set."""
        path = real("live", "swfsc_terminal_logs", name)
        text, log = path.read_bytes(), read_dialog(path)
        plain = re.findall(rb"sensor:\w+\([^)]*\)=\S+ +\d[\d.]* secs ago", text)
        assert sum(len(d.sensors) for d in log.dumps) == len(plain) == readings
        lines = sum(len(d.sensors) + len(d.defaults) + len(d.positions) for d in log.dumps)
        unset = text.count(b"69696969.000 E")
        assert lines + unset == text.count(b"secs ago")

    def test_terminal_log_data(self, real):
        first, second = read_dialog(
            real("live", "swfsc_terminal_logs", "ZOCTerminal_Log_Calanus.txt")
        ).surfacings
        assert first.time == 1787091121.0 and first.gps is None
        assert (
            first.invalid.latitude == pytest.approx(32.87) and first.charge_used.value == 170.659932 * 3600.0
        )
        assert first.water_velocity is None and "m_gps_mag_var" not in first.sensors
        assert second.gps.latitude == pytest.approx(32.0 + 52.216 / 60.0)
        assert second.gps.longitude == pytest.approx(-(117.0 + 15.066 / 60.0))
        assert second.gps.age == pytest.approx(2.965, abs=1e-3)
        assert second.magnetic_variation.value == pytest.approx(-0.2077, abs=2e-3)
        assert len([n for n in first.sensors if n in PRINTED]) == 16
        assert first.evidence == second.evidence == "GliderLAB prompt"

    def test_relative_charge_follows_the_counter(self, real):
        one = read_dialog(real("live", "swfsc_terminal_logs", "01680000.mlg")).latest
        used, left = one.charge_used.value / 3600.0, one.relative_charge.value
        assert left == pytest.approx(1.0 - used / 300.0, abs=1e-5)

    def test_composed_block_at_every_truncation(self, real):
        raw = real("live", "composed", "inmission_surfacing_COMPOSED.txt").read_bytes()
        whole = read_dialog(raw).latest
        assert whole.in_mission and len(whole.sensors) == 12 and whole.start_when == 12.0
        assert whole.waypoint.range == pytest.approx(347.0, abs=1.0)
        assert math.degrees(whole.waypoint.bearing) == pytest.approx(233.75, abs=0.1)
        assert whole.charge_used.value == 170.659932 * 3600.0
        done = raw.index(b"64.746 secs ago") + len(b"64.746 secs ago")
        for cut in range(len(raw) + 1):
            one = read_dialog(raw[:cut]).latest
            assert (one is not None and one.gps is not None) == (cut >= done), cut
            if cut >= done:
                assert one.gps == whole.gps


PRINTED = (
    "m_battery m_bms_aft_current m_bms_ebay_current m_bms_pitch_current m_coulomb_amphr m_coulomb_amphr_total m_depth "
    "m_digifin_leakdetect_reading m_leakdetect_voltage m_leakdetect_voltage_forward m_leakdetect_voltage_science "
    "m_lithium_battery_relative_charge m_tot_num_inflections m_vacuum m_veh_temp m_free_heap"
).split()


def test_geodesic_against_known_lines():
    """One degree along the equator and along the meridian of WGS84, and a long line of the 1975 paper's kind."""
    assert range_and_bearing(0.0, 0.0, 0.0, 1.0) == pytest.approx((111319.491, math.pi / 2.0), abs=2e-3)
    assert range_and_bearing(0.0, 5.0, 1.0, 5.0) == pytest.approx((110574.389, 0.0), abs=2e-3)
    assert range_and_bearing(10.0, 179.9, 10.0, -179.9)[0] == pytest.approx(21927.8, abs=1.0)
    assert range_and_bearing(3.0, 4.0, 3.0, 4.0) == (0.0, 0.0)
    for here in ((90.0, 0.0), (0.0, 0.0), (-45.0, 180.0)):
        for there in ((-90.0, 10.0), (0.0, 180.0), (45.0, 0.0), (0.2, 179.7)):
            length, bearing = range_and_bearing(*here, *there)
            assert 0.0 <= length < 2.01e7 and 0.0 <= bearing <= 2 * math.pi
