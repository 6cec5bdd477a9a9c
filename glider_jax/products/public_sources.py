"""Public sources of currents, seafloor and recordings, and how a box of each is asked for.

ERDDAP says what a data set holds (``info``), so requests follow the order, direction and reach of its own axes; THREDDS
is asked through its netCDF subset service. Standard library only; nothing here touches the network.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from urllib.parse import quote, urlencode

from glider_jax.errors import CoverageError, DataError, did_you_mean

Box = tuple[float, float, float, float]
Period = tuple[float, float]


@dataclass(frozen=True)
class PublicSource:
    """One public data set: where it is, what is asked of it, and which option of a forecast takes the file.

    ``protocol`` is ``griddap`` or ``tabledap`` (ERDDAP) or ``ncss`` (THREDDS). ``variables`` must be there,
    ``optional`` ones are taken where they are. ``area`` is south, north, west, east in degrees, for the list only.
    ``timed`` sources need a period. ``credit`` is to be named where the data are used.
    """

    name: str
    title: str
    kind: str
    protocol: str
    server: str
    dataset: str
    variables: tuple[str, ...]
    optional: tuple[str, ...] = ()
    area: Box = (-90.0, 90.0, -180.0, 180.0)
    timed: bool = False
    option: str = ""
    credit: str = ""


_COASTWATCH = "https://coastwatch.pfeg.noaa.gov/erddap"
_RUTGERS = "https://tds.marine.rutgers.edu/thredds"
SOURCES = {
    source.name: source
    for source in (
        PublicSource(
            "etopo2022", "ETOPO 2022 relief, 15 arc-seconds, world", "bathymetry", "griddap", _COASTWATCH,
            "ETOPO_2022_v1_15s", ("z",), option="--bathymetry",
            credit="NOAA National Centers for Environmental Information",
        ),
        PublicSource(
            "srtm30", "SRTM30+ relief version 6, 30 arc-seconds, world", "bathymetry", "griddap", _COASTWATCH,
            "usgsCeSrtm30v6", ("topo",), option="--bathymetry", credit="Scripps Institution of Oceanography and USGS",
        ),
        PublicSource(
            "crm-northeast", "Coastal Relief Model volume 1, 3 arc-seconds, north of 40 N", "bathymetry", "griddap",
            _COASTWATCH, "usgsCeCrm1", ("topo",), area=(40.0, 48.0, -80.0, -64.0), option="--bathymetry",
            credit="NOAA National Centers for Environmental Information",
        ),
        PublicSource(
            "crm-southeast", "Coastal Relief Model volume 2, 3 arc-seconds, 31 to 40 N", "bathymetry", "griddap",
            _COASTWATCH, "usgsCeCrm2", ("topo",), area=(31.0, 40.0, -85.0, -68.0), option="--bathymetry",
            credit="NOAA National Centers for Environmental Information",
        ),
        PublicSource(
            "hfrnet-east", "HFRNet surface currents, hourly, 6 km, US East and Gulf coasts", "currents", "griddap",
            _COASTWATCH, "ucsdHfrE6", ("water_u", "water_v"), ("DOPx", "DOPy"), (21.7, 46.5, -97.9, -57.2), True,
            "--currents", "NOAA IOOS HF-Radar Network, Scripps Institution of Oceanography",
        ),
        PublicSource(
            "hfrnet-west", "HFRNet surface currents, hourly, 6 km, US West coast", "currents", "griddap",
            _COASTWATCH, "ucsdHfrW6", ("water_u", "water_v"), ("DOPx", "DOPy"), (30.3, 50.0, -130.4, -115.8), True,
            "--currents", "NOAA IOOS HF-Radar Network, Scripps Institution of Oceanography",
        ),
        PublicSource(
            "maracoos", "MARACOOS surface currents, hourly, 6 km, Mid-Atlantic Bight", "currents", "griddap",
            "https://hfr.marine.rutgers.edu/erddap", "5MHz_6km_realtime-agg_archive_v00", ("u", "v"),
            ("u_err", "v_err", "uv_covariance", "num_radials", "number_of_radials", "qc_primary_flag"),
            (33.8, 43.9, -77.9, -66.6), True, "--currents", "MARACOOS, Rutgers University, U.S. IOOS",
        ),
        PublicSource(
            "doppio", "DOPPIO forecast (ROMS, 7 km, 40 levels), Mid-Atlantic and Gulf of Maine", "currents", "ncss",
            _RUTGERS, "roms/doppio/2017_da/his/History_Best",
            ("u", "v", "h", "zeta", "angle", "mask_rho", "mask_u", "mask_v"), (), (32.2, 46.6, -80.5, -59.7), True,
            "--currents", "Rutgers Ocean Modeling Group",
        ),
        PublicSource(
            "ioos-gliders", "IOOS glider data assembly center: profiles and currents of one deployment", "recordings",
            "tabledap", "https://gliders.ioos.us/erddap", "", ("time", "latitude", "longitude", "depth"),
            ("profile_id", "time_uv", "lat_uv", "lon_uv", "u", "v", "temperature", "salinity", "pressure"),
            option="recording", credit="U.S. IOOS National Glider Data Assembly Center and the glider's operator",
        ),
    )
}  # fmt: skip


def source_of(name: str) -> PublicSource:
    """The source of a name.

    Raises
    ------
    DataError : no source is called so.
    """
    if name not in SOURCES:
        raise DataError(
            f"data: expected one of {', '.join(SOURCES)}, found '{name}'.{did_you_mean(name, SOURCES)} "
            "List them with: glider-forecast data list."
        )
    return SOURCES[name]


@dataclass(frozen=True)
class Axis:
    """A dimension of a data set: its ends, ascending, and whether it is stored descending."""

    name: str
    low: float
    high: float
    descending: bool = False


@dataclass(frozen=True)
class Info:
    """What ERDDAP says of a data set: axes in their order, and the axes of each variable."""

    axes: dict[str, Axis] = field(default_factory=dict)
    variables: dict[str, tuple[str, ...]] = field(default_factory=dict)


def info_url(source: PublicSource, server: str) -> str:
    """Address of ERDDAP's description of a data set."""
    return f"{server}/info/{quote(source.dataset)}/index.csv"


