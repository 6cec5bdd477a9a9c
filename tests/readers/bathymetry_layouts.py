"""Bathymetry files with the layout of real products, small enough to check by hand."""

from __future__ import annotations

import netCDF4
import numpy as np

LAT = np.array([39.0, 39.5, 40.0, 40.5])
LON = np.array([-74.0, -73.5, -73.0])
# Elevation: land in the north-west, the deepest water in the south-east.
UP = np.array([[-20.0, -60.0, -900.0], [-15.0, -50.0, -300.0], [5.0, -30.0, -90.0], [25.0, -10.0, -40.0]])


def write(path, values=UP, *, name="z", lat=LAT, lon=LON, dims=("lat", "lon"), kind="f4", units="m",
          lat_name="lat", lon_name="lon", lat_units="degrees_north", lon_units="degrees_east",
          file_format="NETCDF4", fill=None, coordinates=None, attributes=None):  # fmt: skip
    """A NetCDF grid with the layout asked for."""
    with netCDF4.Dataset(path, "w", format=file_format) as file:
        file.createDimension("lat", len(lat))
        file.createDimension("lon", len(lon))
        for axis, label, values_1d, unit in (
            ("lat", lat_name, lat, lat_units),
            ("lon", lon_name, lon, lon_units),
        ):
            variable = file.createVariable(label, "f8", (axis,))
            if unit:
                variable.units = unit
            variable[:] = values_1d
        variable = file.createVariable(name, kind, dims, fill_value=fill)
        variable.set_auto_maskandscale(False)
        if units:
            variable.units = units
        variable.setncatts(attributes or {})
        variable[:] = np.asarray(values) if dims == ("lat", "lon") else np.asarray(values).T
    return path


def at(grid, lat, lon):
    """Depth at the nearest node."""
    return grid.depth[np.abs(grid.latitude - lat).argmin(), np.abs(grid.longitude - lon).argmin()]


def rows(separator, order="xyz", skip=(), up=UP, header="", fmt="{:.6f}"):
    """XYZ text, north first, longitude fastest."""
    lines = [header] if header else []
    for j in reversed(range(LAT.size)):
        for i in range(LON.size):
            if (j, i) not in skip:
                values = {"x": LON[i], "y": LAT[j], "z": up[j, i]}
                lines.append(separator.join(fmt.format(values[k]) for k in order))
    return "\n".join(lines) + "\n"
