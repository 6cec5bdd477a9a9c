"""The ensemble as one netCDF file: CF-1.10 trajectories, ACDD-1.3 attributes, events and provenance beside them.

Layout: dimensions ``member`` and ``obs`` for the output times, ``surfacing`` for surfacing events, ``waypoint`` for the
waypoints of the plan, ``rule`` for the rules of a mission program. Positions are packed in 32-bit steps of 1e-7 degree
(1 cm), other series are 32-bit floats, so that a file of 5,000 members is written in a fraction of a second; readers
that follow CF unpack by themselves.
A member that ended keeps its last values; ``active`` and ``outcome`` say so.

Interrupted forecasts: :class:`NetcdfWriter` works under ``NAME.partial.nc`` and sets the global attribute ``complete``
to 0 from the start. Only a finished forecast is renamed to ``NAME.nc``, with ``complete`` 1. After SIGTERM (turned into
``Terminated``), Ctrl-C or a track that says it is not complete, the valid partial file stays under its partial name;
after any other error it is removed.
"""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from types import TracebackType

import netCDF4
import numpy as np

from glider_jax.errors import DataError
from glider_jax.products.atomic import check_folder
from glider_jax.products.attributes import global_attributes
from glider_jax.products.coordinates import iso_time
from glider_jax.products.variables import Column, columns, fixed_columns
from glider_jax.records import Track

_CHUNK_BYTES = 1 << 20


def partial_path(path: str | Path) -> Path:
    """The name under which an unfinished forecast lies: ``forecast.nc`` becomes ``forecast.partial.nc``."""
    path = Path(path)
    return path.with_name(f"{path.stem}.partial{path.suffix}")


def write_netcdf(track: Track, path: str | Path, *, compress: bool = False) -> Path:
    """Write one ensemble and return the name it was written under.

    Parameters
    ----------
    track : the ensemble; where ``track.complete`` is False the file is named by :func:`partial_path`.
    path : final name.
    compress : deflate every variable: about half the size and ten times the time.
    """
    with NetcdfWriter(path, members=track.n, compress=compress) as writer:
        writer.append(track)
    return writer.written


