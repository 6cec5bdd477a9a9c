"""From records to a finished ensemble: choose the frame, tabulate, draw, fly in chunks, and bring home a ``Track``.

The one place where the pieces meet; the command line, notebooks and live forecasts call :func:`forecast`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from glider_jax import __version__
from glider_jax.config import Mission, Vehicle
from glider_jax.environment.fields import flat_bottom, make_bathymetry, make_currents, still_water
from glider_jax.environment.frame import Frame
from glider_jax.errors import ConfigError, CoverageError, Outcome
from glider_jax.mission.battery import battery_state, energy_limits, mean_voltage
from glider_jax.mission.ensemble import Column, Output, draw_members, host_normals, run_members
from glider_jax.mission.plan import Plan, Shape, legs_of, make_plan, not_simulated
from glider_jax.mission.rules import deepest, program_notes, program_results, program_words
from glider_jax.mission.state import Environment, Member, State
from glider_jax.mission.water import make_column
from glider_jax.physics.battery import draw_usable_charge
from glider_jax.physics.devices import build_devices
from glider_jax.physics.model import build_model, parameter_infos, parameters
from glider_jax.physics.term import Channel, Sample
from glider_jax.records import BathymetryGrid, CurrentGrid, Track, WaterProfile

CHUNK = 5_000
DAY = 86400.0
_MOTORS = ("pump out", "pump in", "brake", "hotel")


@dataclass(frozen=True)
class Run:
    """Everything a forecast needs, prepared once; chunks of members are flown from it.

    ``notes`` are sentences for the user. ``settings`` goes into every product.
    """

    mission: Mission
    vehicle: Vehicle
    plan: Plan
    shape: Shape
    environment: Environment
    column: Column | None
    frame: Frame
    model: Any
    devices: Any
    t0: float
    interval: float
    duration: float
    start: tuple[float, float]
    order: tuple[tuple[float, float], ...]
    seed: int
    spread: float
    water_temperature: float
    settings: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def origin(self) -> tuple[float, float]:
        """Where the mission starts, (east, north) frame metres; zero unless the frame is a fleet's."""
        east, north = self.frame.to_metres(*self.start)
        return float(east), float(north)


def output_interval(duration: float, mission: Mission) -> float:
    """Seconds between outputs: about 120 over the forecast, on round values, and never longer than the time between
    two surfacings, so that none is lost."""
    choices = np.array([300.0, 600.0, 900.0, 1800.0, 3600.0, 7200.0, 10800.0])
    periods = [r.seconds for r in mission.surface if r.kind in ("every", "after", "no_comms") and r.seconds > 0]
    periods += [rule.surface_every for rule in mission.program if rule.surface_every]
    wanted = min([duration / 120.0, *periods])
    fitting = choices[choices <= max(wanted * 1.0001, choices[0])]
    return float(fitting[-1])


