"""Products of ensembles with known statistics: regions, summary, files."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
from rich.console import Console

from glider_jax.errors import DataError, Outcome
from glider_jax.products.atomic import atomic_path
from glider_jax.products.coordinates import frame_of
from glider_jax.products.fan import plot_battery
from glider_jax.products.geojson import read_polygons, write_geojson
from glider_jax.products.kml import write_kml
from glider_jax.products.maps import plot_map
from glider_jax.products.measures import NamedPolygon
from glider_jax.products.netcdf import NetcdfWriter, partial_path, write_netcdf
from glider_jax.products.regions import inside, regions
from glider_jax.products.summary import SummaryAccumulator, summarise
from glider_jax.products.tables import print_summary
from tests.products.tracks import end_members, gaussian_track, shelf, shelf_currents, take

CHI2 = {0.5: 1.3863, 0.9: 4.6052}


@pytest.fixture(scope="module")
def track():
    return gaussian_track(n=4000, hours=48.0)


@pytest.fixture(scope="module")
def summary(track):
    return summarise(track)


def _nothing_is_nan(value):
    text = json.dumps(value, allow_nan=False)
    return "NaN" not in text


def test_regions_of_a_normal_cloud_have_the_area_and_coverage_of_the_closed_form():
    rng = np.random.default_rng(0)
    sd = np.array([900.0, 2500.0])
    frame = frame_of(np.array([39.0]), np.array([-73.0]))
    points = frame.to_degrees(*(rng.normal(size=(2, 5000)) * sd[:, None]))
    fresh = frame.to_degrees(*(rng.normal(size=(2, 40_000)) * sd[:, None]))
    for region in regions(*points):
        exact = np.pi * CHI2[region.probability] * sd.prod()
        assert region.area == pytest.approx(exact, rel=0.08)
        share = inside(region, *fresh).mean()
        assert share == pytest.approx(region.probability, abs=0.03)


def test_regions_of_two_clouds_are_two_pieces():
    rng = np.random.default_rng(1)
    frame = frame_of(np.array([39.0]), np.array([-73.0]))
    x = rng.normal(size=4000) * 300.0 + np.where(np.arange(4000) % 2, 8000.0, -8000.0)
    found = regions(*frame.to_degrees(x, rng.normal(size=4000) * 300.0))
    assert all(len(region.polygons) == 2 for region in found)


def test_arrivals_speeds_and_energy_follow_the_cloud(track, summary):
    assert _nothing_is_nan(summary)
    t = track.time - track.time[0]
    first = summary["waypoints"][0]
    known = track.waypoint_time[:, 0]
    assert first["probability"] == pytest.approx(np.isfinite(known).mean())
    assert first["hours"]["median"] == pytest.approx(np.nanmedian(known - track.time[0]) / 3600.0, abs=0.02)
    over = summary["rates"]["km_per_day"]["over_ground"]["median"]
    assert over == pytest.approx(np.median(track.distance_over_ground[:, -1]) / t[-1] * 86.4, rel=1e-3)
    power = np.median(track.energy[:, -1].sum(-1)) / t[-1]
    assert summary["rates"]["wh_per_day"]["total"]["median"] == pytest.approx(power * 24.0, rel=1e-3)
    assert summary["surfacings"][0]["reasons"][0]["probability"] == pytest.approx(0.75, abs=1e-6)


def test_ended_members_are_counted_and_conditioned(track):
    ended = end_members(track, np.arange(1000), Outcome.AGROUND, 12 * 3600.0)
    found = summarise(ended)
    entry = next(e for e in found["outcomes"] if e["name"] == "AGROUND")
    assert entry["count"] == 1000 and entry["first"]["hours"] == pytest.approx(12.0)
    assert found["risks"]["grounding"] == pytest.approx(0.25)
    later = next(p for p in found["positions"] if p["hours"] == 24)
    assert later["share_active"] == pytest.approx(0.75)


def test_blocks_give_the_same_summary(track, summary):
    parts = SummaryAccumulator()
    for k in range(0, track.n, 700):
        parts.add(take(track, slice(k, k + 700)))
    joined = parts.result()
    for key in ("outcomes", "waypoints", "rates", "battery", "boxes", "risks"):
        assert joined[key] == summary[key], key
    for one, two in zip(joined["surfacings"], summary["surfacings"], strict=True):
        assert one["time"] == two["time"] and one["reasons"] == two["reasons"]
        # The smoothing grid is laid out from the first block.
        for a, b in zip(one["regions"], two["regions"], strict=True):
            assert a["area_km2"] == pytest.approx(b["area_km2"], rel=0.05)


def test_counts_on_grids_come_close_to_the_exact_summary(track, summary):
    rough = SummaryAccumulator(limit=500)
    for k in range(0, track.n, 500):
        rough.add(take(track, slice(k, k + 500)))
    found = rough.result()
    assert not found["forecast"]["exact"]
    exact, close = summary["waypoints"][0]["hours"], found["waypoints"][0]["hours"]
    assert close["median"] == pytest.approx(exact["median"], abs=0.3)
    for one, two in zip(summary["surfacings"][0]["regions"], found["surfacings"][0]["regions"], strict=True):
        assert two["area_km2"] == pytest.approx(one["area_km2"], rel=0.15)


def test_entering_an_area(track):
    end = track.latitude[:, -1].mean(), track.longitude[:, -1].mean()
    ring = np.array([[x, y] for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))], float)
    near = NamedPolygon("near", (ring * 0.5 + [end[1], end[0]],))
    far = NamedPolygon("far", (ring * 0.1 + [end[1] + 20, end[0] + 20],))
    areas = summarise(track, polygons=(near, far))["areas"]
    assert areas[0]["probability"] > 0.95 and areas[1]["probability"] == 0.0


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # the checker's own
def test_netcdf_passes_the_checker(track, tmp_path):
    runner = pytest.importorskip("compliance_checker.runner")
    units = {"parameter_units": {name: "1" for name in track.parameters}}
    block = replace(take(track, slice(0, 50)), settings=track.settings | units)
    path = write_netcdf(block, tmp_path / "f.nc")
    runner.CheckSuite.load_all_available_checkers()
    for name in ("cf:1.10", "acdd:1.3"):
        report = tmp_path / f"{name.replace(':', '')}.json"
        runner.ComplianceChecker.run_checker(
            str(path), [name], 0, "strict", output_filename=str(report), output_format="json"
        )
        result = next(iter(json.loads(report.read_text()).values()))
        failed = [(e["name"], message) for e in result["high_priorities"] for message in e["msgs"]]
        # The standard-name table has no names for charge, energy and counts.
        known = "standard_name" if name.startswith("acdd") else None
        assert not [entry for entry in failed if entry[1] != known], failed


def test_netcdf_holds_the_track(track, tmp_path):
    path = write_netcdf(track, tmp_path / "f.nc")
    with netCDF4.Dataset(path) as data:
        assert data.getncattr("complete") == 1 and "CF-1.10" in data.Conventions
        assert np.abs(data["lat"][:] - track.latitude).max() < 1e-6
        assert np.abs(data["lon"][:] - track.longitude).max() < 1e-6
        assert json.loads(data.getncattr("settings"))["seed"] == track.settings["seed"]
        flags = data["outcome"].flag_meanings.split()
        assert len(flags) == len(Outcome)


def test_netcdf_in_blocks_is_the_same_file(track, tmp_path):
    write_netcdf(track, tmp_path / "whole.nc")
    with NetcdfWriter(tmp_path / "parts.nc", members=track.n) as writer:
        for k in range(0, track.n, 1500):
            writer.append(take(track, slice(k, k + 1500)))
    with netCDF4.Dataset(tmp_path / "whole.nc") as one, netCDF4.Dataset(writer.written) as two:
        assert set(one.variables) == set(two.variables)
        for name in one.variables:
            a, b = np.ma.filled(one[name][:]), np.ma.filled(two[name][:])
            assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), name


def test_an_interrupted_run_leaves_a_partial_file_that_says_so(tmp_path):
    code = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from glider_jax.products.atomic import termination_raises\n"
        "from glider_jax.products.netcdf import NetcdfWriter\n"
        "from tests.products.tracks import gaussian_track\n"
        "track = gaussian_track(n=50, hours=12.0)\n"
        "with termination_raises(), NetcdfWriter(Path(sys.argv[1]), members=500) as writer:\n"
        "    writer.append(track)\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(60)\n"
    )
    path = tmp_path / "f.nc"
    with subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().strip() == "ready"
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 128 + signal.SIGTERM
    assert not path.exists()
    with netCDF4.Dataset(partial_path(path)) as data:
        assert data.getncattr("complete") == 0 and data.getncattr("members_written") == 50


def test_nothing_is_left_under_the_final_name_after_an_error(tmp_path):
    path = tmp_path / "x.json"
    path.write_text("old")
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:
        temporary.write_text("new")
        raise RuntimeError
    assert path.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["x.json"]


def test_geojson_follows_its_standard(track, summary, tmp_path):
    content = json.loads(write_geojson(track, summary, tmp_path / "f.geojson").read_text())
    kinds = {f["properties"]["kind"] for f in content["features"]}
    assert {"start", "waypoint", "surfacing", "surfacing region", "box", "median track"} <= kinds
    for feature in content["features"]:
        geometry = feature["geometry"]
        if geometry["type"] == "MultiPolygon":
            for polygon in geometry["coordinates"]:
                ring = np.array(polygon[0])
                assert np.array_equal(ring[0], ring[-1])
                x, y = ring.T
                assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0, "outer rings run counter-clockwise"
                assert np.abs(x).max() <= 180.0


def test_forecast_across_the_antimeridian(tmp_path):
    track = gaussian_track(n=800, hours=24.0, longitude=179.98, latitude=-20.0)
    found = summarise(track)
    assert _nothing_is_nan(found)
    content = json.loads(write_geojson(track, found, tmp_path / "f.geojson").read_text())
    for feature in content["features"]:
        flat = np.array(json.loads(json.dumps(feature["geometry"]["coordinates"])), dtype=object)
        assert flat.size
    plot_map(track, tmp_path / "m.png", summary=found)
    assert found["surfacings"][0]["regions"][1]["area_km2"] < 500.0


def test_kml_escapes_text_and_is_the_same_twice(track, summary, tmp_path):
    settings = summary["provenance"]["settings"] | {"mission": "<script>&\"'"}
    odd = summary | {"provenance": summary["provenance"] | {"settings": settings}}
    one, two = (write_kml(track, odd, tmp_path / f"{k}.kmz").read_bytes() for k in (1, 2))
    assert one == two
    with zipfile.ZipFile(tmp_path / "1.kmz") as archive:
        root = ElementTree.fromstring(archive.read("doc.kml"))
    names = [node.text for node in root.iter("{http://www.opengis.net/kml/2.2}name")]
    assert any("<script>&" in name for name in names)
    ElementTree.parse(write_kml(track, summary, tmp_path / "f.kml"))


def test_pictures_are_drawn(track, summary, tmp_path):
    floor = shelf()
    for path in (
        plot_map(track, tmp_path / "map.png", bathymetry=floor, currents=shelf_currents(floor), summary=summary),
        plot_battery(track, tmp_path / "battery.png", summary=summary),
    ):
        assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and path.stat().st_size > 20_000


def test_tables_fit_a_terminal_and_a_pipe(summary, capsys):
    for wide in (Console(width=80, force_terminal=True, color_system=None), Console(width=80)):
        print_summary(summary, wide)
        out = capsys.readouterr().out
        assert summary["surfacings"][0]["place"]["text"] in out
        assert "Wh" in out and "reserve" in out
        assert "…" not in out


def test_markup_in_names_is_not_interpreted(summary, capsys):
    odd = summary | {"notes": ["[bold]not markup[/bold] [link=x]y"], "areas": [{"name": "[red]a", "probability": 0.5}]}
    print_summary(odd, Console(width=120))
    out = capsys.readouterr().out
    assert "[bold]not markup" in out and "[red]a" in out


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("not json", "GeoJSON"),
        ("[]", "object"),
        ('{"type": "Point", "coordinates": [0, 0]}', "at least one Polygon"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [1, 0]]]}', "rings"),
        ('{"type": "Polygon", "coordinates": [[[0, 95], [1, 0], [1, 1], [0, 95]]]}', "rings"),
        ('{"type": "Polygon", "coordinates": "x"}', "rings"),
        ('{"type": "Circle"}', "Circle"),
    ],
)
def test_bad_polygons_are_explained(tmp_path, text, says):
    path = tmp_path / "a.geojson"
    path.write_text(text)
    with pytest.raises(DataError, match=says):
        read_polygons(path)


def test_polygons_are_read_with_clean_names(tmp_path):
    path = tmp_path / "a.geojson"
    square = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]
    shape = {"type": "Polygon", "coordinates": [square]}
    feature = {"type": "Feature", "properties": {"name": "lane\n\x1b[31m A"}, "geometry": shape}
    both = [feature, {"type": "MultiPolygon", "coordinates": [[square]]}]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": both}))
    one, two = read_polygons(path)
    assert "\x1b" not in one.name and one.name.startswith("lane") and two.name == "area 2"
    assert one.rings[0].shape == (5, 2)


def test_partial_tracks_are_named_so(track, tmp_path):
    written = write_netcdf(replace(take(track, slice(0, 5)), complete=False), tmp_path / "f.nc")
    assert written.name == "f.partial.nc" and not (tmp_path / "f.nc").exists()