def parse_info(text: str, where: str) -> Info:
    """Read ERDDAP's description.

    Raises
    ------
    DataError : the text is no such description.
    """
    rows = list(csv.reader(io.StringIO(text)))
    if not rows or [cell.strip() for cell in rows[0][:2]] != ["Row Type", "Variable Name"]:
        raise DataError(f"{where}: expected ERDDAP's description of a data set, found other text. Check --server.")
    spacing: dict[str, str] = {}
    ranges: dict[str, tuple[float, float]] = {}
    variables: dict[str, tuple[str, ...]] = {}
    for row in rows[1:]:
        if len(row) < 5:
            continue
        kind, name, attribute, _, value = row[:5]
        if kind == "dimension":
            spacing[name] = value
        elif kind == "variable":
            variables[name] = tuple(part.strip() for part in value.split(",") if part.strip())
        elif kind == "attribute" and attribute == "actual_range":
            numbers = _numbers(value)
            if len(numbers) == 2:
                ranges[name] = (numbers[0], numbers[1])
    axes = {}
    for name, value in spacing.items():
        first, last = ranges.get(name, (-math.inf, math.inf))
        axes[name] = Axis(name, min(first, last), max(first, last), first > last or "averageSpacing=-" in value)
    return Info(axes, variables)


def _numbers(text: str) -> list[float]:
    found = []
    for part in text.split(","):
        try:
            found.append(float(part))
        except ValueError:
            return []
    return found


def iso(seconds: float) -> str:
    """A time as ERDDAP and THREDDS take it."""
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def griddap_url(source: PublicSource, server: str, info: Info, box: Box, period: Period | None, stride: int = 1) -> str:
    """Request for a box as netCDF; only what lies within the data set is asked for.

    Raises
    ------
    DataError : a variable is missing, or a period that is needed.
    CoverageError : the box or period lies outside.
    """
    chosen = _chosen(source, info)
    parts = []
    for variable in chosen:
        brackets = "".join(
            f"[{_slice(source, info.axes[name], box, period, stride)}]" for name in info.variables[variable]
        )
        parts.append(variable + brackets)
    # Brackets and parentheses are not allowed in addresses, and strict servers say so.
    return f"{server}/griddap/{quote(source.dataset)}.nc?{quote(','.join(parts), safe='')}"


def _chosen(source: PublicSource, info: Info) -> list[str]:
    missing = [name for name in source.variables if name not in info.variables]
    if missing:
        raise DataError(
            f"{source.name}: expected the variable '{missing[0]}' in '{source.dataset}', found "
            f"{', '.join(info.variables) or 'none'}.{did_you_mean(missing[0], info.variables)} The server may have "
            "changed its data set; report this."
        )
    first = info.variables[source.variables[0]]
    # Variables along other axes cannot be asked for in one request.
    return [*source.variables, *(n for n in source.optional if info.variables.get(n) == first)]