def prepare(
    mission: Mission,
    vehicle: Vehicle,
    *,
    currents: CurrentGrid | None = None,
    bathymetry: BathymetryGrid | None = None,
    water: WaterProfile | None = None,
    speed: str = "distribution",
    speeds: tuple[np.ndarray, np.ndarray] | None = None,
    duration: float = 15 * 86400.0,
    interval: float | None = None,
    seed: int = 0,
    spread: float = 1.0,
    start: float | None = None,
    start_position: tuple[float, float] | None = None,
    current_error: float | None = None,
    dtype=jnp.float32,
    frame: Frame | None = None,
    beside: Run | None = None,
) -> Run:
    """Check the inputs against each other and tabulate them.

    Parameters
    ----------
    mission, vehicle : as read.  currents, bathymetry, water : records, or None for still water, a seafloor that is
        never reached and a uniform water column.
    speed : ``shoebox``, ``distribution`` or ``flight``; ``speeds`` are the nodes and probabilities of the first two.
    duration : s to forecast.  interval : s between outputs, chosen if None.
    seed : of all random draws.  spread : factor on every perturbation, 0 for one deterministic flight.
    start, start_position : override the mission's.
    current_error : m s-1 per component where the product states none; the vehicle's perturbation if None.
    frame : of a fleet; made about the mission's start if None.
    beside : a run of the same fleet, fields and frame; its tables are used where it starts at the same time.

    Raises
    ------
    ConfigError : no start position, a duration that is not positive.
    CoverageError : the mission starts outside the currents or the bathymetry, or on land.
    """
    position = start_position or mission.start_position
    if position is None:
        raise ConfigError(
            f"{mission.name}: expected a start position, found none. Put start_position = [lat, lon] into the mission, "
            "or give --start-position LAT LON."
        )
    t0 = start if start is not None else mission.start
    if t0 is None and currents is not None and not currents.constant_in_time:
        t0 = float(currents.time[0])
    if t0 is None:
        raise ConfigError(f"{mission.name}: expected a start time, found none. Give --start TIME (UTC, ISO 8601).")
    if not duration > 0:
        raise ConfigError(f"duration: expected more than 0 days, found {duration / 86400.0:g}. Give --days.")
    interval = output_interval(duration, mission) if interval is None else interval
    if frame is None:
        frame = frame_about([position, *mission.waypoints])
    default_sd = vehicle.value("perturbation.current_error") if current_error is None else current_error
    notes = [*mission.notes, *(f"not simulated: {text}" for text in not_simulated(mission))]
    notes += program_notes(mission, bathymetry is not None)
    _check_start(mission, position, t0, currents, bathymetry)
    own_error = currents is not None and currents.east_sd is not None
    if beside is not None and beside.t0 == float(t0):
        environment = beside.environment
    else:
        environment = _tabulate(currents, bathymetry, frame, t0, default_sd, dtype)
    if bathymetry is None:
        notes.append("no bathymetry given: the seafloor is never reached")
    column, temperature, told = make_column(water, vehicle, deepest(mission), position[0], dtype=dtype)
    notes += told if speed == "flight" else []
    model = build_model(vehicle, dtype=dtype)
    # Tables of the glide last the whole forecast unless something in them changes with time.
    block = DAY if model.glide_reads("time", "elapsed") else math.inf
    plan, shape = make_plan(
        mission, vehicle, frame, t0=t0, duration=duration, speed=speed, speeds=speeds, interval=interval, block=block,
        levels=column.depth.shape[0], product_error=own_error, temperature=temperature,
        density=float(np.mean(np.asarray(column.density))), home=position, dtype=dtype,
    )  # fmt: skip
    devices = build_devices(
        vehicle.devices, mission.samples, dive_to=mission.yo.dive_to, climb_to=mission.yo.climb_to, dtype=dtype
    )
    return Run(
        mission=mission, vehicle=vehicle, plan=plan, shape=shape,
        environment=environment, column=column if speed == "flight" else None,
        frame=frame, model=model, devices=devices, t0=float(t0), interval=interval,
        duration=duration, start=position, order=tuple(legs_of(mission)[0]), seed=seed, spread=spread,
        water_temperature=temperature, notes=tuple(notes),
        settings={
            "version": __version__, "seed": seed, "speed": speed, "spread": spread, "start": float(t0),
            "duration_s": duration, "interval_s": interval, "start_position": list(position),
            "mission": mission.name, "vehicle": vehicle.name, "precision": jnp.dtype(dtype).name,
            "inputs": _digests(mission, vehicle, currents, bathymetry, water),
            "parameter_units": {name: info.unit for name, info in parameter_infos(model).items()}
            | {"heading_error": "rad", "surface_stay_factor": "1", "speed_factor": "1"},
            "current_error": "product" if own_error else f"{default_sd:g} m s-1",
        } | ({"program": program_words(mission)} if mission.program else {}),
    )  # fmt: skip


def frame_about(points) -> Frame:
    """A frame with its origin at the first of some (latitude, longitude) points, good for all of them and around."""
    latitudes = [point[0] for point in points]
    return Frame(points[0][0], points[0][1], min(latitudes) - 1.5, max(latitudes) + 1.5)


def _tabulate(currents, bathymetry, frame: Frame, t0: float, default_sd: float, dtype) -> Environment:
    """The fields as tables in a frame; still water and a seafloor that is never reached where there are none."""
    if currents is None:
        water = still_water(frame, default_sd, dtype)
    else:
        water = make_currents(currents, frame, t0, default_sd=default_sd, dtype=dtype)
    if bathymetry is None:
        floor = flat_bottom(11000.0, frame, dtype)
    else:
        floor = make_bathymetry(bathymetry, frame, dtype)
    return Environment(frame.cast(dtype), water, floor)


def _digests(*records):
    found = {}
    for record in records:
        source = getattr(record, "source", None)
        if source is not None:
            found.update({str(k).rsplit("/", 1)[-1]: v for k, v in source.files.items()})
    return found


