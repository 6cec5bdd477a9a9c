"""Drift by OpenDrift: RK4, nothing written to disk, no landmask, no wind, no diffusion."""

from __future__ import annotations

from datetime import timedelta

import numpy as np
import opendrift
import xarray
from drifting import arguments, report
from opendrift.models.oceandrift import OceanDrift
from opendrift.readers.reader_netCDF_CF_generic import Reader


def main() -> None:
    """Carry the particles and print the result."""
    given = arguments()
    data = xarray.open_dataset(given.field).load()

    def drift():
        reader = Reader(data)
        model = OceanDrift(loglevel=50)
        model.set_config("general:use_auto_landmask", False)
        model.set_config("environment:constant:land_binary_mask", 0)
        for name in ("x_wind", "y_wind", "sea_surface_wave_stokes_drift_x_velocity",
                     "sea_surface_wave_stokes_drift_y_velocity"):  # fmt: skip
            model.set_config(f"environment:constant:{name}", 0)
        model.set_config("drift:advection_scheme", "runge-kutta4")
        model.set_config("drift:vertical_mixing", False)
        model.add_reader(reader)
        model.seed_elements(given.longitude, given.latitude, time=reader.start_time, z=0)
        # One output, at the end: what it keeps is favourable to it.
        whole = timedelta(days=given.days)
        model.run(duration=whole, time_step=given.step, time_step_output=whole, outfile=None)
        order = np.argsort(model.elements.ID)
        return np.asarray(model.elements.lon)[order], np.asarray(model.elements.lat)[order]

    report(given, f"OpenDrift {opendrift.__version__}", f"RK4, {given.step:g} s", drift)


if __name__ == "__main__":
    main()