def _slice(source: PublicSource, axis: Axis, box: Box, period: Period | None, stride: int) -> str:
    south, north, west, east = box
    if axis.name in ("latitude", "lat"):
        return _bounds(source, axis, south, north, stride, "latitude")
    if axis.name in ("longitude", "lon"):
        turn = 360.0 * math.ceil((axis.low - east) / 360.0) if east < axis.low else 0.0
        turn = -360.0 * math.ceil((west - axis.high) / 360.0) if west > axis.high else turn
        return _bounds(source, axis, west + turn, east + turn, stride, "longitude")
    if axis.name == "time":
        if period is None:
            raise DataError(f"{source.name}: expected a period, found none. Give --start and --days, or --mission.")
        return _bounds(source, axis, *period, 1, "time")
    return "0"


def _bounds(source: PublicSource, axis: Axis, low: float, high: float, stride: int, what: str) -> str:
    """``(first):stride:(last)`` in the stored direction, cut to the data set."""
    words = iso if what == "time" else lambda value: f"{value:g}"
    if high < axis.low or low > axis.high:
        raise CoverageError(
            f"{source.name}: expected a {what} between {words(axis.low)} and {words(axis.high)}, found {words(low)} to "
            f"{words(high)}. Ask for another box or time, or another source."
        )
    ends = [max(low, axis.low), min(high, axis.high)]
    if axis.descending:
        ends.reverse()
    shown = [iso(v) if what == "time" else f"{v:.6f}" for v in ends]
    return f"({shown[0]}):{stride}:({shown[1]})"


def ncss_url(source: PublicSource, server: str, box: Box, period: Period, stride: int = 1) -> str:
    """Request to THREDDS' netCDF subset service."""
    south, north, west, east = box
    words: list[tuple[str, str]] = [("var", name) for name in source.variables]
    words += [("north", f"{north:g}"), ("west", f"{west:g}"), ("east", f"{east:g}"), ("south", f"{south:g}")]
    words += [("disableProjSubset", "on"), ("horizStride", str(stride))]
    words += [("time_start", iso(period[0])), ("time_end", iso(period[1])), ("timeStride", "1")]
    words += [("addLatLon", "true"), ("accept", "netcdf")]
    return f"{server}/ncss/{source.dataset}?{urlencode(words)}"


def tabledap_url(source: PublicSource, server: str, dataset: str, info: Info, period: Period | None) -> str:
    """Request for the rows of one deployment as netCDF, within a period if one is given."""
    chosen = _chosen_columns(source, dataset, info)
    rules = "" if period is None else f"&time>={iso(period[0])}&time<={iso(period[1])}"
    return f"{server}/tabledap/{quote(dataset)}.nc?{quote(','.join(chosen) + rules, safe='&=')}"


def _chosen_columns(source: PublicSource, dataset: str, info: Info) -> list[str]:
    missing = [name for name in source.variables if name not in info.variables]
    if missing:
        raise DataError(
            f"{source.name}: expected the variable '{missing[0]}' in '{dataset}', found "
            f"{', '.join(info.variables) or 'none'}. Choose another --dataset."
        )
    return [*source.variables, *(name for name in source.optional if name in info.variables)]


def deployments_url(source: PublicSource, server: str, box: Box, period: Period | None) -> str:
    """Request for the deployments that touch a box and a period."""
    south, north, west, east = box
    rules = f"&maxLatitude>={south:g}&minLatitude<={north:g}&maxLongitude>={west:g}&minLongitude<={east:g}"
    if period is not None:
        rules += f"&maxTime>={iso(period[0])}&minTime<={iso(period[1])}"
    columns = "datasetID,title,minTime,maxTime,institution"
    return f"{server}/tabledap/allDatasets.csv0?{quote(columns + rules, safe='&=')}"


def parse_deployments(text: str) -> list[Mapping[str, str]]:
    """Rows of the list of deployments, newest first."""
    names = ("dataset", "title", "begin", "end", "institution")
    rows = [dict(zip(names, row, strict=False)) for row in csv.reader(io.StringIO(text)) if len(row) >= 4]
    return sorted((row for row in rows if row["dataset"] != "allDatasets"), key=lambda row: row["begin"], reverse=True)