def _check_start(mission, position, t0, currents, bathymetry):
    """Say at once where a mission cannot start, instead of ending every member at its first step."""
    lat, lon = position

    def outside(grid, what):
        west, east = float(grid.longitude[0]), float(grid.longitude[-1])
        shifted = west + (lon - west) % 360.0
        if not (grid.latitude[0] <= lat <= grid.latitude[-1] and shifted <= east):
            raise CoverageError(
                f"{mission.name}: expected a start inside the {what} ({grid.latitude[0]:.3f} to "
                f"{grid.latitude[-1]:.3f} N, {west:.3f} to {east:.3f} E), found {lat:.4f} N, {lon:.4f} E. "
                f"Give a {what} file that covers it, or correct the position."
            )
        return np.argmin(np.abs(grid.latitude - lat)), np.argmin(np.abs(grid.longitude - shifted))

    if bathymetry is not None:
        j, i = outside(bathymetry, "bathymetry")
        depth = float(bathymetry.depth[j, i])
        if not depth > 0:
            raise CoverageError(
                f"{mission.name}: expected a start in water, found {'land' if depth <= 0 else 'no data'} at "
                f"{lat:.4f} N, {lon:.4f} E (bathymetry {depth:.1f} m). Correct the start position."
            )
    if currents is not None:
        j, i = outside(currents, "currents")
        near = currents.east[:, :, max(j - 3, 0) : j + 4, max(i - 3, 0) : i + 4]
        if not np.isfinite(near).any():
            raise CoverageError(
                f"{mission.name}: expected currents at the start, found none within three cells of {lat:.4f} N, "
                f"{lon:.4f} E. Fill the gaps, or use another product."
            )
        varies = currents.time.size > 1 and not currents.constant_in_time
        if varies and not currents.time[0] - 1 <= t0 <= currents.time[-1]:
            first, last, at = (f"{np.datetime64(int(t), 's')}Z" for t in (currents.time[0], currents.time[-1], t0))
            raise CoverageError(
                f"{mission.name}: expected a start between {first} and {last}, the times of the currents, found {at}. "
                "Give --start, or currents of those days."
            )


def forecast(n: int, run: Run, *, first: int = 0, chunk: int = CHUNK) -> Track:
    """Fly ``n`` members, numbered from ``first``, and join their chunks."""
    return join([*fly_chunks(n, run, first=first, chunk=chunk)])


def fly_chunks(n: int, run: Run, *, first: int = 0, chunk: int = CHUNK) -> Iterator[Track]:
    """Fly members in chunks and yield each chunk as a ``Track``; memory holds one chunk at a time.

    Where several processes fly together (``jax.distributed``), each flies its share of as many chunks as there are
    processes, and the first alone yields them, in the order in which one process would.

    Parameters
    ----------
    first : number of the first member; a multiple of ``chunk`` continues a run that was interrupted.

    Raises
    ------
    ConfigError : ``n`` is smaller than 1.
    """
    if n < 1:
        raise ConfigError(f"--n: expected at least 1 member, found {n}.")
    several = first > 0 or n > chunk
    together = chunk * jax.process_count()
    sd = run.vehicle.value("perturbation.initial_position")

    def launch(begin: int):
        members, available = draw_run(run, begin, min(together, first + n - begin))
        flown = run_members(
            members, run.plan, run.shape, run.environment, run.column, *run.origin, spread=run.spread, fix_sd=sd
        )
        return members, available, flown

    ahead = launch(first)
    for begin in range(first, first + n, together):
        members, available, flown = ahead
        # The next members fly while these are brought home and written.
        ahead = launch(begin + together) if begin + together < first + n else None
        if jax.process_index() > 0:
            continue
        count = available.size
        for low in range(0, count, chunk):
            part = slice(low, min(low + chunk, count))
            own, (state, outputs) = (members, flown) if count <= chunk else _cut(members, *flown, part)
            track = bring_home(run, own, available[part], state, outputs)
            del own, state, outputs
            if low + chunk >= count:
                # What was flown is at home now; the next members need the room.
                flown = None
            # Blocks that are written one after the other share their shape.
            yield pad_surfacings(track, most_surfacings(run)) if several else track


def _cut(members: Member, state: State, outputs: Output, part: slice):
    """Some of the members flown."""
    own, state = jax.tree.map(lambda a: a[part], (members, state))
    return own, (state, jax.tree.map(lambda a: a[:, part], outputs))


