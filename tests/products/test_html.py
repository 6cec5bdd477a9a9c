"""Pages hold everything they need, escape what files say, stay small, and repeat the summary's numbers."""

from __future__ import annotations

import html
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.products.cartography import Limits
from glider_jax.products.html.charts import Chart, day_ticks, ticks
from glider_jax.products.html.forecast import Fields, instants, report
from glider_jax.products.html.geography import bathymetry_layers, current_layer, density_layer, encode, mercator
from glider_jax.products.html.page import asset, page, safe, section
from glider_jax.products.summary import summarise
from glider_jax_data import folder, manifest
from tests.products import html_pages
from tests.products.html_pages import EVIL, evil_track, forecast_page, hindcast_page, plan_page, validation_page
from tests.products.tracks import START, end_members, gaussian_track, shelf, shelf_currents, take

LIMIT = 5_000_000


def data_of(text: str) -> dict:
    return json.loads(re.search(r'id="data">(.*?)</script>', text, re.S).group(1))


class Attributes(HTMLParser):
    """Every attribute of every tag, as a browser sees them."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, str, str]] = []

    def handle_starttag(self, tag, attrs) -> None:
        self.found += [(tag, name, value or "") for name, value in attrs] or [(tag, "", "")]


def decode(code):
    """Longitude and latitude of an encoded line."""
    return np.cumsum(np.array(code, float).reshape(-1, 2), axis=0) / 1e5


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The text of a page of every kind."""
    out = tmp_path_factory.mktemp("pages")
    picture = out / "p.png"
    picture.write_bytes(b"\x89PNG\r\n\x1a\n")
    made = {
        "forecast": forecast_page(out / "forecast.html", n=400),
        "plan": plan_page(out / "plan.html"),
        "hindcast": hindcast_page(out / "hindcast.html"),
        "validate": validation_page(out / "validation.html", picture),
    }
    return {name: path.read_text(encoding="utf-8") for name, path in made.items()}


KINDS = ("forecast", "plan", "hindcast", "validate")


@pytest.mark.parametrize("kind", KINDS)
def test_text_from_files_is_escaped(pages, kind):
    text = pages[kind]
    assert "&lt;script&gt;window.pwned=1" in text, "the name is shown"
    # Only our own scripts are there, and no tag from a name.
    assert len(re.findall(r"<script", text)) == len(re.findall(r"</script>", text)) <= 3
    assert "<img src=x" not in text and "\x1b" not in text
    assert "<" not in re.search(r'id="data">(.*?)</script>', text, re.S).group(1)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_fetched(pages, kind):
    text = pages[kind]
    seen = Attributes()
    seen.feed(text)
    assert {tag for tag, *_ in seen.found} >= {"script", "style", "h2"}
    for tag, name, value in seen.found:
        assert not name.startswith("on"), f"<{tag} {name}>"
        if name in ("src", "href", "action", "srcset", "data"):
            assert value.startswith(("#", "data:")), f"<{tag} {name}={value}>"
    assert not re.search(r"@import|url\((?!data:)", "".join(re.findall(r"<style>.*?</style>", text, re.S)))
    policy = html.unescape(re.search(r'Content-Security-Policy" content="([^"]*)"', text).group(1))
    assert policy.startswith("default-src 'none'") and "'unsafe-inline'" not in policy.split("script-src")[1]


def test_five_thousand_members_stay_small(tmp_path):
    path = forecast_page(tmp_path / "f.html", n=5000, hours=360.0, velocity_spread=0.05)
    assert 200_000 < path.stat().st_size < LIMIT / 4


