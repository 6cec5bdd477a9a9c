"""Synthetic ensembles whose areas, arrival times and percentiles have closed forms."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from glider_jax.errors import Outcome
from glider_jax.products.coordinates import LocalFrame
from glider_jax.records import BathymetryGrid, CurrentGrid, Source, Track

START = 1351123200.0  # 2012-10-25T00:00:00Z
REASONS = ("every 3 h", "hit a waypoint", "no comms for a while")
COMPONENTS = ("pump", "hotel", "science", "steering", "communication")


@dataclass(frozen=True)
class Cloud:
    """Members drift at a constant velocity of their own: position = start + offset + velocity * time.

    ``offset`` is normal with ``spread`` m per axis, velocity normal around (``east``, ``north``) with
    ``velocity_spread`` m s-1 per axis, so the cloud at time t is normal with variance spread² + (velocity_spread t)²
    per axis. Powers (W) are ``powers`` by component, times one log-normal-free factor 1 + ``power_spread`` * normal.
    """

    n: int = 5000
    hours: float = 72.0
    output_h: float = 1.0
    surfacing_h: float = 3.0
    surface_stay: float = 600.0
    latitude: float = 39.4
    longitude: float = -74.2
    east: float = 0.25
    north: float = -0.10
    spread: float = 200.0
    velocity_spread: float = 0.02
    powers: tuple[float, ...] = (0.9, 1.5, 0.8, 0.2, 0.35)
    power_spread: float = 0.05
    usable_energy: float = 1.2e6
    volts: float = 15.0
    seed: int = 3


def gaussian_track(cloud: Cloud = Cloud(), **changes) -> Track:
    """Build the ensemble of :class:`Cloud`, with three waypoints downstream of the start."""
    c = replace(cloud, **changes)
    rng = np.random.default_rng(c.seed)
    frame = LocalFrame(c.latitude, c.longitude)
    offset = rng.normal(size=(c.n, 2)) * c.spread
    velocity = np.array([c.east, c.north]) + rng.normal(size=(c.n, 2)) * c.velocity_spread
    elapsed = np.arange(0.0, c.hours * 3600.0 + 1.0, c.output_h * 3600.0)

    def place(seconds):
        """Latitude and longitude of every member after (n, k) or (k,) seconds."""
        seconds = np.broadcast_to(seconds, (c.n, np.shape(seconds)[-1]))
        east = offset[:, :1] + velocity[:, :1] * seconds
        north = offset[:, 1:] + velocity[:, 1:] * seconds
        return frame.to_degrees(east, north)

    latitude, longitude = place(elapsed)
    up = np.arange(c.surfacing_h * 3600.0, c.hours * 3600.0 + 1.0, c.surfacing_h * 3600.0)
    surfaced = up + rng.normal(size=(c.n, up.size)) * 120.0
    dived = surfaced + c.surface_stay
    surfacing_latitude, surfacing_longitude = place(surfaced)
    dive_latitude, dive_longitude = place(dived)
    # Waypoints lie on the mean path: arrival is when the along-path coordinate passes them.
    speed = np.hypot(c.east, c.north)
    along = np.array([0.2, 0.5, 0.9]) * speed * c.hours * 3600.0
    heading = np.array([c.east, c.north]) / max(speed, 1e-12)
    waypoint_lat, waypoint_lon = frame.to_degrees(along * heading[0], along * heading[1])
    rate = velocity @ heading
    with np.errstate(divide="ignore", invalid="ignore"):
        arrival = (along[None, :] - (offset @ heading)[:, None]) / rate[:, None]
    arrival[(arrival < 0) | (arrival > c.hours * 3600.0)] = np.nan
    power = np.asarray(c.powers) * (1.0 + c.power_spread * rng.normal(size=(c.n, 1)))
    energy = power[:, None, :] * elapsed[None, :, None]
    usable = np.full(c.n, c.usable_energy)
    charge = energy.sum(-1) / c.volts
    soc = np.clip(1.0 - energy.sum(-1) / usable[:, None], 0.0, 1.0)
    shape = latitude.shape
    distance = np.hypot(velocity[:, :1], velocity[:, 1:]) * elapsed
    hours_in_yo = np.mod(elapsed / 600.0, 2.0)
    depth = np.broadcast_to(50.0 * np.minimum(hours_in_yo, 2.0 - hours_in_yo), shape)
    return Track(
        time=START + elapsed,
        latitude=latitude,
        longitude=longitude,
        depth=depth.astype(np.float32),
        phase=np.broadcast_to((1 + (elapsed / 600.0).astype(int) % 2).astype(np.int8), shape),
        active=np.ones(shape, bool),
        energy=energy.astype(np.float32),
        components=COMPONENTS[: len(c.powers)],
        charge_used=charge.astype(np.float32),
        state_of_charge=soc.astype(np.float32),
        voltage=np.full(shape, c.volts, np.float32),
        distance_through_water=(distance * 1.2).astype(np.float32),
        distance_over_ground=distance.astype(np.float32),
        inflections=np.broadcast_to((elapsed / 600.0).astype(np.int32), shape),
        current_east=np.full(shape, c.east, np.float32),
        current_north=np.full(shape, c.north, np.float32),
        surfacing_time=START + surfaced,
        surfacing_latitude=surfacing_latitude,
        surfacing_longitude=surfacing_longitude,
        dive_time=START + dived,
        dive_latitude=dive_latitude,
        dive_longitude=dive_longitude,
        surfacing_reason=np.where(np.arange(c.n)[:, None] % 4 == 0, 1, 0).astype(np.int8)
        * np.ones((1, up.size), np.int8),
        reasons=REASONS,
        waypoint_time=START + arrival,
        waypoints=np.stack([waypoint_lat, waypoint_lon], axis=1),
        outcome=np.full(c.n, Outcome.FLYING, np.int32),
        outcome_time=np.full(c.n, np.nan),
        outcome_latitude=np.full(c.n, np.nan),
        outcome_longitude=np.full(c.n, np.nan),
        bottom_contacts=np.zeros(c.n, np.int32),
        usable_energy=usable,
        parameters={"current_error": rng.normal(size=c.n), "hotel_power": power[:, 1]},
        settings={
            "version": "0.1.0",
            "seed": c.seed,
            "speed": "distribution",
            "inputs": {"currents.nc": "ab" * 32, "bathymetry.nc": "cd" * 32},
            "terms": ["steady_glide", "energy_channels"],
        },
        notes=("The currents are the mean of the field.",),
    )


def end_members(track: Track, members, outcome: Outcome, after: float) -> Track:
    """The same ensemble, with ``members`` ended ``after`` seconds from the start (at an output time)."""
    k = int(np.searchsorted(track.time - track.time[0], after))
    members = np.asarray(members)
    changes = {}
    for name in ("latitude", "longitude", "depth", "energy", "charge_used", "state_of_charge", "voltage",
                 "distance_through_water", "distance_over_ground", "inflections"):  # fmt: skip
        values = np.array(getattr(track, name))
        values[members, k:] = values[members, k][:, None]
        changes[name] = values
    active = np.array(track.active)
    active[members, k:] = False
    late = np.zeros((track.n, 1), bool)
    late[members] = True
    for stem in ("surfacing", "dive"):
        times = getattr(track, f"{stem}_time")
        gone = late & (times > track.time[k])
        for part in ("time", "latitude", "longitude"):
            values = np.array(getattr(track, f"{stem}_{part}"))
            values[gone] = np.nan
            changes[f"{stem}_{part}"] = values
    reason = np.array(track.surfacing_reason)
    reason[np.isnan(changes["surfacing_time"])] = -1
    waypoint_time = np.array(track.waypoint_time)
    waypoint_time[late & (waypoint_time > track.time[k])] = np.nan
    codes, when = np.array(track.outcome), np.array(track.outcome_time)
    where_lat, where_lon = np.array(track.outcome_latitude), np.array(track.outcome_longitude)
    codes[members], when[members] = outcome, track.time[k]
    where_lat[members], where_lon[members] = track.latitude[members, k], track.longitude[members, k]
    return replace(
        track, active=active, surfacing_reason=reason, waypoint_time=waypoint_time, outcome=codes, outcome_time=when,
        outcome_latitude=where_lat, outcome_longitude=where_lon, **changes,
    )  # fmt: skip


def take(track: Track, members: slice) -> Track:
    """A block of the members of an ensemble."""
    per_member = {
        name: getattr(track, name)[members]
        for name, value in vars(track).items()
        if name not in ("time", "waypoints") and isinstance(value, np.ndarray)
    }
    parameters = {name: values[members] for name, values in track.parameters.items()}
    return replace(track, parameters=parameters, **per_member)


def shelf(step_deg: float = 1 / 60) -> BathymetryGrid:
    """A sea floor like New Jersey's: a coast from south-west to north-east, a wide shelf, a break and a slope."""
    longitude = np.arange(-75.6, -71.4, step_deg)
    latitude = np.arange(37.8, 41.0, step_deg)
    lon, lat = np.meshgrid(longitude, latitude)
    offshore = ((lon + 74.35) * 85.0 * 0.77 - (lat - 39.4) * 111.0 * 0.55) / np.hypot(0.77, 0.55) * 0.95
    depth = np.where(offshore < 0, offshore * 1.5, 4.0 + 0.5 * offshore + 0.0012 * offshore**2)
    slope = np.maximum(offshore - 135.0, 0.0)
    depth = depth + 0.5 * slope**2 / (1 + slope / 60.0) + 1.5 * np.sin(lon * 40) * np.cos(lat * 33)
    return BathymetryGrid(latitude, longitude, depth, Source("synthetic shelf"))


