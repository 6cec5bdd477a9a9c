"""The main command through its entry point: products, exit codes, and one clear sentence for every bad input."""

from __future__ import annotations

import json

import numpy as np
import pytest

SHORT = ["ensemble", "--n", "40", "--days", "0.5"]


def test_writes_every_product_and_prints_json(run, tmp_path):
    code, out, err = run(*SHORT, "--json", "--out", tmp_path / "f")
    assert code == 0, err
    summary = json.loads(out)
    assert summary["forecast"]["members"] == 40
    for name in ("forecast.nc", "summary.json", "forecast.geojson", "forecast.kmz", "map.png", "battery.png"):
        assert (tmp_path / "f" / name).stat().st_size > 500, name
    assert json.loads((tmp_path / "f" / "summary.json").read_text())["surfacings"] == summary["surfacings"]
    import netCDF4

    with netCDF4.Dataset(tmp_path / "f" / "forecast.nc") as data:
        assert data.dimensions["member"].size == 40
        assert np.isfinite(data["lat"][:]).all()


def test_prints_what_pilots_read(run, tmp_path):
    code, out, err = run(*SHORT, "--out", tmp_path / "f", "--format", "json")
    assert code == 0, err
    assert "surfacing" in out.lower() and "′" in out and "km" in out
    assert sorted(p.name for p in (tmp_path / "f").iterdir()) == ["summary.json"]


def test_same_seed_gives_the_same_summary(run, tmp_path):
    one, two, other = (
        json.loads(run(*SHORT, "--json", "--seed", seed, "--format", "json", "--out", tmp_path / "f")[1])["surfacings"]
        for seed in (1, 1, 2)
    )
    assert one == two and one != other


MISSION = """
[mission]
name = "m"
start = 2009-09-06T00:00:00Z
start_position = [39.3, -73.8]
waypoints = [[39.2, -73.5]]
dive_to = {dive_to}
climb_to = 3.0
pitch = 26.0
surface_every = 10800.0
surface_stay = 600.0
{extra}
"""


def _mission(tmp_path, dive_to=50.0, extra="", position=None):
    text = MISSION.format(dive_to=dive_to, extra=extra)
    if position:
        text = text.replace("[39.3, -73.8]", position)
    path = tmp_path / "m.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--n", "0"], "at least 1 member"),
        (["--days", "-1"], "--days"),
        (["--speed", "shoebocks"], "Did you mean 'shoebox'"),
        (["--speed-kind", "over_grund"], "Did you mean 'over_ground'"),
        (["--format", "nc,jsn"], "Did you mean 'json'"),
        (["--precision", "float16"], "float32 or float64"),
        (["--start", "yesterday"], "ISO 8601"),
        (["--start", "1999-01-01"], "currents"),
        (["--mission", "nowhere.toml"], "nowhere.toml"),
        (["--vehicle", "nowhere.toml"], "nowhere.toml"),
        (["--currents", "nowhere.nc"], "nowhere.nc"),
        (["--bathymetry", "nowhere.nc"], "nowhere.nc"),
        (["--start-position", "39.9", "-74.9"], "land"),
        (["--start-position", "10", "-74"], "cover"),
    ],
)
def test_bad_words_give_one_sentence_and_exit_code_one(run, tmp_path, words, says):
    code, out, err = run("ensemble", "--n", "5", "--out", tmp_path / "f", *words)
    assert code == 1, err
    assert says in err, err
    assert "Traceback" not in err and len(err.strip().splitlines()) == 1
    assert not (tmp_path / "f").exists() or not list((tmp_path / "f").iterdir())


def test_wrong_usage_exits_with_two(run):
    assert run("ensemble", "--no-such-option")[0] == 2


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ({"dive_to": 2.0}, "dive_to"),
        ({"extra": "dive_too = 5"}, "Did you mean 'dive_to'"),
        ({"dive_to": "'deep'"}, "dive_to"),
        ({"position": "[139.3, -73.8]"}, "latitude"),
    ],
)
def test_bad_missions(run, tmp_path, text, says):
    code, _, err = run("ensemble", "--n", "5", "--mission", _mission(tmp_path, **text), "--out", tmp_path / "f")
    assert code == 1 and says in err, err


def _currents(path, **changes):
    """A small currents file of our own, with one thing wrong."""
    import netCDF4

    with netCDF4.Dataset(path, "w") as data:
        axes = {"time": np.arange(24.0), "lat": np.linspace(38.5, 40, 16), "lon": np.linspace(-75, -72, 31)}
        for name, values in axes.items():
            data.createDimension(name, values.size)
            variable = data.createVariable(name, "f8", (name,))
            variable[:] = values
        data["time"].units = "hours since 2009-09-06 00:00:00"
        data["lat"].units, data["lon"].units = "degrees_north", "degrees_east"
        for name in changes.get("names", ("u", "v")):
            variable = data.createVariable(name, "f4", changes.get("dims", ("time", "lat", "lon")))
            variable.units = changes.get("units", "m s-1")
            which = {"u": "eastward", "v": "northward"}[name]
            variable.standard_name = f"surface_{which}_sea_water_velocity"
            variable[:] = changes.get("value", 0.1)
    return path


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"units": "furlongs"}, "furlongs"),
        ({"names": ("u",)}, "north"),
        ({"value": np.nan}, "bad.nc"),
    ],
)
def test_bad_currents(run, tmp_path, changes, says):
    path = _currents(tmp_path / "bad.nc", **changes)
    mission = _mission(tmp_path)
    code, _, err = run("ensemble", "--n", "5", "--mission", mission, "--currents", path, "--out", tmp_path / "f")
    assert code == 1 and says in err, err


def test_good_currents_of_the_same_layout_fly(run, tmp_path):
    path = _currents(tmp_path / "good.nc")
    code, out, err = run(
        "ensemble", "--n", "20", "--mission", _mission(tmp_path), "--currents", path, "--format", "json", "--json",
        "--out", tmp_path / "f",
    )  # fmt: skip
    assert code == 0, err
    summary = json.loads(out)
    assert summary["forecast"]["horizon_h"] <= 23.01
    assert any("the currents end after" in note for note in summary["notes"])
    # 0.1 m/s toward the north-east for a day, against a glider's 22 km.
    assert summary["rates"]["km_per_day"]["over_ground"]["median"] > 15


def test_random_bytes_never_give_a_traceback(run, tmp_path):
    rng = np.random.default_rng(0)
    for k, option in enumerate(["--mission", "--vehicle", "--currents", "--bathymetry", "--polygons"]):
        for suffix in (".toml", ".nc"):
            path = tmp_path / f"noise{k}{suffix}"
            path.write_bytes(rng.integers(0, 256, 400, dtype=np.uint8).tobytes())
            code, _, err = run("ensemble", "--n", "2", option, path, "--out", tmp_path / "f")
            assert code == 1 and err.startswith("error:"), (option, err)
