"""Drift by Parcels 3: RK4, compiled kernels, nothing written. Velocities are given in degrees per second on WGS84."""

from __future__ import annotations

from datetime import timedelta

import numpy as np
import parcels
from drifting import arguments, metres_per_degree, read_field, report


def main() -> None:
    """Carry the particles and print the result."""
    given = arguments()
    parcels.logger.setLevel("ERROR")
    time, latitude, longitude, u, v = read_field(given.field)
    east, north = (a[None, :, None] for a in metres_per_degree(latitude))
    # A spherical mesh knows only a sphere of 1852 m per minute; a flat one takes what it is given.
    fields = parcels.FieldSet.from_data(
        {"U": (u / east).astype(np.float32), "V": (v / north).astype(np.float32)},
        {"lon": longitude, "lat": latitude, "time": time - time[0]},
        mesh="flat",
    )

    def drift():
        particles = parcels.ParticleSet(
            fields, parcels.JITParticle, lon=given.longitude, lat=given.latitude, lonlatdepth_dtype=np.float64
        )
        particles.execute(
            parcels.AdvectionRK4,
            runtime=timedelta(days=given.days),
            dt=timedelta(seconds=given.step),
            verbose_progress=False,
        )
        # ``lon`` and ``lat`` are those before the last step.
        return particles.lon_nextloop, particles.lat_nextloop

    report(given, f"Parcels {parcels.__version__}", f"RK4, {given.step:g} s, JIT", drift)


if __name__ == "__main__":
    main()
