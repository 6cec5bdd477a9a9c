"""Names with commands in them, forecasts in which nothing happens, files cut short: products stay readable."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
from rich.console import Console

from glider_jax.errors import DataError, Outcome
from glider_jax.products.fan import level_lines, plot_battery
from glider_jax.products.geojson import read_polygons, write_geojson
from glider_jax.products.kml import kml_text
from glider_jax.products.maps import plot_map
from glider_jax.products.netcdf import NetcdfWriter, partial_path, write_netcdf
from glider_jax.products.summary import summarise
from glider_jax.products.tables import print_summary
from glider_jax.products.wording import drawn, one_line
from tests.products.tracks import end_members, gaussian_track, take

KML = "{http://www.opengis.net/kml/2.2}"
EVENTS = [f"{event}_{part}" for event in ("surfacing", "dive") for part in ("time", "latitude", "longitude")]
SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]


def nothing_happens(n=60):
    """No waypoints, no surfacings."""
    empty = np.zeros((n, 0))
    return replace(
        gaussian_track(n=n, hours=24.0), waypoints=np.zeros((0, 2)), waypoint_time=empty,
        surfacing_reason=empty.astype(np.int8), **dict.fromkeys(EVENTS, empty),
    )  # fmt: skip


@pytest.mark.parametrize(
    "track",
    [
        pytest.param(nothing_happens(), id="nothing happens"),
        pytest.param(gaussian_track(n=1, hours=24.0), id="one member"),
        pytest.param(gaussian_track(n=3, hours=24.0), id="three members"),
        pytest.param(end_members(gaussian_track(n=60, hours=24.0), np.arange(60), Outcome.AGROUND, 0.0), id="aground"),
        pytest.param(gaussian_track(n=60, hours=24.0, longitude=179.98, latitude=-20.0), id="antimeridian"),
        pytest.param(gaussian_track(n=60, hours=6.0, latitude=85.0), id="high latitude"),
    ],
)
def test_every_product_of_every_forecast_is_written(track, tmp_path, capsys):
    summary = summarise(track)
    json.dumps(summary, allow_nan=False)
    plot_map(track, tmp_path / "map.png", summary=summary)
    plot_battery(track, tmp_path / "battery.png", summary=summary)
    ElementTree.fromstring(kml_text(track, summary))
    json.loads(write_geojson(track, summary, tmp_path / "f.geojson").read_text())
    print_summary(summary, Console(width=100))
    assert "Forecast of" in capsys.readouterr().out
    with netCDF4.Dataset(write_netcdf(track, tmp_path / "f.nc")) as data:
        assert data.getncattr("complete") == 1 and len(data.dimensions["member"]) == track.n
        if not track.surfacing_time.shape[1]:
            assert np.ma.getmaskarray(data["surfacing_lat"][:]).all()


def test_commands_in_names_reach_no_viewer(tmp_path, capsys):
    odd = "a\x01$x_{$b\x1b[31m<b>&]]>"
    track = gaussian_track(n=60, hours=24.0)
    track = replace(
        track, settings=track.settings | {"mission": odd, "vehicle": odd}, notes=(odd, "[b]x"), reasons=(odd, "b", "c"),
        components=(odd, *track.components[1:]),
    )  # fmt: skip
    summary = summarise(track) | {"areas": [{"name": odd, "probability": 0.5}]}
    root = ElementTree.fromstring(kml_text(track, summary))
    assert not any("\x1b" in (node.text or "") for node in root.iter())
    described = [node.text for node in root.iter(f"{KML}description")]
    assert any("&lt;b&gt;" in text for text in described) and not any("<b>" in text for text in described)
    print_summary(summary, Console(width=100))
    out = capsys.readouterr().out
    assert [line for line in out.splitlines() if not line.isprintable()] == []
    assert "[b]x" in out
    # Warnings are errors here: a glyph that no font has, or half a formula, would raise.
    plot_battery(track, tmp_path / "battery.png", summary=summary)
    plot_map(track, tmp_path / "map.png", summary=summary)
    write_netcdf(track, tmp_path / "f.nc")


def test_text_is_brought_to_one_line():
    assert one_line(" a\n b\x1b\u2028c\ud800 ") == "a b c"
    assert one_line("x" * 50, 10) == "x" * 9 + "…"
    assert drawn("$5") == r"\$5"


def test_nothing_in_a_viewer_spans_the_globe():
    track = gaussian_track(n=300, hours=24.0, longitude=179.98, latitude=-20.0)
    root = ElementTree.fromstring(kml_text(track, summarise(track)))
    found = list(root.iter(f"{KML}coordinates"))
    assert len(found) > 50
    for node in found:
        longitude = np.array([float(point.split(",")[0]) for point in node.text.split()])
        assert np.ptp(longitude) < 5.0 and np.abs(longitude).max() <= 180.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"type": "FeatureCollection", "features": 5}', "list as 'features'"),
        ('{"type": "GeometryCollection", "geometries": true}', "list as 'geometries'"),
        ('{"type": "Polygon", "coordinates": [[[1' + "0" * 400 + ", 0], [1, 0], [1, 1], [0, 0]]]}", "rings"),
        ('{"type": "Polygon", "coordinates": [[[NaN, 0], [1, 0], [1, 1], [0, 0]]]}', "rings"),
        ('{"type": ["Polygon"]}', "GeoJSON type"),
        ('{"type": "Feature", "geometry": 7}', "object"),
        ("[" * 100_000, "GeoJSON"),
    ],
)
def test_odd_areas_are_explained(tmp_path, text, says):
    path = tmp_path / "a.geojson"
    path.write_text(text)
    with pytest.raises(DataError, match=says):
        read_polygons(path)


def test_areas_from_other_systems_are_read(tmp_path):
    path = tmp_path / "a.geojson"
    shape = {"type": "Polygon", "coordinates": [[[x, y, 12.5] for x, y in SQUARE]]}
    content = {"type": "Feature", "id": {"odd": 1}, "properties": None, "geometry": shape}
    path.write_text("\ufeff" + json.dumps(content), encoding="utf-8")
    (area,) = read_polygons(path)
    assert area.name == "area 1" and area.rings[0].tolist() == SQUARE


def test_blocks_of_another_width_are_refused_and_leave_nothing(tmp_path):
    track = gaussian_track(n=20, hours=24.0)
    fewer = replace(track, surfacing_reason=track.surfacing_reason[:, :3],
                    **{name: getattr(track, name)[:, :3] for name in EVENTS})  # fmt: skip
    with pytest.raises(DataError, match="surfacings"), NetcdfWriter(tmp_path / "f.nc", members=40) as writer:
        writer.append(track)
        writer.append(fewer)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_lacks_members_keeps_its_partial_name(tmp_path):
    track = gaussian_track(n=20, hours=24.0)
    with NetcdfWriter(tmp_path / "f.nc", members=40) as writer:
        writer.append(take(track, slice(0, 20)))
    assert writer.written == partial_path(tmp_path / "f.nc") and not (tmp_path / "f.nc").exists()


def test_the_dates_of_charge_levels_are_told_from_those_beyond_the_forecast():
    drained = summarise(gaussian_track(n=300, hours=84.0, powers=(1.9, 0.9, 0.5)))["battery"]["levels"][0]
    full = summarise(gaussian_track(n=300, hours=24.0, powers=(1.9, 0.9, 0.5)))["battery"]["levels"][0]
    assert level_lines(drained)[0].startswith("20 % left: 77") and "extrapolated" not in " ".join(level_lines(drained))
    assert level_lines(full)[0] == "20 % left" and "(extrapolated)" in level_lines(full)[1]
    # 0.8 of 1.2 MJ at 3.3 W.
    assert drained["within_forecast"]["hours"]["median"] == pytest.approx(0.8 * 1.2e6 / 3.3 / 3600.0, rel=0.01)
    assert full["extrapolated"]["hours"]["median"] == pytest.approx(0.8 * 1.2e6 / 3.3 / 3600.0, rel=0.01)


def test_a_reserve_given_to_the_chart_is_the_one_drawn(tmp_path):
    track = gaussian_track(n=100, hours=24.0)
    summary = summarise(track)
    one = plot_battery(track, tmp_path / "one.png", summary=summary).read_bytes()
    two = plot_battery(track, tmp_path / "two.png", summary=summary, reserve=0.4).read_bytes()
    assert one != two and plot_battery(track, tmp_path / "three.png", summary=summary).read_bytes() == one
