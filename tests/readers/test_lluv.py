"""CODAR totals in LLUV text: the table, its quality control, the grid rebuilt from the listed cells, and refusals."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from glider_jax.errors import CoverageError, DataError
from glider_jax.readers.currents import read_currents
from glider_jax.readers.lluv import read_totals
from tests import layouts


def test_totals_come_out_on_their_grid(tmp_path):
    grid = read_currents(layouts.lluv_totals(tmp_path / "TOTL.tuv"), fill=False)
    assert grid.east.shape == (1, 1, 7, 9)
    east, north = layouts.truth(grid.time, grid.depth, grid.latitude, grid.longitude)
    known = np.isfinite(grid.east)
    missing = np.zeros_like(known)
    missing[:, :, :2, :2] = True
    missing[0, 0, 3, 3:6] = True
    assert np.array_equal(known, ~missing), "unlisted cells, and the flagged, the diluted and the fast one are gaps"
    assert np.abs(grid.east - east)[known].max() < 1e-5 and np.abs(grid.north - north)[known].max() < 1e-5
    assert np.nanmax(grid.east_sd) == pytest.approx(0.03) and np.nanmax(grid.north_sd) == pytest.approx(0.04)
    text = " ".join(grid.source.notes)
    assert "1 vectors flagged in VFLG" in text and "1 vectors with GDOP over 10" in text
    assert "1 vectors faster than 1 m/s" in text


def test_several_hours_join_though_each_lists_other_cells(tmp_path):
    for hour in (1, 0):
        path = layouts.lluv_totals(tmp_path / f"T{5 - hour}.tuv", hour)
        if hour:
            lines = path.read_text().splitlines()
            start = next(i for i, line in enumerate(lines) if line.startswith("%%"))
            path.write_text("\n".join(lines[: start + 1] + lines[start + 21 :]))
    grid = read_currents(tmp_path, fill=False)
    assert grid.time == pytest.approx(layouts.T0 + np.array([0.0, 3600.0]))
    assert np.isfinite(grid.east[0]).sum() == np.isfinite(grid.east[1]).sum() + 20
    east, _ = layouts.truth(grid.time, grid.depth, grid.latitude, grid.longitude)
    assert np.nanmax(np.abs(grid.east - east)) < 1e-5
    assert any("%TableRows says 59, the table has 39 rows" in note for note in grid.source.notes)


def test_local_time_and_start_marks_become_the_middle_in_utc(tmp_path):
    path = layouts.lluv_totals(tmp_path / "a.tuv", 6)
    text = path.read_text().replace('%TimeZone: "UTC" +0.000 0 "UTC"', '%TimeZone: "EST" -5.000 0 "EST"')
    path.write_text(text)
    assert read_totals(path).time == layouts.T0 + 11 * 3600.0
    path.write_text(text.replace("%TimeCoverage", "%TimeMarks: start\n%TimeCoverage"))
    assert read_totals(path).time == layouts.T0 + 11 * 3600.0 + 37.5 * 60.0


def test_only_the_first_table_is_read(tmp_path):
    path = layouts.lluv_totals(tmp_path / "a.tuv")
    path.write_text(path.read_text().replace('%      1   "AAAA"', "      1.0  2.0  3.0 4.0 5.0 6.0 7.0 8.0 9.0\n%"))
    assert read_totals(path).lon.max() < -70.0


def test_grids_that_shift_from_row_to_row_go_to_the_nearest_cell(tmp_path):
    path = layouts.lluv_totals(tmp_path / "a.tuv")
    rows = []
    for line in path.read_text().splitlines():
        words = line.split()
        if words and not line.startswith("%"):
            # Equal kilometres instead of equal degrees: every row has its own longitudes.
            words[0] = f"{-74.2 + (float(words[0]) + 74.2) * (1 + 0.02 * (float(words[1]) - 38.5)):.7f}"
            line = "  ".join(words)
        rows.append(line)
    path.write_text("\n".join(rows))
    grid = read_currents(path, fill=False)
    assert grid.longitude.size <= 11 and np.isfinite(grid.east).sum() == 56
    assert any("vectors were moved" in note for note in grid.source.notes) or grid.longitude.size == 9


def test_refusals(tmp_path):
    path = layouts.lluv_totals(tmp_path / "a.tuv")
    text = path.read_text()
    cases = {
        "radial.ruv": (text.replace("LLUV tots", "LLUV rdls"), "a map of radials"),
        "ellipse.euv": (text.replace("LLUV tots", "LLUV elps"), "a map of elliptical vectors"),
        "wave.wls": (text.replace('LLUV tots "CurrentMap"', 'WVMD WVM9 "Wave History"'), "a record of waves"),
        "columns.tuv": (text.replace("VELU VELV", "AELU AELV"), "TableColumnTypes: expected LOND"),
        "number.tuv": (text.replace("%TableEnd", "  1.0 2.0 oops 4 5 6 7 8 9\n%TableEnd", 1), "row 60 of the table"),
        "short.tuv": (text[: text.index("%TableEnd")], "expected %TableEnd"),
        "none.tuv": (text.replace("%TableStart:", "%Start"), "expected a table after %TableStart"),
        "stamp.tuv": (text.replace("2019 01 01  00 00 00", "yesterday"), "YYYY MM DD HH MM SS"),
    }
    for name, (content, message) in cases.items():
        (tmp_path / name).write_text(content)
        with pytest.raises(DataError, match=message):
            read_currents(tmp_path / name)
    (tmp_path / "slow.tuv").write_text(text.replace("Limit: 100.0", "Limit: 0.1"))
    with pytest.raises(CoverageError, match="no vector left"):
        read_currents(tmp_path / "slow.tuv")


def test_real_totals(real):
    path = real("environment", "codar_lluv", "TOTL_CATS_2024_07_01_0100.tuv")
    grid = read_currents(path, fill=False)
    # An independent parse: the lines between the first table start and end that are no comments.
    text = path.read_text().split("%TableStart:")[1].split("%TableEnd:")[0]
    table = np.array(
        [[float(w) for w in line.split()] for line in text.splitlines() if line.strip() and line[0] != "%"]
    )
    assert table.shape == (1553, 16)
    keep = (table[:, 4] == 0) & (table[:, 10] <= 10) & (np.hypot(table[:, 2], table[:, 3]) <= 100)
    assert np.isfinite(grid.east).sum() == keep.sum() == 1553 - 28
    assert grid.time[0] == datetime(2024, 7, 1, 1, tzinfo=UTC).timestamp()
    for lon, lat, u, v, su in table[keep][::97][:, [0, 1, 2, 3, 7]]:
        j, i = np.abs(grid.latitude - lat).argmin(), np.abs(grid.longitude - lon).argmin()
        assert abs(grid.latitude[j] - lat) < 2e-4 and abs(grid.longitude[i] - lon) < 2e-4
        assert grid.east[0, 0, j, i] == pytest.approx(u / 100) and grid.north[0, 0, j, i] == pytest.approx(v / 100)
        assert grid.east_sd[0, 0, j, i] == pytest.approx(su / 100)
    assert np.nanmax(np.hypot(grid.east, grid.north)) <= 1.0


def test_real_radials_are_no_currents(real):
    with pytest.raises(DataError, match="projections on the line to the radar"):
        read_currents(real("environment", "codar_lluv", "RDLi_SEAB_2019_01_01_0000.ruv"))
