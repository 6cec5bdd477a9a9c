"""Finding things in the files of one ROMS run: variables by shape, model parameters, times of a field.

netCDF4 and NumPy only. A newcomer would get wrong: one model's history, climatology, initial and grid files name
their dimensions differently and each leaves something out, so a variable is taken from whichever file of the list
holds it in the right shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import netCDF4
import numpy as np

from glider_jax.errors import DataError
from glider_jax.readers.grids import attribute, decode_time, open_netcdf, text_attribute, unpack
from glider_jax.records import Array, Source


@dataclass
class RomsFile:
    """One opened file: its path and the data set, read without automatic masks and scales."""

    path: Path
    data: netCDF4.Dataset

    @property
    def name(self) -> str:
        """File name without its folder."""
        return self.path.name

    def shape(self, name: str) -> tuple[int, ...] | None:
        """Shape of a variable, None where the file does not hold it."""
        variable = self.data.variables.get(name)
        return None if variable is None else variable.shape

    def values(self, name: str, key: object = ...) -> Array:
        """A variable as float64; fill values, declared or not (1e37), become NaN."""
        variable = self.data.variables[name]
        values, _ = unpack(variable, np.asarray(variable[key]))
        return np.where(np.abs(values) > 1e20, np.nan, values)


@dataclass
class RomsFiles:
    """Several files of one model run, used as one: fields from the listed files, the grid from any of them.

    ``notes`` collects what was assumed. Use as a context manager, so that the files are closed.
    """

    fields: list[RomsFile]
    grid: RomsFile | None
    stack: ExitStack
    notes: list[str] = field(default_factory=list)

    @staticmethod
    def open(paths: str | Path | Sequence[str | Path], grid: str | Path | None = None) -> RomsFiles:
        """Open the files.

        Raises
        ------
        DataError : no path is given, or a file is missing or not NetCDF.
        """
        listed = [paths] if isinstance(paths, str | Path) else list(paths)
        if not listed:
            raise DataError("ROMS files: expected at least one path, found none. Name a history file.")
        with ExitStack() as stack:
            unique = [Path(path) for path in dict.fromkeys(map(str, listed))]
            fields = [RomsFile(path, stack.enter_context(open_netcdf(path))) for path in unique]
            extra = None
            if grid is not None:
                extra = RomsFile(Path(grid), stack.enter_context(open_netcdf(grid)))
            return RomsFiles(fields, extra, stack.pop_all())

    def __enter__(self) -> RomsFiles:
        return self

    def __exit__(self, *exception: object) -> bool | None:
        return self.stack.__exit__(*exception)  # type: ignore[arg-type]

    @property
    def all(self) -> list[RomsFile]:
        """The grid file first, then the field files."""
        return ([self.grid] if self.grid else []) + self.fields

    @property
    def names(self) -> str:
        """File names for messages."""
        names = list(dict.fromkeys(file.name for file in self.all))
        return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")

    def note(self, *sentences: str) -> None:
        """Remember assumptions, each once."""
        self.notes += [sentence for sentence in dict.fromkeys(sentences) if sentence not in self.notes]

    def source(self, product: str) -> Source:
        """Provenance of everything that was opened, with the notes."""
        return Source(product, {str(f.path): Source.digest(f.path) for f in self.all}, tuple(self.notes))

    def holding(self, name: str, shape: tuple[int, ...] | None = None) -> RomsFile | None:
        """The first file with a variable of this name whose trailing dimensions have this shape."""
        for file in self.all:
            found = file.shape(name)
            if found is not None and (shape is None or found[-len(shape) :] == shape):
                return file
        return None

    def scalar(self, *names: str) -> float | None:
        """A model parameter from a variable or global attribute of any file, None where nobody tells."""
        for name in names:
            for file in self.all:
                if file.shape(name) is not None:
                    found = file.values(name).ravel()
                elif name in file.data.ncattrs():
                    found = np.ravel(file.data.getncattr(name))
                else:
                    continue
                if found.size and np.issubdtype(found.dtype, np.number) and np.isfinite(found[0]):
                    return float(found[0])
        return None

    def times(self, file: RomsFile, name: str) -> Array:
        """Times (seconds since 1970) along the first dimension of a field.

        The time variable is the one named in the field's ``time`` attribute, the one named as its first
        dimension, or ``ocean_time``, whichever has the right length. "days" alone are Modified Julian Dates.

        Raises
        ------
        DataError : there is none, or it does not hold dates.
        """
        variable = file.data.variables[name]
        candidates = [text_attribute(variable, "time"), variable.dimensions[0], "ocean_time", "time"]
        candidates = list(dict.fromkeys(filter(None, candidates)))
        for candidate in candidates:
            time = file.data.variables.get(candidate)
            if time is None or time.size != variable.shape[0] or time.ndim > 1:
                continue
            calendar = text_attribute(time, "calendar").lower()
            where = f"{file.name}: variable '{candidate}'"
            seconds, notes = decode_time(
                np.ravel(time[...]),
                attribute(time, "units"),
                "proleptic_gregorian" if calendar == "gregorian_proleptic" else calendar or None,
                where=where,
                fill=attribute(time, "_FillValue"),
            )
            # Without the file's name the same remark on many files is one note.
            self.note(*(note.removeprefix(f"{file.name}: ") for note in notes))
            return seconds
        raise DataError(
            f"{file.name}: variable '{name}': expected a time variable of length {variable.shape[0]} "
            f"({', '.join(candidates)}), found none. Add ocean_time to the file."
        )