def draw_run(run: Run, begin: int, count: int):
    """Members and the energy (J) that each one's pack holds."""
    dtype = np.dtype(run.plan.interval.dtype)
    members = draw_members(run.model, run.vehicle, run.devices, run.spread, run.seed, begin, count, dtype)
    battery = run.vehicle.battery
    charge = draw_usable_charge(battery, run.water_temperature, host_normals(run.seed, begin, count), run.spread)
    # Rated energies are quoted at a nominal voltage; what can be drawn is the charge at the curve's voltage.
    available = np.broadcast_to(charge * mean_voltage(battery), (count,))
    if run.model.has(Channel.LOG_CAPACITY):
        here = Sample.of(dtype, temperature=run.water_temperature, battery_temperature=run.water_temperature)
        lost = jax.vmap(lambda model: model.total(Channel.LOG_CAPACITY, here))(jax.tree.map(jnp.asarray, members.model))
        available = available * np.exp(np.asarray(lost, float))
    limits, codes = energy_limits(battery, run.mission, available)
    return members._replace(energy_limit=limits.astype(dtype), limit_code=codes.astype(np.int32)), available


def bring_home(run: Run, members: Member, available, state: State, out: Output) -> Track:
    """Bring one chunk to the host: frame metres to degrees, intervals to times, devices to components."""
    out = jax.tree.map(np.asarray, out)
    final = jax.tree.map(np.asarray, state)
    times = run.t0 + run.interval * np.arange(out.east.shape[0] + 1)
    keep = times <= run.t0 + run.duration + 1e-6
    keep[-1] |= not keep.any()
    count = available.size

    def series(values, first):
        """(output, member) to (member, output) with the start in front."""
        begin = np.broadcast_to(np.asarray(first, values.dtype), (1, count))
        return np.ascontiguousarray(np.concatenate([begin, values])[keep].T)

    east, north = (series(v, begin) for v, begin in zip((out.east, out.north), run.origin, strict=True))
    latitude, longitude = run.frame.to_degrees(east, north)
    sums = type(out.sums)(*(series(values, 0.0) for values in out.sums))
    groups = run.devices.groups
    power = np.asarray(run.devices.power, float)
    calls = np.asarray(run.devices.joules_per_surfacing, float)
    turns = np.asarray(run.devices.joules_per_inflection, float)
    parts = [sums.pump, sums.retract, sums.brake, sums.hotel]
    for g in range(len(groups)):
        states = power[g, 0] * sums.dive_time + power[g, 1] * sums.climb_time + power[g, 2] * sums.surface_time
        parts.append(states + calls[g] * sums.surfacings + turns[g] * sums.inflections)
    energy = np.stack(parts, -1).astype(np.float32)
    total = energy.sum(-1, dtype=float)
    load = np.asarray(total[:, -1]) / max(run.duration, 1.0)
    charge, soc, volts = battery_state(run.vehicle.battery, total, available, load)
    surfaced, left, reasons = _surfacings(run, out, count)
    end_lat, end_lon = run.frame.to_degrees(final.east, final.north)
    active = series(out.active, True)
    return Track(
        time=times[keep], latitude=latitude, longitude=longitude, depth=series(out.depth, 0.0),
        phase=series(out.phase, 3), active=active, energy=energy, components=_MOTORS + tuple(groups),
        charge_used=charge, state_of_charge=soc, voltage=volts, distance_through_water=sums.through_water,
        distance_over_ground=sums.over_ground, inflections=sums.inflections,
        current_east=series(out.current_east, np.nan), current_north=series(out.current_north, np.nan),
        surfacing_time=surfaced[0], surfacing_latitude=surfaced[1], surfacing_longitude=surfaced[2],
        dive_time=left[0], dive_latitude=left[1], dive_longitude=left[2], surfacing_reason=reasons,
        reasons=run.shape.reasons, waypoint_time=run.t0 + np.stack(final.arrivals, -1).astype(float),
        waypoints=np.array(run.order, float), outcome=final.outcome.astype(np.int8),
        outcome_time=run.t0 + np.where(final.outcome == int(Outcome.FLYING), np.nan, final.end_time.astype(float)),
        outcome_latitude=end_lat, outcome_longitude=end_lon, bottom_contacts=final.contacts.astype(np.int32),
        usable_energy=available, parameters=_parameters(run, members), settings=dict(run.settings), notes=run.notes,
        **program_results(run.mission, final.program, run.t0),
    )  # fmt: skip


