"""Small ROMS files with known answers, in the layouts that real ones have: staggered, rotated, filled on land."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import netCDF4
import numpy as np

from glider_jax.readers.roms_vertical import VerticalCoordinate, s_levels, stretching_curve

METRES = 111_320.0  # per degree of latitude in these plane worlds
LAND_FILL = 77.0  # m s-1, the invented current on land


@dataclass
class World:
    """A plane grid turned by ``angle`` about its first point, with a flat or given bottom and a block of land.

    ``current(x, y, depth)`` gives velocity east and north at metres east and north of the grid's middle.
    """

    ny: int = 24
    nx: int = 30
    step: tuple[float, float] = (4000.0, 5000.0)
    angle: float = np.radians(36.0)
    latitude: float = 1.0
    longitude: float = -72.0
    n: int = 12
    transform: int = 2
    stretching: int = 4
    theta: tuple[float, float] = (5.0, 0.4)
    hc: float = 20.0
    depth: float = 100.0
    zeta: float = 0.0
    land: tuple[slice, slice] | None = None
    times: tuple[float, ...] = (56228.0, 56229.0)
    omega: float = 2e-6
    skip: set[str] = field(default_factory=set)

    def positions(self, shift_x: float = 0.0, shift_y: float = 0.0, shape: tuple[int, int] | None = None):
        """Metres east and north of the middle, for points shifted by parts of a cell."""
        ny, nx = shape or (self.ny, self.nx)
        along = (np.arange(nx) + shift_x - (self.nx - 1) / 2) * self.step[0]
        up = (np.arange(ny) + shift_y - (self.ny - 1) / 2) * self.step[1]
        xi, eta = np.meshgrid(along, up)
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        return xi * cosine - eta * sine, xi * sine + eta * cosine

    def degrees(self, x, y):
        """Longitude and latitude of plane positions."""
        return self.longitude + x / (METRES * np.cos(np.radians(self.latitude))), self.latitude + y / METRES

    def metres(self, lon, lat):
        """The inverse of :meth:`degrees`."""
        x = (lon - self.longitude) * METRES * np.cos(np.radians(self.latitude))
        return x, (lat - self.latitude) * METRES

    def current(self, x, y, depth, time: float = 0.0):
        """Solid-body rotation, weaker with depth and stronger with every frame."""
        factor = self.omega * (1 - depth / 400.0) * (1 + time)
        return -factor * y, factor * x

    @property
    def sea(self):
        """True at sea."""
        sea = np.ones((self.ny, self.nx), bool)
        if self.land is not None:
            sea[self.land] = False
        return sea

    @property
    def vertical(self) -> VerticalCoordinate:
        """The coordinate the files are written with."""
        s, w = s_levels(self.n, self.stretching), s_levels(self.n, self.stretching, True)
        curves = (stretching_curve(self.stretching, *self.theta, part) for part in (s, w))
        return VerticalCoordinate(self.transform, self.hc, s, next(curves), w, next(curves))

    def write_grid(self, path: Path, names: tuple[str, str] = ("eta_rho", "xi_rho")) -> Path:
        """A grid file: positions, depth, masks, angle."""
        with netCDF4.Dataset(path, "w") as data:
            self._put_grid(data, *names)
        return path

    def _put_grid(self, data, eta: str, xi: str) -> None:
        lon, lat = self.degrees(*self.positions())
        sea = self.sea
        fields = {
            "lon_rho": lon,
            "lat_rho": lat,
            "h": np.full(lon.shape, self.depth),
            "mask_rho": sea.astype(float),
            "angle": np.full(lon.shape, self.angle),
        }
        for name, size in ((eta, self.ny), (xi, self.nx)):
            if name not in data.dimensions:
                data.createDimension(name, size)
        for name, values in fields.items():
            if name not in self.skip:
                data.createVariable(name, "f8", (eta, xi))[:] = values
        for name, mask in (("mask_u", sea[:, 1:] & sea[:, :-1]), ("mask_v", sea[1:] & sea[:-1])):
            if name not in self.skip:
                dims = tuple(f"{name}_{axis}" for axis in "yx")
                for dim, size in zip(dims, mask.shape, strict=True):
                    data.createDimension(dim, size)
                data.createVariable(name, "f8", dims)[:] = mask

    def write_parameters(self, path: Path) -> Path:
        """A file with the vertical coordinate alone."""
        with netCDF4.Dataset(path, "w") as data:
            self._put_vertical(data, "s_rho", "s_w")
        return path

    def _put_vertical(self, data, s: str, w: str) -> None:
        vertical = self.vertical
        data.createDimension("one", 1)
        for name, size in ((s, self.n), (w, self.n + 1)):
            if name not in data.dimensions:
                data.createDimension(name, size)
        for name, dim, values in (
            (s, s, vertical.s),
            (w, w, vertical.s_interface),
            ("Cs_r", s, vertical.c),
            ("Cs_w", w, vertical.c_interface),
        ):
            if name not in self.skip:
                data.createVariable(name, "f8", (dim,))[:] = values
        for name, value in (
            ("Vtransform", self.transform),
            ("Vstretching", self.stretching),
            ("theta_s", self.theta[0]),
            ("theta_b", self.theta[1]),
            ("hc", self.hc),
            ("Tcline", self.hc),
        ):
            if name not in self.skip:
                data.createVariable(name, "f8", ("one",))[:] = value

    def write(self, path: Path, *, whole: bool = True, odd_names: bool = False, units: str = "days") -> Path:
        """A history file, with grid and vertical coordinate (``whole``) or with fields alone."""
        s, t = ("sc_r", "time") if odd_names else ("s_rho", "ocean_time")
        rho = ("erho", "xrho") if odd_names else ("eta_rho", "xi_rho")
        with netCDF4.Dataset(path, "w") as data:
            for name, size in (
                (t, len(self.times)),
                (s, self.n),
                (rho[0], self.ny),
                (rho[1], self.nx),
                ("eu", self.ny),
                ("xu", self.nx - 1),
                ("ev", self.ny - 1),
                ("xv", self.nx),
            ):
                data.createDimension(name, size)
            if whole:
                self._put_grid(data, *rho)
                self._put_vertical(data, s, "sc_w" if odd_names else "s_w")
            time = data.createVariable("ocean_time", "f8", (t,))
            time.units = units
            time[:] = self.times
            if "zeta" not in self.skip:
                data.createVariable("zeta", "f4", (t, *rho))[:] = self.zeta
            sea = self.sea
            masks = {"u": sea[:, 1:] & sea[:, :-1], "v": sea[1:] & sea[:-1]}
            for name, dims, shift, shape in (
                ("u", ("eu", "xu"), (0.5, 0.0), (self.ny, self.nx - 1)),
                ("v", ("ev", "xv"), (0.0, 0.5), (self.ny - 1, self.nx)),
            ):
                variable = data.createVariable(name, "f8", (t, s, *dims))
                variable.units = "meter second-1"
                x, y = self.positions(*shift, shape)
                depths = self.vertical.depths(np.full(x.shape, self.depth), self.zeta)
                for frame in range(len(self.times)):
                    east, north = self.current(x, y, depths, frame)
                    turn = east * np.cos(self.angle) + north * np.sin(self.angle)
                    if name == "v":
                        turn = -east * np.sin(self.angle) + north * np.cos(self.angle)
                    variable[frame] = np.where(masks[name], turn, LAND_FILL)
            for name, values in (("temp", 20.0), ("salt", 33.0)):
                x, _ = self.positions()
                depths = self.vertical.depths(np.full(x.shape, self.depth), self.zeta)
                variable = data.createVariable(name, "f8", (t, s, *rho))
                sign = -0.1 if name == "temp" else 0.02
                variable[:] = np.where(sea, values + sign * depths, 99.0)[None]
        return path
