"""Dockserver states, and the newest evidence of dialogs, states and recordings together."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.errors import DataError
from glider_jax.readers.dialogs import read_dialog
from glider_jax.readers.geodesy import range_and_bearing
from glider_jax.readers.glider_state import read_glider_state
from glider_jax.readers.live_state import NoFix, RecordedFixes, StaleFix, latest_state
from tests.readers.dialog_layouts import MOMENT, printout, state_file

HERE, THERE = (" 5412.000", "-1020.000"), (" 5413.000", "-1020.500")
WAYPOINT = (
    "<dataParameter><name>Next waypoint coordinates</name><value>(5412.0000,-1022.0000)</value></dataParameter>"
    "<dataParameter><name>Next waypoint range</name><value>2172m</value></dataParameter>"
    "<dataParameter><name>Next waypoint bearing</name><value>262deg</value></dataParameter>"
)
REPORTS = [
    (MOMENT, None, "", ""),
    (MOMENT + 100.0, MOMENT + 40.0, *HERE),
    (MOMENT + 160.0, MOMENT + 41.0, *HERE),
    (MOMENT + 220.0, MOMENT + 39.0, *HERE),
    (MOMENT + 8000.0, MOMENT + 7900.0, *THERE),
]


def state(reports=REPORTS, waypoint=WAYPOINT, **keywords):
    return read_glider_state(state_file(reports, waypoint).encode(), **keywords)


class TestState:
    def test_one_fix_is_one_report_whatever_its_second(self):
        found = state()
        assert len(found.reports) == 3 and [r.count for r in found.reports] == [1, 3, 1]
        assert len(found.fixes) == 2 and len(found.surface_times) == 5
        assert found.fixes[0].time == MOMENT + 39.0 and found.fixes[1].age == 100.0
        assert found.reports[1].first_surface_time == MOMENT + 100.0
        assert found.reports[1].surface_time == MOMENT + 220.0

    def test_degrees_and_hemisphere(self):
        fix = state().fixes[1]
        assert (fix.latitude, fix.longitude) == pytest.approx((54.0 + 13.0 / 60.0, -(10.0 + 20.5 / 60.0)))
        assert state().reports[0].gps is None

    def test_waypoint_is_as_old_as_the_position_it_was_measured_from(self):
        w = state().waypoint
        assert w.printed_range == 2172.0 and math.degrees(w.printed_bearing) == pytest.approx(262.0)
        assert w.age == 8000.0 - 220.0
        assert range_and_bearing(54.2, -10.0 - 20.0 / 60.0, w.latitude, w.longitude)[0] == pytest.approx(
            2172.0, abs=5.0
        )
        assert math.isnan(state(waypoint=WAYPOINT.replace("2172m", "99km")).waypoint.age)
        assert state(waypoint=WAYPOINT.replace("(5412.0000,-1022.0000)", "(0.0,0.0)")).waypoint is None

    def test_last_abort(self):
        abort = state().last_abort
        assert (abort.cause, abort.mission, abort.time) == ("MS_ABORT_STALLED", "deep.mi", 1809140645.0)
        none = (
            state_file(REPORTS)
            .replace('cause="MS_ABORT_STALLED"', 'cause=""')
            .replace("2027-05-01T", "1970-01-01T")
        )
        assert read_glider_state(none.encode()).last_abort is None

    def test_half_a_file_gives_its_complete_reports(self):
        text = state_file(REPORTS, WAYPOINT)
        ends = [i + len("</report>") for i in range(len(text)) if text.startswith("</report>", i)]
        for cut in range(text.index("<gliderState") + 20, len(text), 7):
            found = read_glider_state(text[:cut].encode())
            assert len(found.surface_times) == sum(end <= cut for end in ends)
            assert any(r.kind == "half a file" for r in found.repairs) == (cut < len(text))

    def test_impossible_values_are_counted(self):
        found = state([(MOMENT, MOMENT - 5.0, "9912.000", "-1020.000"), (MOMENT + 9.0, MOMENT, *HERE)])
        assert len(found.fixes) == 1 and [(r.kind, r.count) for r in found.repairs][0] == (
            "impossible value",
            1,
        )

    def test_until(self):
        then = state().until(MOMENT + 200.0)
        assert len(then.fixes) == 1 and then.surface_times[-1] == MOMENT + 160.0 and then.waypoint is None
        later = [*REPORTS[:-1], (MOMENT + 9000.0, MOMENT + 8900.0, "6000.000", "100.0")]
        assert state(later).until(MOMENT + 200.0).fixes == then.fixes
        assert state(later).until(MOMENT + 200.0).reports == then.reports == state(REPORTS[:3]).reports

    def test_errors_say_what_to_do(self, tmp_path):
        with pytest.raises(DataError, match="expected a dockserver state with <gliderState>"):
            read_glider_state(printout().encode())
        with pytest.raises(DataError, match="Check the path"):
            read_glider_state(tmp_path / "none.xml")

    @settings(max_examples=150, deadline=None)
    @given(st.binary(max_size=200), st.integers(0, 2200), st.integers(0, 2200))
    def test_any_bytes(self, noise, low, high):
        text = state_file(REPORTS, WAYPOINT).encode()
        read_glider_state(b"<gliderState>" + noise + text[min(low, high) : max(low, high)] + noise)

    @pytest.mark.parametrize(
        "piece",
        ["<report>", "<valid_location><lat>", "<name>", "<lastAbort ", "<lastAbort a=", "(1,", "</report>"],
    )
    def test_a_line_of_a_megabyte(self, piece):
        begin = time.process_time()
        read_glider_state(b"<gliderState>" + piece.encode() * (1_000_000 // len(piece)))
        assert time.process_time() - begin < 5.0

    def test_real_state(self, real):
        found = read_glider_state(real("live", "dockserver", "gliderState_dfo-maria997.xml"))
        assert len(found.surface_times) == 218 and len(found.fixes) == 49 and len(found.reports) == 50
        assert found.fixes[-1].time == 1655410749.0 and found.fixes[-1].age == 166.0
        assert found.last_abort is None and found.waypoint.printed_range == 1313.0
        assert found.fixes[0].latitude == pytest.approx(48.0 + 39.153 / 60.0)
        assert found.fixes[0].longitude == pytest.approx(-(123.0 + 26.982 / 60.0))

    def test_printed_bearing_of_the_real_state_is_not_true(self, real):
        """72 degrees are printed where the true bearing is 90: the local variation is 16 to 17 degrees."""
        found = read_glider_state(real("live", "dockserver", "gliderState_dfo-maria997.xml"))
        then = found.time - found.waypoint.age
        spot = next(r for r in found.reports if r.first_surface_time <= then <= r.surface_time)
        ways = [
            range_and_bearing(p.latitude, p.longitude, found.waypoint.latitude, found.waypoint.longitude)
            for p in (spot.gps, spot.dead_reckoned)
        ]
        length, bearing = min(ways, key=lambda w: abs(w[0] - 1313.0))
        assert length == pytest.approx(1313.0, abs=5.0)
        assert 15.0 < math.degrees(bearing) - math.degrees(found.waypoint.printed_bearing) < 19.0


class TestLatest:
    def test_newest_fix_wins_wherever_it_is_from(self):
        log = read_dialog(printout())
        early = RecordedFixes(
            np.array([MOMENT - 500.0, np.nan]), np.array([54.0, 1.0]), np.array([-10.0, 1.0])
        )
        late = RecordedFixes(
            np.array([MOMENT + 500.0, MOMENT + 400.0]), np.array([54.5, 54.4]), np.array([-10.0, -10.0])
        )
        one = latest_state([log, early])
        assert one.gps_source == "dialog" and one.gps.age == 30.0 and len(one.fixes) == 2
        two = latest_state([late, log, early])
        assert two.gps_source == "recording" and two.gps.latitude == 54.5 and two.now == MOMENT + 500.0
        assert two.surfacing.time == MOMENT and two.in_mission
        three = latest_state([log, state()])
        assert three.gps_source == "dockserver state" and three.gps.time == MOMENT + 7900.0

    def test_ages_are_at_now(self):
        one = latest_state([read_dialog(printout())], now=MOMENT + 600.0)
        assert one.gps.age == 630.0 and one.sensors["m_battery"].age == 605.5
        assert one.water_velocity.age == 670.75 and one.last_heard == MOMENT
        assert one.capacity.value == 550 * 3600.0

    def test_nothing_later_than_now_is_used(self):
        second = printout(MOMENT + 7200.0, number="kelp7-2027-123-0-42", inflections=126)
        fixes = RecordedFixes(np.array([MOMENT + 50.0]), np.array([55.0]), np.array([-11.0]))
        log = read_dialog(printout() + second)
        then = latest_state([log, fixes, state()], now=MOMENT)
        assert then.gps.time == MOMENT - 30.0 and then.surfacing.mission_number.endswith("41")
        assert "1 printouts" in then.notes[0] and then.waypoint.printed_range == 8765.0
        assert then.fixes == latest_state([read_dialog(printout())], now=MOMENT).fixes

    def test_two_logs_of_one_surfacing_count_once(self):
        terminal = read_dialog(printout(number=None, menu=False) + "GliderLAB I -3 >\n")
        mission_log = read_dialog(printout(number=None, menu=False))
        for pair in ([terminal, mission_log], [mission_log, terminal]):
            one = latest_state(pair)
            assert one.state == "not in mission" and one.surfacing.dumps == 1 and not one.in_mission

    def test_no_fix_stale_fix_and_unknown_age(self):
        unset = printout(fix=("69696969.000", "69696969.000"))
        with pytest.raises(NoFix, match="kelp7: expected a GPS fix"):
            latest_state([read_dialog(unset)]).fix()
        with pytest.raises(NoFix):
            latest_state([]).fix()
        live = latest_state([read_dialog(printout())], now=MOMENT + 7200.0)
        assert live.fix().age == live.fix(7231.0).age == 7230.0
        with pytest.raises(StaleFix, match="found one whose age is 120 minutes") as caught:
            live.fix(3600.0)
        assert caught.value.age == 7230.0 and isinstance(caught.value, DataError)
        lost = latest_state([read_dialog(printout().replace("Curr Time", "Cu~r Time"))])
        assert lost.fix().latitude == pytest.approx(54.20575)
        with pytest.raises(StaleFix, match="unknown"):
            lost.fix(3600.0)

    def test_several_gliders_must_be_chosen(self):
        both = read_dialog(printout() + printout(MOMENT + 9.0, vehicle="kelp8", number="kelp8-2027-123-0-9"))
        with pytest.raises(DataError, match="kelp7, kelp8"):
            latest_state([both])
        assert latest_state([both], vehicle="kelp8").surfacing.time == MOMENT + 9.0

    def test_sensors_of_an_earlier_surfacing_stay_known(self):
        second = printout(MOMENT + 7200.0, number="kelp7-2027-123-0-42", sensors=False)
        one = latest_state([read_dialog(printout() + second)])
        assert one.sensors["m_battery"].age == 7205.5 and one.water_velocity.age == 7270.75