def _parameters(run, members):
    found = {name: np.asarray(v) for name, v in parameters(members.model).items()}
    found = {name: value for name, value in found.items() if value.ndim == 1 and np.ptp(value) > 0}
    extra = {"heading_error": members.heading, "surface_stay_factor": members.stay, "speed_factor": members.speed}
    return found | {name: np.asarray(value) for name, value in extra.items()}


def _surfacings(run, out: Output, count):
    """Sort the logs of the outputs into one list of surfacings per member.

    The logs are as of the end of the step that passed the output time, so they may be one event ahead of the sums.
    """
    up = _events(out.surfaced_before, out.surfaced, count)
    down = _events(out.left_before, out.left, count)
    most = up.shape[1]
    # A departure belongs to the surfacing before it; the last may have none.
    down = np.concatenate([down, np.full((count, max(0, most - down.shape[1]), 4), np.nan)], axis=1)[:, :most]
    logs = []
    for log in (up, down):
        latitude, longitude = run.frame.to_degrees(log[:, :, 1], log[:, :, 2])
        logs.append((run.t0 + log[:, :, 0], latitude, longitude))
    reasons = np.where(np.isfinite(up[:, :, 3]), up[:, :, 3], -1).astype(np.int8)
    return logs[0], logs[1], reasons


def _events(before, latest, count: int) -> np.ndarray:
    """Distinct events of each member in order, (member, event, 4): time s, east m, north m, reason; NaN-padded.

    An output holds the latest event and the one before; either is new if it came after the output before.
    """
    kind = np.asarray(latest.time).dtype
    logs = [np.stack([np.asarray(v, kind) for v in log], axis=-1) for log in (before, latest)]
    earlier = np.concatenate([np.full((1, count), -np.inf), logs[1][:-1, :, 0]])
    earlier = np.where(np.isnan(earlier), -np.inf, earlier)
    fresh = [log[:, :, 0] > earlier + 0.5 for log in logs]
    most = int(sum(new.sum(axis=0) for new in fresh).max(initial=1))
    table, place = np.full((count, most, 4), np.nan), np.zeros(count, int)
    for k in range(earlier.shape[0]):
        for log, new in zip(logs, fresh, strict=True):
            who = np.flatnonzero(new[k])
            table[who, place[who]] = log[k, who]
            place[who] += 1
    return table


def most_surfacings(run: Run) -> int:
    """How often a member can surface: by the clock, at waypoints, and twice per output interval at the most."""
    timed = ("every", "after", "no_comms", "utc")
    periods = [rule.seconds for rule in run.mission.surface if rule.kind in timed and rule.seconds > 0]
    ceiling = 2 * (int(run.duration / run.interval) + 1)
    if run.shape.bounded_yos or run.shape.loop or run.shape.program:
        return ceiling
    by_clock = sum(int(run.duration / seconds) + 1 for seconds in periods) if periods else 0
    return min(ceiling, by_clock + run.shape.waypoints + 2)


def pad_surfacings(track: Track, most: int) -> Track:
    """The track with its lists of surfacings NaN-padded, or cut, to ``most`` columns."""
    changes = {}
    for name in track.__dataclass_fields__:
        if name.startswith(("surfacing_", "dive_")):
            values = getattr(track, name)[:, :most]
            fill = -1 if name == "surfacing_reason" else np.nan
            changes[name] = np.pad(values, ((0, 0), (0, most - values.shape[1])), constant_values=fill)
    return replace(track, **changes)


def join(tracks: list[Track]) -> Track:
    """One ensemble from its chunks, members in order."""
    if len(tracks) == 1:
        return tracks[0]
    first = tracks[0]
    common = {"time", "components", "reasons", "waypoints", "settings", "notes", "complete", "program"}
    found = [int(np.isfinite(t.surfacing_time).sum(axis=1).max(initial=0)) for t in tracks]
    tracks = [pad_surfacings(t, max(1, *found)) for t in tracks]
    joined = {}
    for name in first.__dataclass_fields__:
        values = [getattr(t, name) for t in tracks]
        if name in common:
            joined[name] = values[0]
        elif name == "parameters":
            joined[name] = {key: np.concatenate([v[key] for v in values]) for key in values[0]}
        else:
            joined[name] = np.concatenate(values)
    return Track(**joined)
