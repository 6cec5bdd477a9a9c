"""What a recording measured, as residual streams: observed numbers and what the physics needs to predict each of them.

NumPy only: the controls of a recording become arrays on the host once, and :mod:`~glider_jax.inference.replay` turns
them into predictions. Conventions a newcomer would get wrong: vertical speed is *depth rate, positive down*, the
slope of depth over a window; a window belongs to a leg (half yo), a leg to a segment (fix to fix).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from glider_jax.config import Mission, Vehicle
from glider_jax.environment import seawater
from glider_jax.inference import instruments
from glider_jax.inference import windows as win
from glider_jax.inference.controls import Rows, rows_of
from glider_jax.inference.kinematics import from_depth_rate, why_unknown
from glider_jax.inference.products import along_track, depth_along_track
from glider_jax.readers.dead_reckoning import finite, magnetic_variation
from glider_jax.readers.dives import Leg, legs, surfacings
from glider_jax.readers.segments import Segment, dive_segments
from glider_jax.records import Array, BathymetryGrid, CurrentGrid, Recording

#: s; over longer steps no motion is followed: the glide is steady long before their end.
LONGEST_STEP = 90.0
#: Fewer dives between surfacings are cut into blocks of some yos each.
FEW_BLOCKS = 8
#: s; length of a window of vertical speed.
WINDOW = 40.0


@dataclass(frozen=True)
class Stream:
    """One kind of measurement: n numbers with their times, groups and covariates.

    Attributes
    ----------
    name, unit, shown, shown_per_unit : public name, SI unit, and unit and factor of reports.
    value, time : (n,) observed number, s since the recording's first row.
    group : (n,) int, what shares a random effect (a leg, or a segment).
    block : (n,) int, the dive segment; hold-outs and permutations keep blocks whole.
    weight : (n,) relative number of samples behind each number; the white variance goes with its inverse.
    span : (n,) s over which each number is a mean.
    covariates : name -> (n,), what the residual may depend on.
    """

    name: str
    unit: str
    shown: str
    shown_per_unit: float
    value: Array
    time: Array
    group: Array
    block: Array
    weight: Array
    span: Array
    covariates: dict[str, Array] = field(default_factory=dict)

    @property
    def n(self) -> int:
        """How many numbers."""
        return int(self.value.size)


class Inputs(NamedTuple):
    """What the replay needs: samples as fields by name, and arrays aligned with them; see :func:`gather`."""

    rows: dict[str, Array]
    step: Array
    direction: Array
    follows: Array
    wander: Array
    wander_rate: Array
    window: Array
    window_weight: Array
    course: Array
    course_share: Array
    drift: Array
    drift_share: Array
    product_east: Array
    product_north: Array
    events: dict[str, Array]
    event_out: Array
    event_seconds: Array
    loads: dict[str, Array]
    load_surface: Array
    pulses: dict[str, Array]
    turns: dict[str, Array]
    floors: dict[str, Array]
    depths: Array
    stays: Array
    ratios: Array
    speeds: Array


class Sizes(NamedTuple):
    """How many windows, courses, drifts, strokes out and quiet loads of each phase there are; static."""

    window: int
    course: int
    drift: int
    out: int
    dives: int
    climbs: int


@dataclass(frozen=True)
class Gathered:
    """A recording made ready: streams in the order the replay predicts them, inputs, segments, what was missing."""

    streams: tuple[Stream, ...]
    inputs: Inputs
    sizes: Sizes
    rows: Rows
    ways: tuple[Leg, ...]
    segments: tuple[Segment, ...]
    origin: float
    missing: tuple[str, ...]
    notes: tuple[str, ...]
    product: bool
    latitude: float
    odd_strokes: tuple[tuple[float, float], ...] = ()
    #: False where the depth rate had to stand in for the pumped volume: what drives the glide is then no evidence.
    buoyancy_known: bool = True

    def stream(self, name: str) -> Stream | None:
        """A stream by name, None where the recording does not have it."""
        return next((s for s in self.streams if s.name == name), None)


def gather(
    recording: Recording,
    vehicle: Vehicle,
    mission: Mission | None = None,
    currents: CurrentGrid | None = None,
    bathymetry: BathymetryGrid | None = None,
) -> Gathered:
    """Make streams and replay inputs of a recording.

    Raises
    ------
    DataError : depth or pitch were not recorded, or the glider never dived.
    """
    ways = legs(recording)
    middle = _middle(recording)
    latitude = np.radians(middle[0])
    turn = magnetic_variation(recording)
    rows = rows_of(recording, ways, turn, latitude)
    unknown = why_unknown(recording)
    rows = from_depth_rate(rows, vehicle, latitude) if unknown else rows
    segments = dive_segments(recording, variation=turn.value) if "gps_latitude" in recording else []
    builder = Builder(recording, vehicle, mission, currents, bathymetry, rows, ways, segments, middle)
    if unknown:
        builder.missing.append(
            f"{unknown}: speed through the water is that of the recorded depth rate and pitch, and vertical speed is "
            "no evidence"
        )
    return replace(builder.build(turn), buoyancy_known=not unknown)


def yos_together(fresh: Array) -> Array:
    """Which legs begin a block: those after a surfacing, and within long segments every so many yos.

    A record of a few long segments would otherwise have too few blocks to hold any out or to flip in sign.
    """
    count = int(fresh.sum())
    if count >= FEW_BLOCKS or fresh.size < 4:
        return fresh
    since = np.arange(fresh.size) - np.maximum.accumulate(np.where(fresh, np.arange(fresh.size), 0))
    together = 2 * max(1, int(np.ceil(fresh.size / (2.0 * FEW_BLOCKS))))
    return since % together == 0


def _middle(recording: Recording) -> tuple[float, float]:
    for names in (("gps_latitude", "gps_longitude"), ("latitude", "longitude")):
        first, second = finite(recording, names[0])[1], finite(recording, names[1])[1]
        if first.size and second.size:
            return float(np.median(first)), float(np.median(second))
    return 45.0, 0.0


class Builder:
    """Collects streams one by one; whoever adds says in ``missing`` what could not be made."""

    def __init__(self, recording, vehicle, mission, currents, bathymetry, rows, ways, segments, middle):
        self.recording, self.vehicle, self.mission = recording, vehicle, mission
        self.currents, self.bathymetry, self.rows = currents, bathymetry, rows
        self.ways, self.segments, self.middle = ways, segments, middle
        self.origin = float(recording.time[0])
        self.latitude = float(np.radians(middle[0]))
        self.missing: list[str] = []
        self.notes: list[str] = []
        self.odd: list[tuple[float, float]] = []
        self.streams: list[Stream] = []
        starts = np.array([way.start_time for way in ways])
        ends = np.array([way.end_time for way in ways])
        fresh = yos_together(np.append(True, starts[1:] > ends[:-1] + 1.0))
        self.leg_block = np.cumsum(fresh) - 1
        first = np.flatnonzero(fresh)
        last = np.append(first[1:] - 1, len(ways) - 1)
        self.spans = np.stack([starts[first], ends[last]], axis=1)
        self.stays = surfacings(recording)
        self.power = win.power_rows(recording)

    def build(self, turn) -> Gathered:
        rows = self.rows
        flown = self._track()
        fields = self._row_fields(flown)
        window, weight = self._speed_windows()
        course, course_share = self._courses(turn)
        drift, drift_share = self._drifts()
        product = self.currents is not None
        events, out, seconds = instruments.strokes(self)
        loads, surface = instruments.loads(self)
        pulses = instruments.pulses(self)
        turns = instruments.turns(self)
        floors = instruments.floors(self, flown)
        depths, stays, ratios, speeds = instruments.others(self)
        if self.currents is None:
            self.missing.append(
                "no current product was given: flow is unknown rather than wrong, and every drift counts as left out"
            )
        inputs = Inputs(
            rows=fields, step=np.clip(np.diff(rows.time, prepend=rows.time[0]), 0.0, 600.0),
            direction=rows.direction, follows=self._followed(), **self._wander(), window=window, window_weight=weight,
            course=course, course_share=course_share, drift=drift, drift_share=drift_share,
            product_east=fields["surface_current_east"], product_north=fields["surface_current_north"],
            events=events, event_out=out, event_seconds=seconds, loads=loads, load_surface=surface, pulses=pulses,
            turns=turns, floors=floors, depths=depths, stays=stays, ratios=ratios, speeds=speeds,
        )  # fmt: skip
        counts = {s.name: s.n for s in self.streams}
        sizes = Sizes(
            *(
                counts.get(name, 0)
                for name in (
                    "vertical speed",
                    "displacement east",
                    "surface drift east",
                    "pump out energy",
                    "hotel power, dives",
                    "hotel power, climbs",
                )
            )
        )
        return Gathered(
            tuple(self.streams), inputs, sizes, rows, tuple(self.ways), tuple(self.segments), self.origin,
            tuple(self.missing), tuple(self.notes), product, self.latitude, tuple(self.odd),
        )  # fmt: skip

    def add(self, name, unit, shown, factor, value, moment, group, block, weight, span, **covariates):
        order = [np.asarray(a, float) for a in (value, moment, weight, span)]
        self.streams.append(
            Stream(
                name,
                unit,
                shown,
                factor,
                order[0],
                order[1] - self.origin,
                np.asarray(group, int),
                np.asarray(block, int),
                order[2],
                order[3],
                {key: np.asarray(v, float) for key, v in covariates.items()},
            )  # fmt: skip
        )

    def _track(self):
        """Latitude and longitude of every row: the vehicle's own, pinned to its fixes; else the middle."""
        time = self.rows.time
        fix, lat = finite(self.recording, "gps_latitude")
        _, lon = finite(self.recording, "gps_longitude")
        if fix.size < 2 or lon.size != lat.size:
            return np.full(time.size, self.middle[0]), np.full(time.size, self.middle[1])
        return np.interp(time, fix, lat), np.interp(time, fix, lon)

    def _product(self, time, latitude, longitude, depth):
        if self.currents is None:
            return np.zeros(time.size), np.zeros(time.size)
        coarse = np.unique(np.append(np.arange(time[0], time[-1], 300.0), time[-1]))
        at = [np.interp(coarse, time, x) for x in (latitude, longitude)]
        if self.currents.depth_resolved:
            east, north, known = along_track(self.currents, time, latitude, longitude, depth)
            coarse = time
        else:
            east, north, known = along_track(self.currents, coarse, *at, np.zeros(coarse.size))
        share = float(known.mean())
        if share < 0.5:
            self.missing.append(f"the current product knows only {100 * share:.0f} % of the track")
        elif share < 0.98:
            self.notes.append(f"The current product has values on {100 * share:.0f} % of the track.")
        if not known.any():
            return np.zeros(time.size), np.zeros(time.size)
        return np.interp(time, coarse[known], east[known]), np.interp(time, coarse[known], north[known])

    def _row_fields(self, flown):
        rows = self.rows
        pressure = seawater.pressure_from_depth(np.maximum(rows.depth, 0.0), self.latitude)
        east, north = self._product(rows.time, *flown, rows.depth)
        bottom = np.full(rows.time.size, np.nan)
        moments, known = finite(self.recording, "water_depth")
        if moments.size > 5:
            bottom = np.interp(rows.time, moments, known)
        elif self.bathymetry is not None:
            bottom = depth_along_track(self.bathymetry, *flown)
        bottom = np.where(np.isfinite(bottom), bottom, max(1.5 * float(rows.depth.max()), 1.0))
        mean = float(np.mean(rows.density[rows.direction != 0.0]))
        turn = np.gradient(np.unwrap(np.nan_to_num(rows.heading)), rows.time)
        voltage = np.full(rows.time.size, 14.0)
        return {
            "time": rows.time - self.origin, "elapsed": rows.time - self.origin, "depth": rows.depth,
            "sea_pressure": np.asarray(pressure), "temperature": rows.temperature, "density": rows.density,
            "reference_density": np.full(rows.time.size, mean), "pitch": rows.pitch, "roll": rows.roll,
            "turn_rate": np.clip(turn, -0.02, 0.02), "direction": rows.direction, "buoyancy_volume": rows.volume,
            "heading": np.nan_to_num(rows.heading), "surface_current_east": east, "surface_current_north": north,
            "bottom_depth": np.maximum(bottom, rows.depth + 1.0),
            "height_above_bottom": np.maximum(bottom - rows.depth, 0.0),
            "latitude": np.full(rows.time.size, self.latitude),
            "gravity": np.full(rows.time.size, float(seawater.gravity(self.latitude))),
            "battery_temperature": rows.battery_temperature, "time_since_surfacing": rows.since_surfacing,
            "time_since_inflection": rows.since_turn, "fin_rate": rows.fin_rate, "inflections": rows.turns,
            "thruster_power": rows.thruster, "voltage": voltage,
        }  # fmt: skip

    def _speed_windows(self):
        """Windows of settled glide: index of each row, and weights that make a mean rate the slope of depth."""
        rows = self.rows
        index, weight = np.full(rows.time.size, -1), np.zeros(rows.time.size)
        usual = float(np.median(np.diff(rows.time)))
        length = max(WINDOW, 4.0 * usual)
        value, time, leg, span, first, last, warmer = [], [], [], [], [], [], []
        good = np.flatnonzero(rows.settled)
        gaps = (np.diff(good) > 1) | (np.diff(rows.leg[good]) != 0) if good.size else np.empty(0, bool)
        for run in np.split(good, np.flatnonzero(gaps) + 1) if good.size else []:
            if run.size < 3:
                continue
            t = rows.time[run]
            parts = max(1, int(round((t[-1] - t[0]) / length)))
            for mine in np.array_split(run, parts):
                if mine.size < 3 or rows.time[mine[-1]] - rows.time[mine[0]] > 4.0 * length:
                    continue
                moments, depth = rows.time[mine], rows.depth[mine]
                a = moments - moments.mean()
                a /= (a * a).sum()
                value.append(float(a @ depth))
                # depth_k = depth_0 + sum of rate x step, so the slope is a weighted sum of the steps' rates.
                ahead = np.cumsum(a[::-1])[::-1][1:]
                index[mine[1:]] = len(value) - 1
                weight[mine[1:]] = ahead * np.diff(moments)
                time.append(moments.mean())
                leg.append(rows.leg[mine[0]])
                span.append(moments[-1] - moments[0])
                first.append(mine[0])
                last.append(mine[-1])
                below = depth - depth.mean()
                warmer.append(float(below @ rows.temperature[mine] / max(float(below @ below), 1e-3)))
        if not value:
            self.missing.append("no settled glide of half a minute: the flight physics cannot be looked at")
            return index, weight
        mid = (np.array(first) + np.array(last)) // 2
        leg = np.array(leg)
        n = np.array(last) - np.array(first) + 1
        # Layers times the usual speed: the rate as felt would hold the heave of the water that is to be explained.
        warming = np.array(warmer) * win.usual_rate(rows.depth[mid], rows.direction[mid], np.array(value))
        self.add(
            "vertical speed", "m s-1", "cm/s", 100.0, value, time, leg, self.leg_block[leg],
            (n / 5.0) ** 3, span,
            depth=rows.depth[mid], temperature=rows.temperature[mid], density=rows.density[mid],
            direction=rows.direction[mid], heading=np.nan_to_num(rows.heading[mid]),
            since_turn=rows.since_turn[mid], since_surfacing=rows.since_surfacing[mid],
            warming=np.clip(warming, -0.2, 0.2), time=rows.time[mid] - self.origin,
            pitch=np.abs(rows.pitch[mid]), roll=rows.roll[mid],
        )  # fmt: skip
        return index, weight

    def _followed(self):
        """Rows whose motion follows from the row before: under water, soon after it, driven by what is known."""
        rows = self.rows
        soon = np.diff(rows.time, prepend=rows.time[0]) <= LONGEST_STEP
        known = rows.controlled & np.append(False, rows.controlled[:-1])
        return soon & known & (rows.direction != 0.0) & rows.settled.any()

    def _wander(self):
        """Pitch of settled glide against its half yo's mean, rad, and its rate."""
        rows = self.rows
        wander = np.zeros(rows.time.size)
        good = np.flatnonzero(rows.settled)
        if good.size:
            _, code = np.unique(rows.leg[good], return_inverse=True)
            wander[good] = rows.pitch[good] - (np.bincount(code, rows.pitch[good]) / np.bincount(code))[code]
        return {"wander": wander, "wander_rate": np.where(rows.settled, np.gradient(wander, rows.time), 0.0)}

    def _courses(self, turn):
        """Dive segments: shares of each row's step in the segment's duration, so that sums are mean velocities."""
        rows = self.rows
        index, share = np.full(rows.time.size, -1), np.zeros(rows.time.size)
        if turn.how == "assumed":
            self.notes.append("The headings are magnetic and no declination is known: taken as zero.")
        heading_known = np.isfinite(rows.heading).mean() > 0.5
        kept = []
        for number, one in enumerate(self.segments):
            span = one.end_time - one.start_time
            if one.gap or one.longest_hole > 900.0 or span < 900.0:
                continue
            mine = np.flatnonzero((rows.time > one.start_time) & (rows.time <= one.end_time + 30.0))
            if mine.size < 10 or np.isfinite(rows.heading[mine]).mean() < 0.8:
                continue
            low = np.clip(np.maximum(rows.time[mine - 1], one.start_time), None, one.end_time)
            high = np.minimum(rows.time[mine], one.end_time)
            index[mine] = len(kept)
            share[mine] = np.maximum(high - low, 0.0) / span
            total = share[mine].sum()
            share[mine] /= max(total, 1e-9)
            kept.append(number)
        if not kept:
            why = "no GPS fixes" if not self.segments else "no headings" if not heading_known else "gaps"
            self.missing.append(f"no dive segment between fixes can be used ({why}): navigation cannot be looked at")
            return index, share
        one = [self.segments[k] for k in kept]
        span = np.array([s.end_time - s.start_time for s in one])
        middle = np.array([0.5 * (s.start_time + s.end_time) for s in one])
        block = np.array([self.block(s.dive_time) for s in one])
        shared = dict(
            heading=[s.heading for s in one], depth=[s.maximum_depth for s in one], time=middle - self.origin,
            tide=((middle - self.origin) / 44714.0) % 1.0,
        )  # fmt: skip
        for name, metres_moved in (("east", [s.east for s in one]), ("north", [s.north for s in one])):
            self.add(
                f"displacement {name}", "m s-1", "cm/s", 100.0, np.array(metres_moved) / span, middle, block, block,
                np.ones(len(one)), span, **shared,
            )  # fmt: skip
        return index, share

    def block(self, moment: float) -> int:
        return int(np.clip(np.searchsorted(self.spans[:, 0], moment + 60.0) - 1, 0, len(self.spans) - 1))

    def _drifts(self):
        rows = self.rows
        index, share = np.full(rows.time.size, -1), np.zeros(rows.time.size)
        found = []
        for number, stay in enumerate(self.stays):
            measured = win.drift_weights(stay, self.middle)
            if measured is None:
                continue
            mine = np.flatnonzero((rows.time >= stay.time[0]) & (rows.time <= stay.time[-1]) & (rows.direction == 0.0))
            if mine.size < 3:
                continue
            index[mine] = len(found)
            share[mine] = 1.0 / mine.size
            found.append((0.5 * (stay.time[0] + stay.time[-1]), number, *measured))
        if not found:
            self.missing.append("fewer than four fixes at any surfacing: the drift at the surface was not measured")
            return index, share
        table = np.array(found)
        block = [self.block(t) for t in table[:, 0]]
        for column, name in ((2, "east"), (3, "north")):
            self.add(
                f"surface drift {name}", "m s-1", "cm/s", 100.0, table[:, column], table[:, 0], block, block,
                np.minimum(table[:, 4] / 600.0, 3.0) ** 2, table[:, 4],
                time=table[:, 0] - self.origin, tide=((table[:, 0] - self.origin) / 44714.0) % 1.0,
            )  # fmt: skip
        return index, share
