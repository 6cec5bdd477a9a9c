"""Public data from a server on loopback that answers as ERDDAP and THREDDS do: requests, cache, checksums, failures."""

from __future__ import annotations

import json
import socket
import threading
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import parse_qs, unquote, urlsplit

import netCDF4
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.errors import ConfigError, CoverageError, DataError
from glider_jax.products import fetching
from glider_jax.products import public_sources as public
from glider_jax.products.fetching import Wanted, fetch, held
from glider_jax.readers.bathymetry import read_bathymetry
from glider_jax.readers.currents import read_currents
from glider_jax.readers.recordings import read_recording

START = 1725494400.0  # 2024-09-05T00:00:00Z
BOX = (39.0, 40.0, -74.0, -73.0)


def info_text(dimensions, variables) -> str:
    """ERDDAP's description of a data set."""
    lines = ["Row Type,Variable Name,Attribute Name,Data Type,Value"]
    for name, low, high, step in dimensions:
        lines.append(f'dimension,{name},,double,"nValues=9, evenlySpaced=true, averageSpacing={step}"')
        lines.append(f'attribute,{name},actual_range,double,"{low}, {high}"')
    names = ", ".join(d[0] for d in dimensions)
    lines += [f'variable,{name},,float,"{names}"' for name in variables]
    return "\n".join(lines) + "\n"


def relief(path: Path) -> bytes:
    """A relief as ERDDAP sends it: netCDF 3, metres up."""
    with netCDF4.Dataset(path, "w", format="NETCDF3_CLASSIC") as data:
        for name, values, unit in (
            ("latitude", np.linspace(39, 40, 21), "degrees_north"),
            ("longitude", np.linspace(-74, -73, 21), "degrees_east"),
        ):
            data.createDimension(name, values.size)
            axis = data.createVariable(name, "f8", (name,))
            axis[:], axis.units, axis.standard_name = values, unit, name
        z = data.createVariable("z", "f4", ("latitude", "longitude"))
        z.units, z.positive = "m", "up"
        z[:] = -30.0 - 40.0 * (np.arange(21)[None, :] / 20.0) * np.ones((21, 1))
    return path.read_bytes()


def totals(path: Path) -> bytes:
    """Surface currents of HFRNet as ERDDAP sends them."""
    with netCDF4.Dataset(path, "w", format="NETCDF3_CLASSIC") as data:
        for name, values, unit in (
            ("time", START + 3600.0 * np.arange(5), "seconds since 1970-01-01T00:00:00Z"),
            ("latitude", np.linspace(39, 40, 8), "degrees_north"),
            ("longitude", np.linspace(-74, -73, 8), "degrees_east"),
        ):
            data.createDimension(name, values.size)
            axis = data.createVariable(name, "f8", (name,))
            axis[:], axis.units, axis.standard_name = values, unit, name
        for name, standard, value in (
            ("water_u", "surface_eastward_sea_water_velocity", 0.2),
            ("water_v", "surface_northward_sea_water_velocity", -0.1),
            ("DOPx", "", 0.5),
            ("DOPy", "", 0.5),
        ):
            field = data.createVariable(name, "f4", ("time", "latitude", "longitude"))
            field[:] = value
            if standard:
                field.units, field.standard_name = "m s-1", standard
    return path.read_bytes()


