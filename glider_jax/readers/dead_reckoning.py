"""Where a glider went through the water, from what it recorded: true headings, own and firmware's dead reckoning.

NumPy only. Conventions a newcomer would get wrong: the local frame's y axis and the compass point to magnetic north;
magnetic = true + variation, so west is positive and a local vector is turned counter-clockwise by the variation to
become east and north; the firmware's positions under water include the water velocity it believed in.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from glider_jax.records import Array, Recording

EARTH_RADIUS = 6_371_000.0
#: rad; steeper than this a pitch tells the horizontal speed, flatter ones occur in inflections.
SHALLOWEST_PITCH = np.radians(8.0)
#: Steady glide: angle of attack times the tangent of the path's angle is drag over lift slope. Measured on what the
#: firmware of two Slocums recorded (0.0225 to 0.0236 at 24 to 26 degrees, both phases, shallow and deep).
DRAG_OVER_LIFT_SLOPE = 0.0232
#: s; across longer holes in depth, pitch or heading nothing is inferred.
LONGEST_HOLE = 300.0
#: m/s; horizontal speed beyond what any glider does: an inflection seen through a coarse sampling.
FASTEST = 1.2


class Variation(NamedTuple):
    """Magnetic variation in rad (magnetic = true + value), its 1-sigma, and how it is known.

    ``how``: ``true`` (headings are true already), ``given``, ``recorded``, ``estimated`` (from the firmware's own
    dead reckoning) or ``assumed`` (zero, for want of anything better).
    """

    value: float
    sigma: float
    how: str


class Path(NamedTuple):
    """Displacement and length through the water in m, how it was found, and which share of the time it rests on."""

    east: float
    north: float
    length: float
    how: str
    coverage: float


def metres(latitude: Array, longitude: Array, origin: tuple[float, float]) -> tuple[Array, Array]:
    """East and north, m, of positions from an origin (latitude, longitude) nearby, on a sphere."""
    east = (np.asarray(longitude) - origin[1] + 180.0) % 360.0 - 180.0
    scale = np.pi / 180.0 * EARTH_RADIUS
    middle = np.radians(0.5 * (np.asarray(latitude) + origin[0]))
    return scale * east * np.cos(middle), scale * (np.asarray(latitude) - origin[0])


def finite(recording: Recording, name: str) -> tuple[Array, Array]:
    """Times and values of a channel where it was updated; empty where it is absent."""
    if name not in recording:
        return np.empty(0), np.empty(0)
    values = recording[name]
    good = np.isfinite(values)
    return recording.time[good], values[good]


def to_true(vx: Array, vy: Array, variation: float) -> tuple[Array, Array]:
    """East and north of a vector in the glider's local frame, whose y axis points to magnetic north.

    Examples
    --------
    >>> east, north = to_true(0.0, 1.0, np.radians(12.6))  # 12.6 degrees west
    >>> bool(east < 0.0), round(float(north), 3)
    (True, 0.976)
    """
    cos, sin = np.cos(variation), np.sin(variation)
    return vx * cos - vy * sin, vx * sin + vy * cos


def magnetic_variation(recording: Recording, given: float | None = None) -> Variation:
    """The magnetic variation of a recording: given, recorded, or estimated from its dead reckoning.

    The firmware moves its position along the heading it corrected itself. The angle between its track under water
    and own speed along the recorded heading is therefore the variation, with no field model, to about a degree (the
    firmware's grid convergence is in it).
    """
    if given is not None:
        return Variation(float(given), 0.0, "given")
    if recording.attributes.get("heading_reference") == "true":
        return Variation(0.0, 0.0, "true")
    _, recorded = finite(recording, "magnetic_variation")
    if recorded.size and np.any(recorded != 0.0):
        return Variation(float(np.median(recorded[recorded != 0.0])), float(np.std(recorded)), "recorded")
    found = _track_turn(recording)
    if found is None:
        return Variation(0.0, float(np.radians(20.0)), "assumed")
    return Variation(found[0], float(np.hypot(found[1], np.radians(1.0))), "estimated")


def _track_turn(recording: Recording) -> tuple[float, float, bool] | None:
    """Angle from own velocity to the firmware's track under water, its 1-sigma, and whether water is in the track.

    Firmware adds its water velocity to its positions only where current correction is on; both are tried, and the
    one that leaves less behind is taken. None where positions, depth, pitch or heading do not tell.
    """
    moment, latitude = finite(recording, "latitude")
    _, longitude = finite(recording, "longitude")
    depth_time, depth = finite(recording, "depth")
    if moment.size < 10 or depth.size < 30 or longitude.size != latitude.size:
        return None
    grid = np.arange(moment[0], moment[-1], 10.0)
    rates = horizontal_velocity(recording, grid, Variation(0.0, 0.0, "given"))
    if rates is None:
        return None
    step = np.diff(moment)
    own = rates[0] + 1j * rates[1]
    under = np.interp(grid, depth_time, depth) > 3.0
    bad = np.concatenate([[0], np.cumsum(~(np.isfinite(own) & under))])
    path = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(own), own, 0.0))])
    edge = np.clip(np.searchsorted(grid, moment), 0, grid.size)
    points = np.maximum(np.diff(edge), 1)
    moved = np.diff(path[edge]) / points
    nearest = np.clip(edge[:-1], 0, grid.size - 1)
    moved = np.where(np.diff(edge) > 0, moved, own[nearest])
    sound = (np.diff(bad[edge]) == 0) & np.isfinite(moved) & under[nearest] & (step < 1000.0)
    east, north = metres(latitude[1:], longitude[1:], (latitude[:-1], longitude[:-1]))
    track = (east + 1j * north) / step
    sound &= np.abs(track) < 3.0 * FASTEST
    if sound.sum() < 5:
        return None
    track, moved, weight = track[sound], moved[sound], step[sound]
    water = _held(recording, moment[:-1][sound], "water_vx") + 1j * _held(recording, moment[:-1][sound], "water_vy")
    fits = []
    for added in (False, True):
        expected = moved + water if added else moved
        kept = np.ones(track.size, bool)
        for _ in range(4):
            angle = float(np.angle((weight * track * np.conj(expected))[kept].sum()))
            miss = np.abs(track - expected * np.exp(1j * angle))
            kept = miss <= 3.0 * np.median(miss) + 1e-9
        fits.append((float(np.median(miss)), angle, added, np.angle(track * np.conj(expected)) - angle, kept))
    _, angle, added, spread, kept = min(fits, key=lambda fit: fit[0])
    spread = (spread[kept] + np.pi) % (2.0 * np.pi) - np.pi
    blocks = [np.median(block) for block in np.array_split(spread, max(2, min(20, spread.size // 10)))]
    return angle, float(np.std(blocks) / np.sqrt(len(blocks) - 1)), added


def _held(recording: Recording, at: Array, name: str) -> Array:
    """The last value recorded before each moment, zero before the first."""
    time, values = finite(recording, name)
    if time.size == 0:
        return np.zeros(at.size)
    place = np.searchsorted(time, at, side="right") - 1
    return np.where(place >= 0, values[np.clip(place, 0, None)], 0.0)


def holes(time: Array, at: Array) -> Array:
    """Length in s of the interval without an update around each moment; infinite outside the updates."""
    if time.size < 2:
        return np.full(at.size, np.inf)
    place = np.searchsorted(time, at)
    inside = (place > 0) & (place < time.size)
    right = np.clip(place, 1, time.size - 1)
    return np.where(inside | np.isin(at, time), time[right] - time[right - 1], np.inf)


def true_heading(recording: Recording, at: Array, variation: Variation) -> Array:
    """Heading in rad clockwise from true north at any moments, NaN in holes."""
    time, heading = finite(recording, "heading")
    if time.size < 2:
        return np.full(at.size, np.nan)
    east, north = np.interp(at, time, np.sin(heading)), np.interp(at, time, np.cos(heading))
    angle = np.arctan2(east, north) - variation.value
    return np.where(holes(time, at) <= LONGEST_HOLE, angle % (2.0 * np.pi), np.nan)


def steady_angle_of_attack(pitch: Array) -> Array:
    """Magnitude in rad by which a steady glide is steeper than the hull, from the pitch in rad.

    Examples
    --------
    >>> bool(abs(np.degrees(steady_angle_of_attack(np.radians(26.0))) - 2.47) < 0.02)
    True
    """
    size = np.maximum(np.abs(pitch), SHALLOWEST_PITCH)
    attack = np.zeros_like(size)
    for _ in range(8):
        attack = DRAG_OVER_LIFT_SLOPE / np.tan(np.minimum(size + attack, 1.4))
    return attack


def glide_angle(recording: Recording, at: Array, angle_of_attack: float | None = None) -> Array:
    """Angle of the path through the water, rad, up positive, at any moments; NaN in holes.

    The path is steeper than the hull. ``angle_of_attack`` is the constant magnitude by which; None takes the
    firmware's own where it was recorded, else :func:`steady_angle_of_attack`.
    """
    time, pitch = finite(recording, "pitch")
    if time.size < 2:
        return np.full(at.size, np.nan)
    angle = np.interp(at, time, pitch)
    when, attack = finite(recording, "angle_of_attack")
    if angle_of_attack is not None:
        angle = angle + np.sign(angle) * angle_of_attack
    elif when.size > 0.2 * time.size:
        angle = angle + np.interp(at, when, attack)
    else:
        angle = angle + np.sign(angle) * steady_angle_of_attack(angle)
    return np.where(holes(time, at) <= LONGEST_HOLE, angle, np.nan)


def horizontal_velocity(
    recording: Recording, at: Array, variation: Variation, angle_of_attack: float | None = None
) -> tuple[Array, Array] | None:
    """Own estimate of the velocity through the water, east and north, m/s, at ascending moments.

    The horizontal speed is the depth rate over the tangent of the path's angle, signed, so that noise in depth
    averages out; in inflections, where the angle passes zero, it is interpolated. NaN in holes.
    """
    time, depth = finite(recording, "depth")
    if time.size < 3 or "pitch" not in recording or "heading" not in recording:
        return None
    middle = 0.5 * (time[1:] + time[:-1])
    angle = glide_angle(recording, middle, angle_of_attack)
    steep = np.abs(angle) > SHALLOWEST_PITCH
    rate = np.diff(depth) / np.diff(time)
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = -rate / np.tan(angle)
    good = steep & np.isfinite(speed) & (np.abs(speed) < FASTEST) & (np.diff(time) <= LONGEST_HOLE)
    if good.sum() < 2:
        return None
    speed = np.interp(at, middle[good], speed[good])
    heading = true_heading(recording, at, variation)
    known = (holes(time, at) <= LONGEST_HOLE) & (holes(middle[good], at) <= 2.0 * LONGEST_HOLE)
    speed = np.where(known, speed, np.nan)
    return speed * np.sin(heading), speed * np.cos(heading)


def through_water(
    recording: Recording,
    begin: float,
    end: float,
    variation: Variation,
    angle_of_attack: float | None = None,
    water_added: bool | None = None,
) -> Path:
    """Displacement through the water between two moments under water.

    Own dead reckoning where depth, pitch and heading cover four fifths of the time, scaled up for the rest; else the
    firmware's positions less the water velocity it added; else nothing. ``water_added`` says whether it did
    (:func:`adds_water`), None finds out.
    """
    span = max(end - begin, 1.0)
    at = np.linspace(begin, end, max(int(span / 4.0), 8) + 1)
    at = 0.5 * (at[1:] + at[:-1])
    rates = horizontal_velocity(recording, at, variation, angle_of_attack)
    if rates is not None:
        good = np.isfinite(rates[0])
        coverage = float(good.mean())
        if coverage >= 0.8:
            east, north = rates[0][good], rates[1][good]
            length = float(np.hypot(east, north).mean() * span)
            return Path(float(east.mean() * span), float(north.mean() * span), length, "own", coverage)
    return _firmware_path(recording, begin, end, variation, water_added)


def _firmware_path(
    recording: Recording, begin: float, end: float, variation: Variation, water_added: bool | None
) -> Path:
    """Displacement of the firmware's dead-reckoned position, less its water velocity if it had added it."""
    nothing = Path(np.nan, np.nan, np.nan, "none", 0.0)
    if "latitude" not in recording or "longitude" not in recording:
        return nothing
    both = np.isfinite(recording["latitude"]) & np.isfinite(recording["longitude"])
    rows = np.flatnonzero(both & (recording.time >= begin) & (recording.time <= end))
    if rows.size < 2:
        return nothing
    first, last = rows[0], rows[-1]
    span = recording.time[last] - recording.time[first]
    if span < 0.8 * (end - begin):
        return nothing
    lat, lon = recording["latitude"], recording["longitude"]
    east, north = metres(lat[last], lon[last], (float(lat[first]), float(lon[first])))
    if adds_water(recording) if water_added is None else water_added:
        when = recording.time[first : first + 1]
        x, y = _held(recording, when, "water_vx")[0], _held(recording, when, "water_vy")[0]
        water = to_true(x, y, variation.value)
        east, north = east - water[0] * span, north - water[1] * span
    whole = (end - begin) / span
    x, y = float(east) * whole, float(north) * whole
    return Path(x, y, float(np.hypot(x, y)), "recorded", float(1.0 / whole))


def adds_water(recording: Recording) -> bool:
    """Whether the firmware added its water velocity to its positions: as recorded, else from its track, else yes."""
    _, setting = finite(recording, "current_correction")
    if setting.size:
        return bool(setting[-1] != 0.0)
    found = _track_turn(recording)
    return found is None or found[2]
