"""Typed records that pass between the layers: grids, profiles, recordings and finished ensembles.

NumPy and the standard library only, so that readers, the board and the command line start without JAX.
Conventions: SI units; time as seconds since 1970-01-01T00:00:00Z in float64; latitude and longitude in decimal
degrees, axes ascending; depth positive down; water velocity positive east, north and up; NaN where nothing is known.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


@dataclass(frozen=True)
class Source:
    """Where a record came from.

    ``product`` names the kind of file recognised, ``files`` maps each path read to its SHA-256, ``notes`` holds one
    sentence for everything the reader repaired, assumed or ignored; the command line shows them.
    """

    product: str
    files: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @staticmethod
    def digest(path: str | Path) -> str:
        """SHA-256 of a file, in hexadecimal, read in pieces."""
        sha = hashlib.sha256()
        with open(path, "rb") as stream:
            for block in iter(lambda: stream.read(1 << 20), b""):
                sha.update(block)
        return sha.hexdigest()


@dataclass(frozen=True)
class CurrentGrid:
    """Water velocity on a regular longitude-latitude grid.

    ``east`` and ``north`` have shape (time, depth, latitude, longitude), m s-1, NaN where the product has no value.
    ``depth`` (m, ascending) has one entry for a surface product; ``depth_resolved`` says whether the values at
    several depths differ by measurement or model. Longitudes ascend and may pass 180 where a grid crosses the
    antimeridian; the step need not be uniform. ``east_sd`` and ``north_sd`` (m s-1, same shape) are the product's own
    1-sigma errors, or None. ``sea`` (latitude, longitude) is True where the water is, as far as the product tells;
    ``filled`` is the share of sea values that a gap filler supplied, ``fill_method`` how. ``constant_in_time`` marks
    a single frame that may be used at any time.
    """

    time: Array
    depth: Array
    latitude: Array
    longitude: Array
    east: Array
    north: Array
    source: Source
    sea: Array | None = None
    east_sd: Array | None = None
    north_sd: Array | None = None
    filled: float = 0.0
    fill_method: str = "none"
    constant_in_time: bool = False

    @property
    def depth_resolved(self) -> bool:
        """Whether the currents vary with depth."""
        return self.depth.size > 1


@dataclass(frozen=True)
class TidalGrid:
    """Tidal current constituents on a regular longitude-latitude grid, constant with depth.

    ``omega`` (constituent,) rad s-1. The velocity is ``Re(east * exp(-1j * omega * (t - reference_time)))`` with
    complex ``east`` and ``north`` (constituent, latitude, longitude) in m s-1 that include nodal factors and
    equilibrium arguments; NaN on land.
    """

    names: tuple[str, ...]
    omega: Array
    reference_time: float
    latitude: Array
    longitude: Array
    east: Array
    north: Array
    source: Source


@dataclass(frozen=True)
class BathymetryGrid:
    """Water depth on a regular longitude-latitude grid.

    ``depth`` (latitude, longitude), m, positive down, negative on land, NaN where unknown; ``sd`` its 1-sigma
    uncertainty or None.
    """

    latitude: Array
    longitude: Array
    depth: Array
    source: Source
    sd: Array | None = None


@dataclass(frozen=True)
class WaterProfile:
    """Hydrography as a function of depth alone, or of time and depth.

    ``depth`` (level,) m; ``conservative_temperature`` (level,) degC; ``absolute_salinity`` (level,) g kg-1, the
    units of TEOS-10, which only ``environment.seawater`` computes with.
    """

    depth: Array
    conservative_temperature: Array
    absolute_salinity: Array
    source: Source


@dataclass(frozen=True)
class Repair:
    """One kind of repair that a reader made: what, how many rows, and an example."""

    kind: str
    count: int
    detail: str = ""


@dataclass(frozen=True)
class Recording:
    """What a glider recorded, one row per cycle, NaN where a channel was not updated.

    ``time`` (row,) ascends strictly. ``channels`` holds our names and SI units (see ``readers.recordings.CHANNELS``:
    for example ``pitch`` rad, ``depth`` m, ``gps_latitude`` degrees, ``battery_voltage`` V, ``current`` A,
    ``charge_used`` C, ``pumped_volume`` m3). ``segment_start`` are the times at which a new file began.
    ``repairs`` counts everything that was mended; ``missing`` lists channels asked for and absent.
    """

    name: str
    time: Array
    channels: dict[str, Array]
    source: Source
    segment_start: Array
    repairs: tuple[Repair, ...] = ()
    missing: tuple[str, ...] = ()
    attributes: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Array:
        return self.channels[name]

    def __contains__(self, name: str) -> bool:
        return name in self.channels


@dataclass(frozen=True)
class Track:
    """A finished ensemble on the host; n members, o output times, s surfacings, w waypoints, c energy components.

    Attributes
    ----------
    time : (o,) output times, common to all members; the first is the start.
    latitude, longitude : (n, o) degrees; a member that ended keeps its last position.
    depth : (n, o) m, positive down.
    phase : (n, o) int8; OG1 flags 0 unknown, 1 ascent, 2 descent, 3 surface.
    active : (n, o) bool; False once the member has ended.
    energy : (n, o, c) J drawn since the start, by component; ``components`` names them.
    charge_used : (n, o) C drawn since the start; ``state_of_charge`` (n, o) 0 to 1 of the pack's usable charge.
    voltage : (n, o) V, battery terminal voltage under the steady load.
    distance_through_water, distance_over_ground : (n, o) m since the start.
    inflections : (n, o) number of dive-to-climb plus climb-to-dive turns since the start.
    current_east, current_north : (n, o) m s-1, mean water velocity the member last felt.
    surfacing_time, surfacing_latitude, surfacing_longitude : (n, s) when and where it broke the surface; NaN padded.
    dive_time, dive_latitude, dive_longitude : (n, s) when and where it left the surface again; NaN padded.
    surfacing_reason : (n, s) int8, index into ``reasons``; -1 padding.
    waypoint_time : (n, w) when each waypoint of the plan was reached; NaN where it was not. ``waypoints`` (w, 2) are
        their latitude and longitude.
    outcome : (n,) ``errors.Outcome`` codes; outcome_time, outcome_latitude, outcome_longitude (n,) say where.
    bottom_contacts : (n,) number of times the seafloor stopped a dive before the commanded depth or altitude did.
    usable_energy : (n,) J, the usable capacity drawn for each member.
    parameters : name -> (n,) the perturbed inputs of each member, in SI.
    settings : everything needed to repeat the run (version, seed, options, digests of the inputs, active terms).
    notes : sentences for the user: what was assumed, ignored or repaired.
    complete : False where the run was interrupted and only part of the members or time is here.
    program : the rules of the mission's program in words; empty without one. ``program_time`` (n, rules) when each
        first came into force, NaN where never; ``program_count`` (n, rules) how often.
    """

    time: Array
    latitude: Array
    longitude: Array
    depth: Array
    phase: Array
    active: Array
    energy: Array
    components: tuple[str, ...]
    charge_used: Array
    state_of_charge: Array
    voltage: Array
    distance_through_water: Array
    distance_over_ground: Array
    inflections: Array
    current_east: Array
    current_north: Array
    surfacing_time: Array
    surfacing_latitude: Array
    surfacing_longitude: Array
    dive_time: Array
    dive_latitude: Array
    dive_longitude: Array
    surfacing_reason: Array
    reasons: tuple[str, ...]
    waypoint_time: Array
    waypoints: Array
    outcome: Array
    outcome_time: Array
    outcome_latitude: Array
    outcome_longitude: Array
    bottom_contacts: Array
    usable_energy: Array
    parameters: dict[str, Array]
    settings: dict[str, Any]
    notes: tuple[str, ...] = ()
    complete: bool = True
    program: tuple[str, ...] = ()
    program_time: Array = field(default_factory=lambda: np.empty((0, 0)))
    program_count: Array = field(default_factory=lambda: np.empty((0, 0), np.int32))

    @property
    def n(self) -> int:
        """Number of members."""
        return int(self.latitude.shape[0])