def deployment(path: Path) -> bytes:
    """Rows of a deployment as the glider data assembly center's ERDDAP sends them."""
    n = 40
    with netCDF4.Dataset(path, "w", format="NETCDF3_CLASSIC") as data:
        data.createDimension("row", n)
        time = START + 60.0 * np.arange(n)
        for name, values, unit in (
            ("time", time, "seconds since 1970-01-01T00:00:00Z"),
            ("latitude", 39.0 + 0.001 * np.arange(n), "degrees_north"),
            ("longitude", -73.5 + 0.001 * np.arange(n), "degrees_east"),
            ("depth", 50.0 - np.abs(np.arange(n) - 20.0), "m"),
            ("time_uv", np.full(n, START + 1200.0), "seconds since 1970-01-01T00:00:00Z"),
            ("profile_id", np.arange(n) // 20, "1"),
            ("u", np.full(n, 0.1), "m s-1"),
            ("v", np.full(n, -0.2), "m s-1"),
        ):
            column = data.createVariable(name, "f8", ("row",))
            column[:], column.units = values, unit
    return path.read_bytes()


class Server:
    """A server on loopback; ``answers`` maps the beginning of a path to a status, a body, and a length it claims."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.answers: dict[str, list[tuple[int, bytes, int | None]]] = {}
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                outer.asked.append(self.path)
                found = next((v for k, v in outer.answers.items() if self.path.startswith(k)), None)
                found = found or [(404, b'Error { code=404; message="Not Found"; }', None)]
                status, body, length = found.pop(0) if len(found) > 1 else found[0]
                self.send_response(status)
                self.send_header("Content-Length", str(len(body) if length is None else length))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *words) -> None:
                """Say nothing."""

        self.httpd = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.httpd.server_address[1]}"
        self.thread = threading.Thread(target=self.httpd.serve_forever, daemon=True)
        self.thread.start()

    def give(self, path: str, *bodies: bytes, status: int = 200, length: int | None = None) -> None:
        self.answers[path] = [(status, body, length) for body in bodies]

    def stop(self) -> None:
        self.httpd.shutdown()
        self.httpd.server_close()
        self.thread.join()


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr(fetching, "_PAUSE", 0.0)
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    made = Server()
    yield made
    made.stop()


@pytest.fixture
def etopo(server, tmp_path):
    """The relief's answers, and what is wanted of it."""
    axes = [("latitude", -89.99, 89.99, 0.004), ("longitude", -179.99, 179.99, 0.004)]
    server.give("/erddap/info/ETOPO_2022_v1_15s/", info_text(axes, ["z"]).encode())
    server.give("/erddap/griddap/ETOPO_2022_v1_15s.nc", relief(tmp_path / "r.nc"))
    return Wanted(public.source_of("etopo2022"), BOX, server=server.url + "/erddap")


def test_a_box_is_fetched_once_and_read(server, etopo, tmp_path):
    seen = []
    found = fetch(etopo, folder=tmp_path / "c", progress=seen.append)
    assert not found.cached and seen[-1] == found.path.stat().st_size
    query = unquote(urlsplit(server.asked[-1]).query)
    assert query == "z[(39.000000):1:(40.000000)][(-74.000000):1:(-73.000000)]"
    assert "[" not in server.asked[-1] and "(" not in server.asked[-1], "brackets are encoded"
    grid = read_bathymetry(found.path)
    assert grid.depth[:, 0] == pytest.approx(30.0) and grid.depth[:, -1] == pytest.approx(70.0)
    count = len(server.asked)
    again = fetch(etopo, folder=tmp_path / "c")
    assert again.cached and again.sha256 == found.sha256 and len(server.asked) == count, "no network"
    other = replace(etopo, box=(39.0, 39.5, -74.0, -73.0))
    assert fetch(other, folder=tmp_path / "c").path != found.path
    assert {Path(told["path"]) for told in held(tmp_path / "c")} >= {found.path}
    assert fetch(etopo, folder=tmp_path / "c", again=True).cached is False


def test_a_changed_file_is_fetched_again(etopo, tmp_path):
    found = fetch(etopo, folder=tmp_path)
    found.path.write_bytes(found.path.read_bytes()[:-10])
    again = fetch(etopo, folder=tmp_path)
    assert not again.cached and "changed" in again.notes[0] and again.sha256 == found.sha256
    (tmp_path / (found.path.name + ".json")).write_text("not json")
    assert "not readable" in fetch(etopo, folder=tmp_path).notes[0]


def test_a_cut_answer_leaves_nothing(server, etopo, tmp_path):
    body = relief(tmp_path / "x.nc")
    server.give("/erddap/griddap/", body[:500], length=len(body))
    del server.answers["/erddap/griddap/ETOPO_2022_v1_15s.nc"]
    with pytest.raises(DataError, match="cut"):
        fetch(etopo, folder=tmp_path / "c")
    assert not list((tmp_path / "c").glob("*"))


def test_an_error_page_is_no_file(server, etopo, tmp_path):
    server.give("/erddap/griddap/ETOPO_2022_v1_15s.nc", b"<html>\x1b[31m Service down</html>")
    with pytest.raises(DataError, match="expected a netCDF file, found: '<html> "):
        fetch(etopo, folder=tmp_path / "c")
    assert not list((tmp_path / "c").glob("*"))


def test_too_much_is_refused_before_it_is_read(server, etopo, tmp_path):
    server.give("/erddap/griddap/ETOPO_2022_v1_15s.nc", b"CDF\x01", length=3_000_000_000)
    with pytest.raises(DataError, match="at most 2 GB"):
        fetch(etopo, folder=tmp_path)


def test_a_busy_server_is_asked_again_and_a_refusal_is_told(server, etopo, tmp_path):
    body = relief(tmp_path / "x.nc")
    server.answers["/erddap/griddap/ETOPO_2022_v1_15s.nc"] = [(503, b"busy", None), (200, body, None)]
    assert fetch(etopo, folder=tmp_path / "c").path.is_file()
    server.give("/erddap/griddap/ETOPO_2022_v1_15s.nc", b"Query error: bad", status=400)
    with pytest.raises(DataError, match="HTTP status 400: Query error: bad"):
        fetch(etopo, folder=tmp_path / "c", again=True)


def test_offline_says_so_and_the_cache_still_serves(etopo, tmp_path):
    fetch(etopo, folder=tmp_path)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        gone = f"http://127.0.0.1:{free.getsockname()[1]}/erddap"
    with pytest.raises(DataError, match="Connect to the network"):
        fetch(replace(etopo, server=gone), folder=tmp_path)
    assert fetch(etopo, folder=tmp_path).cached


def test_currents_follow_the_servers_own_axes(server, tmp_path):
    # Stored descending and in longitudes of 0 to 360, with an axis of one level.
    axes = [("time", START - 86400, START + 6 * 3600, 3600), ("altitude", 0, 0, 0), ("latitude", 50.0, 20.0, -0.05),
            ("longitude", 262.0, 303.0, 0.06)]  # fmt: skip
    server.give("/erddap/info/ucsdHfrE6/", info_text(axes, ["water_u", "water_v", "DOPx", "hdop"]).encode())
    server.give("/erddap/griddap/ucsdHfrE6.nc", totals(tmp_path / "t.nc"))
    wanted = Wanted(public.source_of("hfrnet-east"), BOX, (START, START + 86400.0), 2, server=server.url + "/erddap/")
    found = fetch(wanted, folder=tmp_path / "c")
    query = unquote(urlsplit(server.asked[-1]).query)
    one = "[(2024-09-05T00:00:00Z):1:(2024-09-05T06:00:00Z)][0][(40.000000):2:(39.000000)][(286.000000):2:(287.000000)]"
    assert query == ",".join(f"{name}{one}" for name in ("water_u", "water_v", "DOPx"))
    grid = read_currents(found.path)
    assert np.nanmedian(grid.east) == pytest.approx(0.2) and np.nanmedian(grid.north) == pytest.approx(-0.1)
    assert grid.source.product == "HFRNet RTV"


def test_what_lies_outside_is_refused_with_what_there_is(server, tmp_path):
    axes = [("time", START - 86400, START - 3600, 3600), ("latitude", 20, 50, 0.05), ("longitude", -98, -57, 0.06)]
    server.give("/erddap/info/ucsdHfrE6/", info_text(axes, ["water_u", "water_v"]).encode())
    wanted = Wanted(public.source_of("hfrnet-east"), BOX, (START, START + 86400.0), server=server.url + "/erddap")
    with pytest.raises(CoverageError, match="2024-09-04T23:00:00Z"):
        fetch(wanted, folder=tmp_path)
    far = replace(wanted, box=(-10.0, 0.0, 10.0, 20.0), period=(START - 9e4, START))
    with pytest.raises(CoverageError, match="latitude between 20 and 50"):
        fetch(far, folder=tmp_path)


def test_a_renamed_variable_is_named(server, tmp_path):
    axes = [("latitude", 20, 50, 0.05), ("longitude", -98, -57, 0.06)]
    server.give("/erddap/info/ETOPO_2022_v1_15s/", info_text(axes, ["zz"]).encode())
    with pytest.raises(DataError, match="expected the variable 'z' .* found zz"):
        fetch(Wanted(public.source_of("etopo2022"), BOX, server=server.url + "/erddap"), folder=tmp_path)
    server.give("/erddap/info/ETOPO_2022_v1_15s/", b"<html>moved</html>")
    with pytest.raises(DataError, match="expected ERDDAP's description"):
        fetch(Wanted(public.source_of("etopo2022"), BOX, server=server.url + "/erddap"), folder=tmp_path)


def test_a_model_is_asked_of_the_subset_service(server, tmp_path):
    server.give("/thredds/ncss/roms/doppio/2017_da/his/History_Best", totals(tmp_path / "t.nc"))
    wanted = Wanted(public.source_of("doppio"), BOX, (START, START + 7200.0), server=server.url + "/thredds")
    fetch(wanted, folder=tmp_path / "c")
    words = parse_qs(urlsplit(server.asked[-1]).query)
    assert {"u", "v", "h", "angle", "mask_rho"} <= set(words["var"])
    assert [words[k] for k in ("north", "south", "west", "east")] == [["40"], ["39"], ["-74"], ["-73"]]
    assert words["time_start"] == ["2024-09-05T00:00:00Z"] and words["accept"] == ["netcdf"]


def test_deployments_are_listed_and_one_is_fetched_and_read(server, tmp_path):
    rows = "ru28-20240801T0000,Rutgers,2024-08-01T00:00:00Z,2024-08-30T00:00:00Z,Rutgers\n"
    rows += 'ru33-20240904T0000,"Rutgers, NJ",2024-09-04T00:00:00Z,2024-09-20T00:00:00Z,Rutgers\nallDatasets,x,,,y\n'
    server.give("/erddap/tabledap/allDatasets.csv0", rows.encode())
    base = Wanted(public.source_of("ioos-gliders"), BOX, (START, START + 86400.0), server=server.url + "/erddap")
    found = fetching.deployments(base)
    assert [row["dataset"] for row in found] == ["ru33-20240904T0000", "ru28-20240801T0000"]
    assert "maxLatitude%3E=39" in server.asked[-1] or "maxLatitude>=39" in unquote(server.asked[-1])
    names = ["time", "latitude", "longitude", "depth", "profile_id", "time_uv", "u", "v"]
    server.give("/erddap/info/ru33-20240904T0000/", info_text([], names).encode())
    server.give("/erddap/tabledap/ru33-20240904T0000.nc", deployment(tmp_path / "d.nc"))
    got = fetch(replace(base, dataset="ru33-20240904T0000"), folder=tmp_path / "c")
    assert "time>=2024-09-05T00:00:00Z" in unquote(server.asked[-1]) and "ru33" in got.path.name
    recording = read_recording(got.path)
    assert recording["depth"].max() == pytest.approx(50.0)
    server.give("/erddap/tabledap/allDatasets.csv0", b"Your query produced no matching results.", status=404)
    assert fetching.deployments(base) == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"box": (40.0, 39.0, -74.0, -73.0)}, "--box"),
        ({"box": (39.0, 40.0, -73.0, -74.0)}, "--box"),
        ({"stride": 0}, "--stride"),
        ({"server": "file:///etc"}, "--server"),
        ({"period": (START, START)}, "--days"),
    ],
)
def test_wrong_words_are_refused_before_anything_is_asked(change, said, tmp_path):
    with pytest.raises(ConfigError, match=said):
        fetch(replace(Wanted(public.source_of("etopo2022"), BOX), **change), folder=tmp_path)
    with pytest.raises(ConfigError, match="period"):
        fetch(Wanted(public.source_of("maracoos"), BOX), folder=tmp_path)


