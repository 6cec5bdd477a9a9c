"""What every reader of gridded NetCDF files shares: coordinates, time, units and packed values.

NumPy, netCDF4 and scipy only. A newcomer would get wrong: coordinates must be read raw, because products
declare fill values (0) that are legal coordinate values.
"""

from __future__ import annotations

from glider_jax.readers.curvilinear import CurvilinearWeights as CurvilinearWeights
from glider_jax.readers.curvilinear import regrid_curvilinear as regrid_curvilinear
from glider_jax.readers.curvilinear import regular_axes as regular_axes