def shelf_currents(bathymetry: BathymetryGrid, hours: int = 72) -> CurrentGrid:
    """A south-westward flow with a semidiurnal tide and an eddy, on a 6-km grid, NaN on land."""
    longitude = np.arange(-74.9, -72.0, 0.07)
    latitude = np.arange(38.3, 40.6, 0.054)
    lon, lat = np.meshgrid(longitude, latitude)
    time = START + 3600.0 * np.arange(hours + 1)
    tide = np.cos(2 * np.pi * (time - START) / 44714.0)[:, None, None]
    swirl = np.exp(-(((lon + 73.4) / 0.4) ** 2) - ((lat - 39.2) / 0.3) ** 2)
    east = -0.08 + 0.06 * tide - 0.5 * swirl * (lat - 39.2)
    north = -0.06 + 0.04 * tide + 0.5 * swirl * (lon + 73.4)
    i = np.searchsorted(bathymetry.latitude, latitude)
    j = np.searchsorted(bathymetry.longitude, longitude)
    land = bathymetry.depth[np.ix_(i, j)] < 0
    east, north = (np.where(land, np.nan, x)[:, None] for x in (east, north))
    return CurrentGrid(
        time, np.zeros(1), latitude, longitude, east, north, Source("synthetic currents"), sea=~land
    )