@settings(max_examples=40, deadline=None)
@given(st.text(max_size=60))
def test_names_of_deployments_choose_no_path(dataset):
    name = Wanted(public.source_of("ioos-gliders"), BOX, dataset=dataset).file_name
    assert "/" not in name and "\\" not in name and not name.startswith(".") and name.endswith(".nc")


def test_the_command_fetches_a_missions_box(server, etopo, tmp_path, monkeypatch, capsys):
    from glider_jax_cli.main import main

    monkeypatch.setenv("GLIDER_JAX_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)

    def run(*words):
        monkeypatch.setattr("sys.argv", ["glider-forecast", "data", *words])
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code or 0
        told = capsys.readouterr()
        return code, told.out, told.err

    code, out, err = run("fetch", "etopo2022", "--server", etopo.base, "--days", "1", "--out", "etopo.nc")
    assert code == 0, err
    assert out.strip() == "etopo.nc" and "--bathymetry etopo.nc" in err and "credit: NOAA" in err
    query = unquote(urlsplit(server.asked[-1]).query)
    south = float(query.split("[(")[1].split(")")[0])
    assert 38.0 < south < 39.0, "the bundled mission's reach"
    code, out, err = run("fetch", "etopo2022", "--server", etopo.base, "--days", "1", "--json")
    assert json.loads(out)["cached"] is True
    code, out, _ = run("list")
    assert code == 0 and "maracoos" in out and "etopo2022-" in out
    code, out, _ = run("list", "--json")
    assert {s["name"] for s in json.loads(out)["sources"]} == set(public.SOURCES)
    code, _, err = run("fetch", "etopo", "--box", "1", "2", "3", "4")
    assert code == 1 and "Did you mean 'etopo2022'" in err
    code, _, err = run("fetch", "maracoos", "--start", "yesterday")
    assert code == 1 and "--start" in err
