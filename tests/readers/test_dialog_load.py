"""Dialogs under load: time in proportion to the length, and no input that breaks the reader."""

from __future__ import annotations

import math
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.readers.dialogs import read_dialog
from tests.readers.dialog_layouts import MOMENT, printout


class TestSpeed:
    """Reading takes time in proportion to the length, whatever the text."""

    @pytest.mark.parametrize(
        "piece",
        [
            "sensor:",
            "sensor:a(",
            "sensor:m_a(b)=1 ",
            "sensor:m_a(b)=" + "1" * 30,
            "GPS Location: ",
            "GPS Location: 1 N 1 E measured ",
            "Because:",
            "Because:[behavior a start_when = ",
            "Curr Time: Tue May ",
            "Waypoint: (1,1) Range: ",
            "ABORT HISTORY: total since reset: ",
            " " * 64,
            "9" * 64,
            "secs ago",
            "\t1 sensor: a = 1 ",
            "Vehicle Name: a",
            "GliderDos A ",
            "a",
        ],
    )
    def test_a_line_of_a_megabyte(self, piece):
        text = piece * (1_000_000 // len(piece))
        begin = time.process_time()
        read_dialog(text)
        spent = time.process_time() - begin
        assert spent < 5.0, f"{spent:.1f} s for {piece!r}"

    @pytest.mark.parametrize(
        "line",
        [
            lambda i: f"Vehicle Name: g{i}\nCurr Time: Tue May  4 12:30:00 2027 MT: 5\n",
            lambda i: f"Vehicle Name: g{i}\nGPS Location: 5412.345 N -1023.456 E measured {i} secs ago\n",
            lambda i: f"MissionName:a MissionNum:g-2027-123-0-{i} (1.1)\n",
            lambda i: (
                f"MissionName:a MissionNum:g-2027-123-0-{i % 7} (1.1)\nGPS Location: 1 N 1 E measured {i} secs ago\n"
            ),
            lambda i: (
                f"Curr Time: Tue May  4 12:30:00 2027 MT: {i}\nGPS Location: 1 N 1 E measured {9 * i} secs ago\n"
            ),
            lambda i: (
                f"Curr Time: Tue May  4 12:{i % 60:02d}:00 2027 MT: {i}\nBecause:b{i}\nRESUMING MISSION\n"
            ),
            lambda i: "Curr Time: Tue May  4 12:30:00 2027 MT: 5\nBecause:b\nBecause:c\n",
        ],
    )
    def test_many_printouts(self, line):
        text = "".join(line(i) for i in range(8000))
        begin = time.process_time()
        read_dialog(text)
        spent = time.process_time() - begin
        assert spent < 5.0, f"{spent:.1f} s"

    def test_many_lines(self):
        text = "".join(printout(MOMENT + 60.0 * i, sensors=False) for i in range(500))
        begin = time.process_time()
        one = read_dialog(text).latest
        assert one.dumps == 500 and time.process_time() - begin < 5.0


class TestFuzz:
    @settings(max_examples=200, deadline=None)
    @given(st.binary(max_size=400))
    def test_any_bytes(self, raw):
        read_dialog(raw)

    @settings(max_examples=200, deadline=None)
    @given(st.text(max_size=300))
    def test_any_text(self, text):
        read_dialog(text)

    @settings(max_examples=200, deadline=None)
    @given(
        st.lists(st.tuples(st.integers(0, 1800), st.integers(0, 1800), st.binary(max_size=6)), max_size=8),
        st.booleans(),
    )
    def test_pieces_and_noise(self, cuts, twice):
        raw = printout().encode()
        parts = [raw[min(a, b) : max(a, b)] + noise for a, b, noise in cuts]
        log = read_dialog(b"".join(parts) * (2 if twice else 1))
        for one in log.surfacings:
            for fix in one.fixes:
                assert abs(fix.latitude) <= 90.0 and abs(fix.longitude) <= 180.0 and fix.age >= 0.0
            assert all(math.isfinite(d.value) and d.age >= 0.0 for d in one.sensors.values())

    @settings(max_examples=150, deadline=None)
    @given(st.integers(0, 1700), st.integers(0, 7))
    def test_one_flipped_bit_costs_at_most_one_datum_of_position(self, place, bit):
        raw = bytearray(printout().encode())
        raw[place % len(raw)] ^= 1 << bit
        log = read_dialog(bytes(raw))
        found = {f.latitude for s in log.surfacings for f in s.fixes} | {
            s.gps.latitude for s in log.surfacings if s.gps
        }
        assert len(found) <= 1
