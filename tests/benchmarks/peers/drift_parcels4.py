"""Drift by Parcels 4: RK4, nothing written. Velocities are given in degrees per second on WGS84, as to Parcels 3."""

from __future__ import annotations

import numpy as np
import parcels
import xarray
from drifting import arguments, metres_per_degree, read_field, report


def main() -> None:
    """Carry the particles and print the result."""
    given = arguments()
    parcels.logger.setLevel("ERROR")
    time, latitude, longitude, u, v = read_field(given.field)
    east, north = (a[None, :, None] for a in metres_per_degree(latitude))
    moments = np.datetime64("2000-01-01") + (time - time[0]).astype("timedelta64[s]")

    def array(values):
        coordinates = {"time": moments, "latitude": latitude, "longitude": longitude}
        marked = xarray.DataArray(values.astype(np.float32), coords=coordinates, dims=tuple(coordinates))
        for name, axis in (("time", "T"), ("latitude", "Y"), ("longitude", "X")):
            marked[name].attrs["axis"] = axis
        return marked

    data = parcels.convert.copernicusmarine_to_sgrid(fields={"U": array(u / east), "V": array(v / north)})
    fields = parcels.FieldSet.from_sgrid_conventions(data, mesh="flat")

    def drift():
        particles = parcels.ParticleSet(fields, x=given.longitude, y=given.latitude)
        particles.execute(
            parcels.kernels.AdvectionRK4,
            runtime=np.timedelta64(int(given.days * 86400), "s"),
            dt=np.timedelta64(int(given.step), "s"),
            verbose_progress=False,
        )
        return np.asarray(particles.x), np.asarray(particles.y)

    report(given, f"Parcels {parcels.__version__}", f"RK4, {given.step:g} s", drift)


if __name__ == "__main__":
    main()
