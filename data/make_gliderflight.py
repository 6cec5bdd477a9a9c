"""Make ``gliderflight/comet2016.nc``: a recording whose pitch sensor is known to be off, for the proof on real data.

The numbers are those of two arrays in the PyPI source package gliderflight 1.2.0 (Lucas Merckelbach, MIT licence,
see ``gliderflight/NOTICE.txt``): glider comet, Baltic Sea, June 2016, with the speed of an acoustic Doppler profiler.
The author had corrected the pitch, ``0.86 m_pitch - 0.004 rad``; that is undone here, so that the recording is what
the vehicle recorded. Depth is hydrostatic with the measured density: in brackish water a standard ocean would be
2 % wrong. Fetch the package (``pip download --no-binary :all: --no-deps gliderflight==1.2.0``), unpack it, then
``python -m glider_jax_data.make_gliderflight FOLDER``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from pathlib import Path

import netCDF4
import numpy as np

NAME = "gliderflight/comet2016.nc"
GAIN, OFFSET = 0.86, -0.004  # the author's correction of the pitch, examples/create_data_file.py
GRAVITY = 9.8144  # m s-2 at 54 degrees north
PASCAL_PER_BAR = 1e5
SOURCE = (
    "gliderflight 1.2.0 (PyPI), data/gliderflight_data.npy: its numbers, the author's pitch correction undone"
)
ARRAY_SHA256 = "650aff9518822071878aa72ba9d093690e406de6e006464ab37d176a6799f6be"

# name, unit, text, smallest step kept
_COLUMNS = (
    ("m_depth", "m", "depth, hydrostatic with the measured density", 1e-4),
    ("m_pressure", "bar", "sea pressure of the CTD", 1e-5),
    ("sci_water_pressure", "bar", "sea pressure of the CTD", 1e-5),
    ("m_pitch", "rad", "pitch as the vehicle recorded it, nose up", 1e-6),
    ("m_ballast_pumped", "cc", "pumped volume", 1e-3),
    ("water_density", "kg m-3", "in-situ density from the CTD, Baltic salinity", 1e-4),
    (
        "measured_speed_through_water",
        "m s-1",
        "speed along the path by acoustic Doppler profiler, dives only",
        1e-5,
    ),
)


def read_arrays(folder: Path) -> dict[str, np.ndarray]:
    """The recording's columns from an unpacked source package."""
    path = folder / "data" / "gliderflight_data.npy"
    time, pressure, pitch, pumped, density, speed = np.load(path)
    # Weight of the column above: the density at the surface is that of the shallowest sample.
    order = np.argsort(pressure)
    p = np.concatenate([[0.0], pressure[order]]) * PASCAL_PER_BAR
    rho = np.concatenate([[density[order[0]]], density[order]])
    depth = np.empty_like(pressure)
    depth[order] = np.cumsum(np.diff(p) / (0.5 * (rho[1:] + rho[:-1]) * GRAVITY))
    return {
        "time": time,
        "m_present_time": time,
        "m_depth": depth,
        "m_pressure": pressure,
        "sci_water_pressure": pressure,
        "m_pitch": (pitch - OFFSET) / GAIN,
        "m_ballast_pumped": pumped,
        "water_density": density,
        "measured_speed_through_water": speed,
    }


def make(folder: Path, out: Path) -> Path:
    """Write the recording below ``out`` from the unpacked package in ``folder``."""
    columns = read_arrays(folder)
    path = out / NAME
    path.parent.mkdir(parents=True, exist_ok=True)
    with netCDF4.Dataset(path, "w") as file:
        file.title = "Slocum glider comet, Baltic Sea, 24 June 2016: flight with measured speed through water"
        file.source = SOURCE
        file.license = "MIT, Copyright (c) 2018 Lucas Merckelbach; see NOTICE.txt"
        file.platform_type = "Slocum G1"
        file.latitude, file.longitude = 54.0, 15.0
        file.comment = (
            "native sensor names and units; m_pitch is uncorrected: the author used 0.86 m_pitch - 0.004"
        )
        file.createDimension("time", columns["time"].size)
        for name in ("time", "m_present_time"):
            variable = file.createVariable(name, "f8", ("time",), zlib=True, complevel=9, shuffle=True)
            variable.units = "seconds since 1970-01-01 00:00:00" if name == "time" else "timestamp"
            variable[:] = np.round(columns[name], 3)
        for name, unit, text, step in _COLUMNS:
            variable = file.createVariable(
                name, "f4", ("time",), zlib=True, complevel=9, shuffle=True, fill_value=np.nan
            )
            variable.units, variable.long_name = unit, text
            variable[:] = np.round(columns[name] / step) * step
    return path


def update_manifest(out: Path) -> None:
    """Write source, licence and checksum into ``MANIFEST.json``; other entries stay."""
    target = out / "MANIFEST.json"
    record = json.loads(target.read_text(encoding="utf-8")) if target.exists() else {}
    record.setdefault("files", {})[NAME] = {
        "source": SOURCE,
        "licence": "MIT (gliderflight/NOTICE.txt)",
        "sha256": hashlib.sha256((out / NAME).read_bytes()).hexdigest(),
    }
    target.write_text(json.dumps(record, indent=2, sort_keys=True) + "\n", encoding="utf-8")


def main() -> None:
    """Command line: convert the arrays of an unpacked package and note the file in the manifest."""
    parser = argparse.ArgumentParser(description="Convert the arrays of the gliderflight source package.")
    parser.add_argument("folder", type=Path, help="the unpacked package, with data/gliderflight_data.npy")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    arguments = parser.parse_args()
    digest = hashlib.sha256((arguments.folder / "data" / "gliderflight_data.npy").read_bytes()).hexdigest()
    if digest != ARRAY_SHA256:
        raise SystemExit(f"gliderflight_data.npy: expected SHA-256 {ARRAY_SHA256}, found {digest}.")
    make(arguments.folder, arguments.out)
    update_manifest(arguments.out)


if __name__ == "__main__":
    main()
