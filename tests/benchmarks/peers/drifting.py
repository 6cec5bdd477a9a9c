"""What the adapters of other tools share: arguments, and timing; standard library and NumPy only.

Adapters run under the other tool's own Python. Each reads one current field and one list of starts, carries the
particles by its own engine, and prints one line of JSON: version, method, seconds of every repeat, end points.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import time

import numpy as np


def arguments() -> argparse.Namespace:
    """The command line of every adapter."""
    parser = argparse.ArgumentParser()
    parser.add_argument("field", help="netCDF: u and v (time, lat, lon) in m/s, time in s")
    parser.add_argument("starts", help="npy: (2, n) longitudes and latitudes in degrees")
    parser.add_argument("--days", type=float, default=15.0)
    parser.add_argument("--step", type=float, default=300.0)
    parser.add_argument("--repeat", type=int, default=1)
    given = parser.parse_args()
    given.longitude, given.latitude = np.load(given.starts)
    return given


def metres_per_degree(latitude):
    """Metres per degree of longitude and of latitude on the WGS84 ellipsoid."""
    sine, square = np.sin(np.radians(latitude)), 6.69437999014e-3
    root = np.sqrt(1.0 - square * sine**2)
    east = np.radians(6378137.0 / root * np.cos(np.radians(latitude)))
    return east, np.radians(6378137.0 * (1.0 - square) / root**3)


def read_field(path):
    """Axes and velocities of the field: time s, latitude, longitude, u, v (time, lat, lon)."""
    import xarray

    with xarray.open_dataset(path, decode_times=False) as data:
        return tuple(np.asarray(data[name].values) for name in ("time", "lat", "lon", "u", "v"))


def report(given, version: str, method: str, drift) -> None:
    """Call ``drift()``, which returns end longitudes and latitudes, as often as asked, and print what it took."""
    wall, cpu = [], []
    # Tools print progress on standard output, which is for the result alone.
    with contextlib.redirect_stdout(sys.stderr):
        for _ in range(given.repeat):
            begin, spent = time.perf_counter(), time.process_time()
            longitude, latitude = drift()
            # Of this process alone: a compiler that a tool starts is left out.
            cpu.append(time.process_time() - spent)
            wall.append(time.perf_counter() - begin)
    found = {
        "version": version,
        "method": method,
        "wall_s": wall,
        "cpu_s": cpu,
        "longitude": np.asarray(longitude, float).tolist(),
        "latitude": np.asarray(latitude, float).tolist(),
    }
    print(json.dumps(found))