def test_the_page_repeats_the_summary():
    track = gaussian_track(n=600)
    summary = summarise(track)
    text = report(track, summary, Fields(shelf()))
    first = summary["surfacings"][0]
    place = first["place"]
    for words in (place["text"], f"{place['latitude']:.5f}, {place['longitude']:.5f}"):
        assert html.escape(words) in text
    frames = data_of(text)["frames"]
    assert [f["hours"] for f in frames] == instants(summary)
    for entry in summary["positions"]:
        frame = next(f for f in frames if f["hours"] == entry["hours"])
        assert frame["place"] == [entry["place"]["latitude"], entry["place"]["longitude"]]
        ring = decode(frame["regions"][1][0][0])
        assert ring == pytest.approx(np.array(entry["regions"][1]["geometry"]["coordinates"][0][0]), abs=2e-5)
    left = summary["battery"]["charge_left_percent"]
    assert f"charge left {left['median']:.1f} %" in frames[-1]["told"]
    assert frames[0]["share"] == 0.0 and frames[-1]["share"] == 1.0
    for name, values in summary["battery"]["energy_wh"].items():
        assert f'{name}</th><td class="r">{values[-1]:,.1f}' in text


def test_regions_between_the_instants_come_from_the_same_members():
    track = gaussian_track(n=800, hours=72.0)
    summary = summarise(track)
    frames = data_of(report(track, summary))["frames"]
    # Between two instants of the summary the cloud grows with time, so must the outline.
    width = {f["hours"]: np.ptp(decode(f["regions"][1][0][0])[:, 1]) for f in frames if f["regions"]}
    assert 36.0 in width and 36.0 not in {p["hours"] for p in summary["positions"]}
    assert width[24.0] < width[36.0] < width[48.0]


def test_a_sample_of_the_members_adds_no_instants():
    track = gaussian_track(n=800)
    summary = summarise(track)
    frames = data_of(report(take(track, slice(0, 100)), summary))["frames"]
    assert [f["hours"] for f in frames] == [0.0, *(p["hours"] for p in summary["positions"])]
    assert "density of 100 members" in report(take(track, slice(0, 100)), summary)


def test_a_forecast_whose_members_end_at_once_has_a_page():
    track = end_members(gaussian_track(n=60), np.arange(60), html_pages.np.int32(2), 0.0)
    text = report(track, summarise(track), Fields(shelf()))
    assert "How members end" in text and data_of(text)["frames"]


def test_the_map_holds_together_at_the_antimeridian():
    track = gaussian_track(n=300, longitude=179.95, east=0.5)
    drawn = data_of(report(track, summarise(track)))["map"]
    (south, west), (north, east) = drawn["bounds"]
    assert east - west < 10.0
    for pin in drawn["pins"]:
        assert west <= pin["place"][1] <= east and south <= pin["place"][0] <= north


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-720, 720), st.floats(-90, 90)), min_size=1, max_size=40),
)
def test_lines_survive_encoding(points):
    points = np.array(points)
    found = decode(encode(points[:, 0], points[:, 1]))
    assert found[0] == pytest.approx(points[0], abs=1e-5) and found[-1] == pytest.approx(points[-1], abs=1e-5)
    # Points may be dropped only where they repeat the one before.
    gaps = np.abs(np.diff(np.round(points * 1e5), axis=0)).any(axis=1)
    assert len(found) == 1 + gaps.sum()


@given(st.text(max_size=80))
@settings(max_examples=60, deadline=None)
def test_any_text_is_safe(text):
    shown = safe(text)
    assert not set("<>\"'") & set(shown)
    assert "\x1b" not in shown and "\n" not in shown


def test_depth_bands_lie_where_the_water_is_that_deep():
    floor = shelf()
    limits = Limits(38.6, -74.6, 39.8, -73.0)
    layers = bathymetry_layers(floor, limits)
    depths = [float(c["depth"]) for c in layers["contours"]]
    assert depths == sorted(depths) and len(layers["bands"]) == len(depths) + 1
    for contour in layers["contours"]:
        longest = decode(max(contour["lines"], key=len))
        i = np.abs(floor.latitude[:, None] - longest[:, 1]).argmin(axis=0)
        j = np.abs(floor.longitude[:, None] - longest[:, 0]).argmin(axis=0)
        assert np.median(floor.depth[i, j]) == pytest.approx(float(contour["depth"]), rel=0.25, abs=3.0)
    land = decode(layers["land"][0][0])
    assert land[:, 0].mean() < -73.9, "land lies in the west"


