"""What a block of members says about each quantity of the summary: pure functions from a track to arrays (member, ...).

NumPy only. Times are seconds since the start of the forecast, NaN where something did not happen. Between output times
positions, charge and state of charge are interpolated linearly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from glider_jax.errors import Outcome
from glider_jax.products.coordinates import LocalFrame, unwrap_longitude, wrap_longitude
from glider_jax.products.regions import crossings
from glider_jax.records import Array, Track

# The forecast of these members was cut short by the inputs, so how they would have ended is not known.
CUT_SHORT = (Outcome.LEFT_CURRENTS_AREA, Outcome.LEFT_CURRENTS_TIME, Outcome.LEFT_BATHYMETRY, Outcome.INVALID)


@dataclass(frozen=True)
class NamedPolygon:
    """An area the glider may enter: rings (point, 2) of longitude and latitude in degrees, closed; even-odd inside."""

    name: str
    rings: tuple[Array, ...]


def lasting(track: Track) -> Array:
    """Seconds from the start to the end of each member, (n,): its outcome or the end of the forecast."""
    whole = float(track.time[-1] - track.time[0])
    ended = np.asarray(track.outcome_time, float) - track.time[0]
    return np.where(np.isfinite(ended), np.clip(ended, 0.0, whole), whole)


def bracket(track: Track, seconds: float) -> tuple[int, int, float]:
    """Indices of the output times around an instant, and the weight of the later one."""
    elapsed = track.time - track.time[0]
    after = int(np.clip(np.searchsorted(elapsed, seconds), 0, elapsed.size - 1))
    if elapsed[after] <= seconds or after == 0:
        return after, after, 0.0
    before = after - 1
    return before, after, float((seconds - elapsed[before]) / (elapsed[after] - elapsed[before]))


def at(track: Track, values: Array, seconds: float) -> Array:
    """Values (n, o) at an instant, (n,)."""
    before, after, weight = bracket(track, seconds)
    if weight == 0.0:
        return np.asarray(values[:, before], float)
    return (1.0 - weight) * values[:, before] + weight * values[:, after]


def active_at(track: Track, seconds: float) -> Array:
    """Which members are still under way at an instant, (n,) bool."""
    return np.asarray(track.active)[:, bracket(track, seconds)[0]] & (lasting(track) >= seconds)


class Positions:
    """Places of the members of a block through time, longitudes unwrapped around the start."""

    def __init__(self, track: Track, reference: float) -> None:
        self.track = track
        self.latitude = track.latitude
        near = np.abs(np.asarray(track.longitude[:, [0, -1]]) - reference).max(initial=0.0) < 90.0
        safe = near and float(np.abs(track.longitude - reference).max(initial=0.0)) < 180.0
        self.longitude = track.longitude if safe else unwrap_longitude(track.longitude, reference)

    def at(self, seconds: float) -> tuple[Array, Array]:
        """Latitude and longitude at an instant, (n,) each; NaN for members no longer under way."""
        under_way = active_at(self.track, seconds)
        latitude, longitude = at(self.track, self.latitude, seconds), at(self.track, self.longitude, seconds)
        return np.where(under_way, latitude, np.nan), np.where(under_way, longitude, np.nan)

    def extremes(self, start: float, end: float) -> tuple[float, float, float, float]:
        """South, west, north and east limits of the members under way between two instants; NaN without any."""
        under_way = active_at(self.track, start)
        if not under_way.any():
            return (np.nan,) * 4
        elapsed = self.track.time - self.track.time[0]
        within = np.flatnonzero((elapsed > start) & (elapsed < end))
        found = []
        for values in (self.latitude, self.longitude):
            ends = [at(self.track, values, instant)[under_way] for instant in (start, end)]
            if within.size:
                ends.append(values[under_way, within[0] : within[-1] + 1].ravel())
            found.append((min(x.min() for x in ends), max(x.max() for x in ends)))
        (south, north), (west, east) = found
        return float(south), float(west), float(north), float(east)


def crossing_times(track: Track, levels: Array) -> Array:
    """When the state of charge first falls to each level, (n, level) s since the start."""
    charge = np.asarray(track.state_of_charge)
    elapsed = track.time - track.time[0]
    rows = np.arange(track.n)
    found = np.full((track.n, len(levels)), np.nan)
    for j, level in enumerate(levels):
        low = charge <= level
        first = low.argmax(axis=1)
        happened = low[rows, first]
        before = np.maximum(first - 1, 0)
        high, end = charge[rows, before].astype(float), charge[rows, first].astype(float)
        drop = np.where(high > end, high - end, 1.0)
        part = np.where(first > 0, np.clip((high - level) / drop, 0.0, 1.0), 0.0)
        found[:, j] = np.where(happened, elapsed[before] + part * (elapsed[first] - elapsed[before]), np.nan)
    return found


def extrapolated_crossings(track: Track, levels: Array, within: Array) -> Array:
    """The same beyond the end of the forecast, at each member's mean draw since the start.

    ``within`` are the crossings inside the forecast, which are kept. Members that flew for less than an hour or drew
    nothing stay NaN.
    """
    duration = lasting(track)
    first, last = (np.asarray(track.state_of_charge[:, k], float) for k in (0, -1))
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.where(duration >= 3600.0, (first - last) / duration, np.nan)
        later = duration[:, None] + (last[:, None] - np.asarray(levels)) / rate[:, None]
    return np.where(np.isfinite(within), within, np.where(rate[:, None] > 0.0, later, np.nan))


def daily_rates(track: Track) -> dict[str, Array]:
    """Mean rates of each member over its own duration, per day: (n,) m, m and C, and (n, component) J.

    Members that lasted less than an hour are NaN.
    """
    days = np.where(lasting(track) >= 3600.0, lasting(track) / 86400.0, np.nan)
    energy = np.asarray(track.energy[:, -1] - track.energy[:, 0], float)
    charge = np.asarray(track.charge_used[:, -1] - track.charge_used[:, 0], float)
    return {
        "over_ground": (track.distance_over_ground[:, -1] - track.distance_over_ground[:, 0]) / days,
        "through_water": (track.distance_through_water[:, -1] - track.distance_through_water[:, 0]) / days,
        "charge": charge / days,
        "energy": energy / days[:, None],
    }


def first_day_charge(track: Track, seconds: float) -> Array:
    """Charge drawn in the first ``seconds``, C, (n,); NaN for members that ended earlier."""
    drawn = at(track, track.charge_used, seconds) - track.charge_used[:, 0]
    return np.where(lasting(track) >= seconds, drawn, np.nan)


def closest_approach(positions: Positions, waypoint: tuple[float, float]) -> Array:
    """Least distance of each member from a waypoint, m, (n,), along straight lines between output times.

    The nearest output time is found first, then the two lines that meet there.
    """
    latitude, longitude = waypoint
    per_lon, per_lat = LocalFrame(latitude, longitude).metres_per_degree
    n, count = positions.latitude.shape
    # Longitudes are unwrapped around the start, so one whole turn is taken out at most once for all.
    turn = 360.0 * round(float(positions.longitude[0, 0] - longitude) / 360.0) if n else 0.0
    east = ((positions.longitude - (longitude + turn)) * per_lon).astype(np.float32)
    north = ((positions.latitude - latitude) * per_lat).astype(np.float32)
    nearest = (east * east + north * north).argmin(axis=1)
    rows = np.arange(n)
    best = np.hypot(east[rows, nearest], north[rows, nearest]).astype(float)
    for step in (-1, 1):
        other = np.clip(nearest + step, 0, count - 1)
        x, y = east[rows, nearest].astype(float), north[rows, nearest].astype(float)
        dx, dy = east[rows, other] - x, north[rows, other] - y
        length = np.maximum(dx * dx + dy * dy, 1e-12)
        part = np.clip(-(x * dx + y * dy) / length, 0.0, 1.0)
        best = np.minimum(best, np.hypot(x + part * dx, y + part * dy))
    return best


def entry_times(positions: Positions, polygon: NamedPolygon) -> Array:
    """When each member first enters a polygon, (n,) s since the start, NaN where it does not.

    Paths are straight lines between output times: a line that crosses an edge of the polygon enters it.
    """
    track = positions.track
    elapsed = track.time - track.time[0]
    found = np.full(track.n, np.nan)
    corners = np.concatenate(polygon.rings)
    reference = float(positions.longitude.flat[0]) if track.n else 0.0
    shift = unwrap_longitude(corners[0, 0], reference) - corners[0, 0]
    # Edges are taken from unwrapped rings so that a polygon across the antimeridian stays whole.
    rings = [np.stack([unwrap_ring(r[:, 0]) + shift, r[:, 1]], axis=1) for r in polygon.rings]
    low = np.min([r.min(axis=0) for r in rings], axis=0)
    high = np.max([r.max(axis=0) for r in rings], axis=0)
    lasts = np.searchsorted(elapsed, lasting(track), side="left")
    x, y = positions.longitude, positions.latitude
    if elapsed.size == 1:
        inside_now = _inside(rings, np.stack([x[:, 0], y[:, 0]], axis=1))
        return np.where(inside_now, 0.0, np.nan)
    near = (
        (np.maximum(x[:, 1:], x[:, :-1]) >= low[0])
        & (np.minimum(x[:, 1:], x[:, :-1]) <= high[0])
        & (np.maximum(y[:, 1:], y[:, :-1]) >= low[1])
        & (np.minimum(y[:, 1:], y[:, :-1]) <= high[1])
        & (np.arange(elapsed.size - 1) < np.maximum(lasts, 1)[:, None])
    )
    rows, columns = np.nonzero(near)
    if not rows.size:
        return found
    start = np.stack([x[rows, columns], y[rows, columns]], axis=1).astype(float)
    end = np.stack([x[rows, columns + 1], y[rows, columns + 1]], axis=1).astype(float)
    part = np.where(_inside(rings, start), 0.0, np.inf)
    for ring in rings:
        for a, b in zip(ring[:-1], ring[1:], strict=True):
            part = np.minimum(part, _meets(start, end, a, b))
    times = elapsed[columns] + part * (elapsed[columns + 1] - elapsed[columns])
    first = np.full(track.n, np.inf)
    np.minimum.at(first, rows, times)
    return np.where(np.isfinite(first), first, np.nan)


def unwrap_ring(longitude: Array) -> Array:
    """Longitudes of a ring without jumps: each within 180 degrees of the one before."""
    steps = wrap_longitude(np.diff(longitude))
    return longitude[0] + np.concatenate([[0.0], np.cumsum(steps)])


def _inside(rings: list[Array], points: Array) -> Array:
    return sum(crossings(ring, points) for ring in rings) % 2 == 1


def _meets(start: Array, end: Array, a: Array, b: Array) -> Array:
    """Where lines (k, 2) to (k, 2) meet the edge a-b, as a share of the line; inf where they do not."""
    line, edge, gap = end - start, b - a, a - start
    cross = line[:, 0] * edge[1] - line[:, 1] * edge[0]
    safe = np.where(cross == 0.0, 1.0, cross)
    along = (gap[:, 0] * edge[1] - gap[:, 1] * edge[0]) / safe
    beside = (gap[:, 0] * line[:, 1] - gap[:, 1] * line[:, 0]) / safe
    hit = (cross != 0.0) & (along >= 0.0) & (along <= 1.0) & (beside >= 0.0) & (beside <= 1.0)
    return np.where(hit, along, np.inf)