class NetcdfWriter:
    """Writes an ensemble block by block, holding one block at a time.

    Parameters
    ----------
    path : final name of the file.
    members : number of members if known; the dimension is unlimited otherwise.
    compress : deflate every variable.

    Use as a context manager, call :meth:`append` for every block, then read ``written`` for the name of the file.
    """

    def __init__(self, path: str | Path, *, members: int | None = None, compress: bool = False) -> None:
        self.final = Path(path)
        self.written = partial_path(path)
        self.members = members
        self.compress = compress
        self.count = 0
        self._dataset: netCDF4.Dataset | None = None
        self._complete = True
        self._first: Track | None = None
        self._columns: tuple[Column, ...] = ()
        self._extent = {"lat": [np.inf, -np.inf], "lon": [np.inf, -np.inf], "depth": [np.inf, -np.inf]}
        check_folder(self.final)

    def __enter__(self) -> NetcdfWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        interrupted = kind is not None and issubclass(kind, KeyboardInterrupt | SystemExit)
        if kind is None or interrupted:
            self.close(complete=kind is None)
        else:
            self.discard()
        if kind is not None and issubclass(kind, OSError | RuntimeError) and not issubclass(kind, DataError):
            raise DataError(
                f"{self.final}: expected a file that can be written, found: {error}. "
                "Free some space or choose another --out."
            ) from error

    def append(self, block: Track) -> None:
        """Add the members of ``block`` after those already written.

        Blocks share times, components, reasons, waypoints and the number of columns for surfacings.
        """
        block = with_surfacing(block)
        if self._dataset is None:
            self._create(block)
        here = slice(self.count, self.count + block.n)
        if self.members is not None and here.stop > self.members:
            raise DataError(f"{self.final}: expected {self.members} members, found at least {here.stop}.")
        surfacings = len(self._dataset.dimensions["surfacing"])
        if block.surfacing_time.shape[1] != surfacings:
            raise DataError(
                f"{self.final}: expected {surfacings} surfacings per member as in the first block, "
                f"found {block.surfacing_time.shape[1]}. Give every block the same number."
            )
        for column in self._columns:
            values = column.values(block, self.count)
            where = (here, *(slice(0, size) for size in values.shape[1:]))
            self._dataset.variables[column.name][where] = values
            for key in self._extent.keys() & {column.name}:
                self._extend(key, values * column.scale)
        self.count += block.n
        self._complete &= block.complete
        self._dataset.setncattr("members_written", np.int32(self.count))
        self._dataset.sync()

    def close(self, *, complete: bool = True) -> Path:
        """Finish the file; without ``complete``, or if members are missing, it keeps its partial name."""
        if self._dataset is None:
            return self.written
        complete = complete and self._complete and self.members in (None, self.count)
        first = replace(self._first, complete=complete)
        self._dataset.setncatts(global_attributes(first, self.count, self._extent, self.final.stem))
        self._dataset.close()
        self._dataset = None
        with open(partial_path(self.final), "rb+") as stream:
            os.fsync(stream.fileno())
        if complete:
            os.replace(partial_path(self.final), self.final)
            self.written = self.final
        return self.written

    def state(self) -> dict:
        """What :meth:`take_up` needs to go on with this file from here."""
        return {"count": self.count, "complete": self._complete, "extent": self._extent}

    def take_up(self, state: dict, block: Track) -> None:
        """Go on with the partial file of an interrupted forecast; rows after those counted are written again.

        Parameters
        ----------
        state : from :meth:`state`.  block : one that was written to the file.

        Raises
        ------
        DataError : the partial file is gone or cannot be opened.
        """
        path = partial_path(self.final)
        try:
            # The library would make a file that is not there.
            path.stat()
            self._dataset = netCDF4.Dataset(path, "r+")
        except OSError as error:
            raise DataError(
                f"{path}: expected the unfinished file that the checkpoint belongs to, found: "
                f"{error.strerror or error}. Leave out --resume to start anew."
            ) from error
        block = with_surfacing(block)
        self.count, self._complete, self._extent = state["count"], state["complete"], state["extent"]
        self._first, self._columns = take_none(block), columns(block)
        for column in self._columns:
            self._dataset.variables[column.name].set_auto_maskandscale(False)

    def discard(self) -> None:
        """Close and remove the unfinished file."""
        if self._dataset is not None:
            self._dataset.close()
            self._dataset = None
        partial_path(self.final).unlink(missing_ok=True)

    def _extend(self, key: str, values: np.ndarray) -> None:
        if values.size:
            low, high = self._extent[key]
            self._extent[key] = [min(low, float(values.min())), max(high, float(values.max()))]

    def _create(self, block: Track) -> None:
        try:
            dataset = netCDF4.Dataset(partial_path(self.final), "w", format="NETCDF4")
        except OSError as error:
            raise DataError(
                f"{self.final}: expected a file that can be written, found: {error.strerror or error}. "
                "Choose another --out."
            ) from error
        self._dataset, self._first, self._columns = dataset, take_none(block), columns(block)
        dataset.set_fill_off()
        dataset.createDimension("member", self.members)
        for name, size in (
            ("obs", block.time.size),
            ("surfacing", block.surfacing_time.shape[1]),
            ("waypoint", block.waypoints.shape[0]),
            ("name_strlen", 12),
            *((("rule", len(block.program)),) if block.program else ()),
        ):
            dataset.createDimension(name, max(int(size), 1))
        for column in self._columns:
            variable = self._declare(column, block.n)
            variable.set_auto_maskandscale(False)
        for name, dims, dtype, values, attributes in fixed_columns(block):
            variable = dataset.createVariable(name, dtype, dims)
            variable.setncatts(attributes)
            variable[...] = values
        dataset.setncatts({"Conventions": "CF-1.10, ACDD-1.3", "complete": np.int32(0)})

    def _declare(self, column: Column, block_size: int) -> netCDF4.Variable:
        """Create one per-member variable with chunks of about a megabyte."""
        dims = ("member", *column.dims)
        inner = [len(self._dataset.dimensions[name]) for name in column.dims]
        row = np.dtype(column.dtype).itemsize * int(np.prod(inner, dtype=int))
        rows = max(1, min(self.members or block_size, _CHUNK_BYTES // row))
        options = {"zlib": True, "complevel": 1} if self.compress or column.repetitive else {}
        variable = self._dataset.createVariable(
            column.name, column.dtype, dims, chunksizes=(rows, *inner), fill_value=column.fill, **options
        )
        variable.setncatts(column.attributes)
        return variable


def with_surfacing(block: Track) -> Track:
    """The block, or one with an empty column for surfacings where it has none: netCDF dimensions are not empty."""
    if block.surfacing_time.shape[1]:
        return block
    nothing = np.full((block.n, 1), np.nan)
    names = [f"{event}_{part}" for event in ("surfacing", "dive") for part in ("time", "latitude", "longitude")]
    return replace(block, surfacing_reason=np.full((block.n, 1), -1, np.int8), **dict.fromkeys(names, nothing))


def take_none(track: Track) -> Track:
    """The track without its members: times, names, settings and notes for the attributes of the file."""
    members = {
        name: value[:0]
        for name, value in vars(track).items()
        if isinstance(value, np.ndarray) and name not in ("time", "waypoints")
    }
    return replace(track, parameters={}, **members)


def read_settings(path: str | Path) -> dict:
    """The settings and the state of completion that a forecast file carries."""
    with netCDF4.Dataset(path) as dataset:
        settings = json.loads(dataset.getncattr("settings"))
        return {
            "settings": settings,
            "complete": bool(dataset.getncattr("complete")),
            "reference_time": iso_time(float(dataset["forecast_reference_time"][...])),
        }