def test_currents_are_interpolated_and_unknown_times_are_empty():
    grid = shelf_currents(shelf(), hours=4)
    limits = Limits(38.6, -74.6, 39.8, -73.0)
    times = [START, START + 1800.0, START + 3600.0, START + 86400.0]
    layer = current_layer(grid, limits, times)
    assert layer["frames"][3] is None
    one, half, two = (np.array(f, float).reshape(-1, 2) for f in layer["frames"][:3])
    assert half == pytest.approx(0.5 * (one + two), abs=1.01)
    place = np.array(layer["places"]).reshape(-1, 2)[0] / 1e4
    j = np.abs(grid.longitude - place[0]).argmin()
    i = np.abs(grid.latitude - place[1]).argmin()
    assert one[0] == pytest.approx([100 * grid.east[0, 0, i, j], 100 * grid.north[0, 0, i, j]], abs=0.51)


def test_density_counts_every_member_in_its_own_cell():
    limits = Limits(38.0, -75.0, 40.0, -73.0)
    lat, lon = np.array([38.001, 39.999, 39.999, np.nan, 50.0]), np.array([-74.999, -73.001, -73.001, -74.0, -74.0])
    layer = density_layer([(lat, lon)], limits, -74.0)
    pairs = np.array(layer["frames"][0]).reshape(-1, 2)
    cells = dict(zip(np.cumsum(pairs[:, 0]), pairs[:, 1], strict=True))
    assert cells == {0: 1, layer["rows"] * layer["columns"] - 1: 2}
    # The projection is conformal: a cell is as high as wide, and taller in degrees toward the equator.
    height = np.degrees(mercator(40.0) - mercator(38.0)) / layer["rows"]
    assert height == pytest.approx(2.0 / layer["columns"], rel=0.02)


def test_charts_put_values_where_they_belong():
    chart = Chart((0.0, 10.0), (0.0, 100.0), "x", "y")
    assert chart.px(0.0) < chart.px(10.0) and chart.py(0.0) > chart.py(100.0)
    assert chart.px(5.0) == pytest.approx(0.5 * (chart.px(0.0) + chart.px(10.0)))
    log = Chart((0.01, 1.0), (0.01, 1.0), "x", "y", log=True)
    assert log.px(0.1) == pytest.approx(0.5 * (log.px(0.01) + log.px(1.0)))
    assert Chart((1.0, 1.0), (0.0, 0.0), "x", "y").figure("flat")


def test_ticks_are_round_and_inside():
    assert ticks(0.0, 1.0) == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert ticks(0.003, 5.0, log=True) == pytest.approx([0.01, 0.1, 1.0])
    days = day_ticks(15638.0, 15641.0)
    assert days[0] == (15638.0, "25 Oct") and ("12Z" in {w for _, w in days})


def test_what_is_vendored_is_listed_with_its_licence():
    listed = manifest()["files"]
    for name in ("web/leaflet/leaflet.js", "web/leaflet/leaflet.css"):
        assert listed[name]["licence"] and len(listed[name]["sha256"]) == 64
    assert "Redistribution" in asset("leaflet/LICENSE")
    assert (
        "images/"
        not in page("t", "s", [section("a", "A", "text")], data={"map": {"bounds": [[0, 0], [1, 1]]}}).split(
            "<script>"
        )[0]
    )
    assert (folder() / "web" / "report.js").is_file()


def test_evil_names_really_are_evil():
    assert evil_track(n=3).settings["mission"] == EVIL and "</script>" in EVIL


def test_the_rules_of_a_program_are_told_and_escaped():
    track = gaussian_track(n=60)
    summary = summarise(track)
    assert "program</h2>" not in report(track, summary)
    rule = {
        "number": 1, "rule": "rule 1 '<b>low</b>: head home'", "probability": 0.72,
        "hours": {"p05": 242.0, "p25": 260.0, "median": 271.0, "p75": 280.0, "p95": 302.0},
    }  # fmt: skip
    text = report(track, summary | {"program": [rule]})
    assert "fired in 72 % of members, median day 11.3 (10.1-12.6)" in text and "<b>low</b>" not in text
