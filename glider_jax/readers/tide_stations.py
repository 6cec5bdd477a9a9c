"""Sea level at tide stations from harmonic constants, with astronomic arguments and nodal factors of our own.

Standard library and NumPy only. A newcomer would get wrong: station phases are Greenwich phases of the equilibrium
tide, unlike those of a ROMS forcing file, so the argument V, the nodal angle u and factor f of the date belong in.

Notes
-----
``h(t) = sum f A cos(V(t) + u - g)`` above mean sea level, with V a sum of whole multiples of the mean longitudes of
moon (s), sun (h), lunar perigee (p) and solar perigee, and of the lunar day.

References
----------
Meeus (1991), Astronomical Algorithms, chapters 21 and 45: mean longitudes.
Doodson and Warburg (1941), Admiralty Manual of Tides; Pugh (1987), Tides, Surges and Mean Sea-Level, table 4.3:
nodal factors as series in the longitude of the lunar node.
Schureman (1958), Manual of Harmonic Analysis and Prediction of Tides: arguments, also of S1 and SA.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from glider_jax.errors import DataError
from glider_jax.records import Array, Source

J2000 = 946728000.0  # 2000-01-01T12:00Z in seconds since 1970
CENTURY = 36525.0 * 86400.0

# Multiples of (lunar day, s, h, p, solar perigee), phase in cycles, and whose nodal factor is used.
BASIC: dict[str, tuple[tuple[int, int, int, int, int], float, str]] = {
    "M2": ((2, 0, 0, 0, 0), 0.0, "M2"),
    "S2": ((2, 2, -2, 0, 0), 0.0, ""),
    "N2": ((2, -1, 0, 1, 0), 0.0, "M2"),
    "K2": ((2, 2, 0, 0, 0), 0.0, "K2"),
    "2N2": ((2, -2, 0, 2, 0), 0.0, "M2"),
    "MU2": ((2, -2, 2, 0, 0), 0.0, "M2"),
    "NU2": ((2, -1, 2, -1, 0), 0.0, "M2"),
    "L2": ((2, 1, 0, -1, 0), 0.5, "L2"),
    "LAM2": ((2, 1, -2, 1, 0), 0.5, "M2"),
    "T2": ((2, 2, -3, 0, 1), 0.0, ""),
    "R2": ((2, 2, -1, 0, -1), 0.5, ""),
    "K1": ((1, 1, 0, 0, 0), 0.25, "K1"),
    "O1": ((1, -1, 0, 0, 0), -0.25, "O1"),
    "P1": ((1, 1, -2, 0, 0), -0.25, ""),
    "Q1": ((1, -2, 0, 1, 0), -0.25, "O1"),
    "2Q1": ((1, -3, 0, 2, 0), -0.25, "O1"),
    "RHO": ((1, -2, 2, -1, 0), -0.25, "O1"),
    "J1": ((1, 2, 0, -1, 0), 0.25, "J1"),
    "OO1": ((1, 3, 0, 0, 0), 0.25, "OO1"),
    "S1": ((1, 1, -1, 0, 0), 0.5, ""),
    "M3": ((3, 0, 0, 0, 0), 0.5, "M3"),
    "MM": ((0, 1, 0, -1, 0), 0.0, "MM"),
    "MF": ((0, 2, 0, 0, 0), 0.0, "MF"),
    "MSF": ((0, 2, -2, 0, 0), 0.0, "M2"),
    "SSA": ((0, 0, 2, 0, 0), 0.0, ""),
    "SA": ((0, 0, 1, 0, 0), 0.0, ""),
}
# Shallow-water constituents as sums of others.
COMPOUND: dict[str, dict[str, int]] = {
    "M4": {"M2": 2},
    "M6": {"M2": 3},
    "M8": {"M2": 4},
    "S4": {"S2": 2},
    "S6": {"S2": 3},
    "MS4": {"M2": 1, "S2": 1},
    "MN4": {"M2": 1, "N2": 1},
    "MK3": {"M2": 1, "K1": 1},
    "2MK3": {"M2": 2, "K1": -1},
    "2SM2": {"S2": 2, "M2": -1},
}
# M1 is left out: producers disagree on its argument and nodal factor, and it is a few millimetres.
ALIASES = {"RHO1": "RHO", "LDA2": "LAM2", "LAMBDA2": "LAM2", "MO3": "2MK3"}


@dataclass(frozen=True)
class TideStation:
    """Harmonic constants of one place.

    ``amplitude`` (n,) m and ``phase`` (n,) rad, Greenwich; ``mean_level`` m is mean sea level above the chart datum,
    NaN where the file does not tell.
    """

    name: str
    latitude: float
    longitude: float
    constituents: tuple[str, ...]
    amplitude: Array
    phase: Array
    mean_level: float
    source: Source


def read_tide_station(path: str | Path) -> TideStation:
    """Read the harmonic constants of a tide station from JSON.

    Parameters
    ----------
    path : file with ``latitude``, ``longitude`` and ``harmonic_constituents``, each with ``name``, ``amplitude`` (m)
        and ``phase`` (degrees, Greenwich).

    Raises
    ------
    DataError : the file is not such JSON, or lists no constituent we know.
    """
    path = Path(path)
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        rows = [
            (str(c["name"]).upper(), float(c["amplitude"]), float(c["phase"])) for c in data["harmonic_constituents"]
        ]
        place = float(data["latitude"]), float(data["longitude"])
    except OSError as problem:
        raise DataError(
            f"{path}: expected a tide station in JSON, found {problem.strerror}. Check the path."
        ) from problem
    except (ValueError, KeyError, TypeError) as problem:
        raise DataError(
            f"{path}: expected JSON with latitude, longitude and harmonic_constituents of name, amplitude and phase, "
            f"found none ({type(problem).__name__}: {problem}). Name the file of a reference station."
        ) from problem
    rows = [(ALIASES.get(name, name), amplitude, phase) for name, amplitude, phase in rows]
    known = [row for row in rows if row[0] in BASIC or row[0] in COMPOUND]
    left = [
        f"{name} ({amplitude:.3f} m)" for name, amplitude, _ in rows if (name not in BASIC and name not in COMPOUND)
    ]
    known = [row for row in known if row[1] > 0]
    if not known:
        raise DataError(
            f"{path}: expected harmonic constituents such as M2, found {len(rows)} and none that is known. "
            "Subordinate stations have none: name the reference station."
        )
    notes = [f"constituents left out: {', '.join(left)}."] if left else []
    datums = data.get("datums") or {}
    levels = [datums.get("MSL"), datums.get(str(data.get("chart_datum")))]
    mean = float(levels[0]) - float(levels[1]) if all(isinstance(v, int | float) for v in levels) else np.nan
    return TideStation(
        name=str(data.get("name", path.stem)),
        latitude=place[0],
        longitude=place[1],
        constituents=tuple(row[0] for row in known),
        amplitude=np.array([row[1] for row in known]),
        phase=np.radians([row[2] for row in known]),
        mean_level=mean,
        source=Source("tide station", {str(path): Source.digest(path)}, tuple(notes)),
    )


def tide_height(station: TideStation, time: Array | float) -> Array:
    """Sea level (m above mean sea level) of the tide at times (seconds since 1970), any shape."""
    time = np.asarray(time, float)
    height = np.zeros(time.shape)
    for name, amplitude, phase in zip(station.constituents, station.amplitude, station.phase, strict=True):
        argument, factor = tidal_argument(name, time)
        height = height + factor * amplitude * np.cos(argument - phase)
    return height


def tidal_argument(name: str, time: Array | float) -> tuple[Array, Array]:
    """Argument V + u (rad) and nodal factor f of a constituent at times (seconds since 1970).

    Raises
    ------
    DataError : the constituent is not known.
    """
    time = np.asarray(time, float)
    if name in COMPOUND:
        argument, factor = np.zeros(time.shape), np.ones(time.shape)
        for part, multiple in COMPOUND[name].items():
            angle, size = tidal_argument(part, time)
            argument, factor = argument + multiple * angle, factor * size ** abs(multiple)
        return argument, factor
    if name not in BASIC:
        raise DataError(f"tide: expected one of {', '.join((*BASIC, *COMPOUND))}, found '{name}'. Leave it out.")
    multiples, cycles, family = BASIC[name]
    s, h, p, node, perigee = _longitudes(time)
    day = 2 * np.pi * (time % 86400.0) / 86400.0 + h - s
    argument = sum(k * part for k, part in zip(multiples, (day, s, h, p, perigee), strict=True)) + 2 * np.pi * cycles
    factor = _nodal(family, p, node)
    return argument + np.angle(factor), np.abs(factor)


def _longitudes(time: Array) -> tuple[Array, ...]:
    """Mean longitudes (rad) of moon, sun, lunar perigee, lunar node and solar perigee."""
    c = (time - J2000) / CENTURY
    degrees = (
        218.3164591 + 481267.88134236 * c - 0.0013268 * c**2,
        280.46645 + 36000.76983 * c + 0.0003032 * c**2,
        83.3532430 + 4069.0137111 * c - 0.0103238 * c**2,
        125.0445550 - 1934.1361849 * c + 0.0020762 * c**2,
        282.93735 + 1.71946 * c + 0.00046 * c**2,
    )
    return tuple(np.radians(part % 360.0) for part in degrees)


def _nodal(family: str, p: Array, node: Array) -> Array:
    """Complex nodal factor f exp(i u) of a family of constituents."""
    n1, n2 = np.cos(node), np.cos(2 * node)
    s1, s2 = np.sin(node), np.sin(2 * node)
    if family == "":
        return np.ones(np.shape(node), complex)
    if family == "M3":
        return _nodal("M2", p, node) ** 1.5
    if family == "L2":
        angles = ((0.2505, 2 * p), (0.1102, 2 * p - node), (0.0156, 2 * p - 2 * node), (0.0370, node))
        return 1 - sum(size * np.exp(1j * angle) for size, angle in angles)
    factor, degrees = {
        "M2": (1.0004 - 0.0373 * n1 + 0.0002 * n2, -2.14 * s1),
        "K2": (1.0241 + 0.2863 * n1 + 0.0083 * n2, -17.74 * s1 + 0.68 * s2),
        "K1": (1.0060 + 0.1150 * n1 - 0.0088 * n2, -8.86 * s1 + 0.68 * s2),
        "O1": (1.0089 + 0.1871 * n1 - 0.0147 * n2, 10.80 * s1 - 1.34 * s2),
        "J1": (1.0129 + 0.1676 * n1 - 0.0170 * n2, -12.94 * s1 + 1.34 * s2),
        "OO1": (1.1027 + 0.6504 * n1 + 0.0317 * n2, -36.68 * s1 + 4.02 * s2),
        "MM": (1.0000 - 0.1300 * n1 + 0.0013 * n2, 0.0 * s1),
        "MF": (1.0429 + 0.4135 * n1 - 0.0040 * n2, -23.74 * s1 + 2.68 * s2),
    }[family]
    return factor * np.exp(1j * np.radians(degrees))
