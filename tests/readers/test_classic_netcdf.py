"""The size check of classic NetCDF files against files that the library itself wrote."""

from __future__ import annotations

import netCDF4
import numpy as np
import pytest

from glider_jax.errors import DataError
from glider_jax.readers.classic_netcdf import check_whole, needed_size

FORMATS = ("NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA")


@pytest.mark.parametrize("file_format", FORMATS)
@pytest.mark.parametrize("kinds", [("f8",), ("i2",), ("i1", "f4", "S1"), ("i2", "i1", "f8")])
def test_the_size_of_files_with_records(tmp_path, file_format, kinds):
    path = tmp_path / "a.nc"
    with netCDF4.Dataset(path, "w", format=file_format) as file:
        file.title = "five"
        file.createDimension("time", None)
        file.createDimension("x", 3)
        fixed = file.createVariable("fixed", "i2", ("x",))
        fixed.setncatts({"odd": np.array([1, 2, 3], "i2"), "words": "abcde"})
        fixed[:] = 1
        for n, kind in enumerate(kinds):
            variable = file.createVariable(f"v{n}", kind, ("time", "x"))
            variable[:4] = np.full((4, 3), b"a") if kind == "S1" else np.ones((4, 3))
    content = path.read_bytes()
    # Writers may pad the end of the last variable, never by more than three bytes.
    assert needed_size(content) <= len(content) <= needed_size(content) + 3
    check_whole(path)
    path.write_bytes(content[: needed_size(content) - 1])
    with pytest.raises(DataError, match="cut off"):
        check_whole(path)
    path.write_bytes(content[:60])
    with pytest.raises(DataError, match="damaged header"):
        check_whole(path)


def test_other_files_pass(tmp_path):
    (tmp_path / "a").write_bytes(b"\x89HDF")
    check_whole(tmp_path / "a")


def test_real_classic_files_are_whole(real):
    for path in sorted(real("environment").rglob("*.nc")):
        check_whole(path)
