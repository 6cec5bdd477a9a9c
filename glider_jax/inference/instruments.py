"""Streams of the instruments beside flight: pump strokes, loads, voltage, turns, seafloor, clocks and counters.

NumPy only. Each function takes the builder of :mod:`~glider_jax.inference.streams`, adds its streams to it and returns
what the replay needs to predict them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from glider_jax.inference import windows as win
from glider_jax.inference.products import depth_along_track
from glider_jax.readers.dead_reckoning import finite
from glider_jax.readers.dives import DESCENT

if TYPE_CHECKING:
    from glider_jax.inference.streams import Builder

#: m; height above the seafloor that stands for turns which the altimeter did not call.
FROM_FLOOR = 100.0


def strokes(b: Builder):
    if b.power is None:
        b.missing.append(f"{win.why_no_power(b.recording)}: energy cannot be looked at")
        return {}, np.empty(0), np.empty(0)
    found = win.strokes(b.power, b.rows, b.ways, b.recording)
    ways = [win.sort_strokes([s for s in found if s.out == way]) for way in (True, False)]
    listed = [s for way in ways for s in way.alike]
    b.odd = [(s.window.time - b.origin, excess) for s, excess in ways[0].odd]
    if len(listed) < 6:
        b.missing.append("no pump strokes could be isolated: their energy cannot be looked at")
        return {}, np.empty(0), np.empty(0)
    listed = sorted(listed, key=lambda s: (not s.out, s.window.time))
    number = np.array([s.leg for s in listed])
    middle = np.array([s.window.time for s in listed])
    depth = np.array([s.depth for s in listed])
    battery = np.interp(middle, b.rows.time, b.rows.battery_temperature)
    fields = {
        "time": middle - b.origin, "elapsed": middle - b.origin, "depth": depth, "inflection_depth": depth,
        "stroke_volume": np.array([s.volume for s in listed]), "temperature": np.array([s.temperature for s in listed]),
        "battery_temperature": battery, "inflections": number.astype(float), "direction": np.zeros(len(listed)),
        "voltage": np.array([s.window.voltage for s in listed]),
        "fin_rate": np.interp(middle, b.rows.time, b.rows.fin_rate),
    }  # fmt: skip
    out = np.array([s.out for s in listed])
    seconds = np.array([s.window.seconds for s in listed])
    for way, name in ((True, "pump out energy"), (False, "pump in energy")):
        mine = out == way
        if mine.any():
            b.add(
                name, "J", "J", 1.0, np.array([s.window.energy for s in listed])[mine], middle[mine],
                number[mine], b.leg_block[number[mine]], np.ones(mine.sum()), seconds[mine],
                depth=depth[mine], temperature=fields["temperature"][mine], time=fields["time"][mine],
            )  # fmt: skip
    return fields, out, seconds


def loads(b: Builder):
    if b.power is None:
        return {}, np.empty(0)
    quiet = win.quiet_loads(b.power, b.rows, b.spans)
    quiet.sort(key=lambda load: load.direction)
    up = win.surface_loads(b.power, b.stays)
    listed = [load.window for load in quiet] + [window for _, window, _ in up]
    if not listed:
        return {}, np.empty(0)
    middle = np.array([w.time for w in listed])
    stay = np.array([0.0] * len(quiet) + [s for _, _, s in up])
    near = [np.interp(middle, b.rows.time, x) for x in (b.rows.battery_temperature, b.rows.fin_rate)]
    fields = {
        "time": middle - b.origin, "elapsed": middle - b.origin,
        "direction": np.array([load.direction for load in quiet] + [0.0] * len(up)),
        "depth": np.array([load.depth for load in quiet] + [0.0] * len(up)),
        "voltage": np.array([w.voltage for w in listed]), "surface_duration": stay,
        "battery_temperature": near[0], "temperature": near[0], "fin_rate": near[1],
    }  # fmt: skip
    surface = np.array([False] * len(quiet) + [True] * len(up))
    mean = np.array([w.energy / w.seconds for w in listed])
    block = np.array([load.segment for load in quiet] + [b.block(w.time) for _, w, _ in up])
    groups = [("hotel power, dives", ~surface & (fields["direction"] < 0)),
              ("hotel power, climbs", ~surface & (fields["direction"] > 0)), ("surface power", surface)]  # fmt: skip
    for name, mine in groups:
        if mine.any():
            rows_in = np.array([w.rows for w in listed])[mine]
            b.add(
                name, "W", "W", 1.0, mean[mine], middle[mine], block[mine], block[mine],
                rows_in / np.median(rows_in), np.array([w.seconds for w in listed])[mine],
                time=fields["time"][mine], depth=fields["depth"][mine],
            )  # fmt: skip
    return fields, surface


def pulses(b: Builder):
    """Mean battery voltage per segment while quiet, pumping and surfaced."""
    if b.power is None or "battery_voltage" not in b.recording:
        if "battery_voltage" not in b.recording:
            b.missing.append("no battery voltage: sag and open-circuit voltage cannot be looked at")
        return {}
    power = b.power
    place = np.clip(np.searchsorted(b.rows.time, power.time), 0, b.rows.time.size - 1)
    surface = b.rows.direction[place] == 0.0
    heavy = power.busy & (power.current > np.percentile(power.current, 80))
    spent = np.concatenate([[0.0], np.cumsum(np.nan_to_num(power.energy[1:]))])
    _, charge = finite(b.recording, "charge_used")
    before = float(charge[0]) * float(np.median(power.voltage[:50])) if charge.size else 0.0
    usable = b.vehicle.battery.energy.value * 1.0
    found = []
    for number, (begin, end) in enumerate(b.spans):
        inside = (power.time > begin) & (power.time < end + 1500.0)
        if number + 1 < len(b.spans):
            inside &= power.time < b.spans[number + 1, 0]
        for kind, mine in enumerate((inside & ~power.busy & ~surface, inside & heavy, inside & surface & ~heavy)):
            rows = np.flatnonzero(mine & power.fresh)
            if rows.size >= 6:
                found.append((
                    power.time[rows].mean(), number, kind, power.voltage[rows].mean(), power.current[rows].mean(),
                    spent[rows].mean() + before, rows.size,
                ))  # fmt: skip
    if len(found) < 4:
        return {}
    table = np.array(found)
    fields = {
        "time": table[:, 0] - b.origin, "elapsed": table[:, 0] - b.origin, "current": table[:, 4],
        "state_of_charge": np.clip(1.0 - table[:, 5] / usable, 0.0, 1.0),
        "battery_temperature": np.interp(table[:, 0], b.rows.time, b.rows.battery_temperature),
    }  # fmt: skip
    b.add(
        "battery voltage", "V", "V", 1.0, table[:, 3], table[:, 0], table[:, 1], table[:, 1],
        np.minimum(table[:, 6] / 100.0, 3.0), np.full(len(found), 600.0), time=fields["time"],
        current=table[:, 4],
    )  # fmt: skip
    return fields


def turns(b: Builder):
    """Depth of lower turns against what was commanded: the yo's depth, or the altitude above the seafloor."""
    if b.mission is None:
        return {}
    yo = b.mission.yo
    moments, bottom = finite(b.recording, "water_depth")
    found = []
    for one, two in zip(b.ways[:-1], b.ways[1:], strict=True):
        if one.phase != DESCENT or one.end_time != two.start_time:
            continue
        limit, height = yo.dive_to, FROM_FLOOR
        if yo.dive_altitude and moments.size:
            near = np.abs(moments - one.end_time) < 240.0
            near &= moments <= one.end_time + 1.0
            if near.any():
                floor = float(np.median(bottom[near][-5:]))
                if floor - yo.dive_altitude < limit:
                    limit, height = floor - yo.dive_altitude, yo.dive_altitude
            elif yo.dive_to - one.end_depth > 3.0:
                continue
        rate = (one.end_depth - one.start_depth) / max(one.end_time - one.start_time, 1.0)
        found.append((one.end_time, one.end_depth, limit, height, rate))
    if len(found) < 6:
        return {}
    table = np.array(found)
    excess = table[:, 1] - table[:, 2]
    sane = np.abs(excess - np.median(excess)) < 25.0
    table = table[sane]
    fields = {
        "time": table[:, 0] - b.origin, "direction": -np.ones(len(table)), "height_above_bottom": table[:, 3],
        "depth_rate": table[:, 4],
    }  # fmt: skip
    block = [b.block(t) for t in table[:, 0]]
    b.add(
        "turn depth", "m", "m", 1.0, table[:, 1] - table[:, 2], table[:, 0], block, block, np.ones(len(table)),
        np.full(len(table), 60.0), time=fields["time"], depth=table[:, 2], rate=table[:, 4],
    )  # fmt: skip
    return fields


def floors(b: Builder, flown):
    """Water depth that the altimeter met, against the chart."""
    moments, bottom = finite(b.recording, "water_depth")
    if moments.size < 20 or b.bathymetry is None:
        if b.bathymetry is None:
            b.missing.append("no bathymetry was given: the chart cannot be compared with the altimeter")
        return {}
    place = [np.interp(moments, b.rows.time, x) for x in flown]
    chart = depth_along_track(b.bathymetry, *place)
    edges = np.arange(moments[0], moments[-1] + 1800.0, 1800.0)
    found = []
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        mine = (moments >= low) & (moments < high) & np.isfinite(chart)
        if mine.sum() >= 3:
            found.append((moments[mine].mean(), np.median(bottom[mine] - chart[mine]), mine.sum(), chart[mine].mean()))
    if len(found) < 4:
        return {}
    table = np.array(found)
    block = [b.block(t) for t in table[:, 0]]
    b.add(
        "water depth", "m", "m", 1.0, table[:, 1], table[:, 0], block, block, np.minimum(table[:, 2] / 5.0, 3.0),
        np.full(len(table), 1800.0), time=table[:, 0] - b.origin, depth=table[:, 3],
    )  # fmt: skip
    return {"time": table[:, 0] - b.origin, "depth": table[:, 3], "bottom_depth": table[:, 3]}


def others(b: Builder):
    """Zero of the gauge at the surface, lengths of stays, the charge counter, a measured speed."""
    depths = win.surface_depths(b.recording, b.stays)
    if len(depths) >= 2:
        block = [b.block(t) for _, t, _ in depths]
        b.add(
            "depth at the surface", "m", "m", 1.0, [d for _, _, d in depths], [t for _, t, _ in depths], block,
            block, np.ones(len(depths)), np.full(len(depths), 600.0), time=[t - b.origin for _, t, _ in depths],
        )  # fmt: skip
    known = [(s.start, s.end - s.start) for s in b.stays if np.isfinite(s.start) and np.isfinite(s.end)]
    if b.mission is None or len(known) < 3:
        known = []
    if known:
        block = [b.block(t) for t, _ in known]
        b.add(
            "surface stay", "s", "min", 1.0 / 60.0, [d - b.mission.surface_stay for _, d in known],
            [t for t, _ in known], block, block, np.ones(len(known)), np.full(len(known), 600.0),
            time=[t - b.origin for t, _ in known],
        )  # fmt: skip
    ratios = win.charge_ratios(b.recording, b.spans)
    if len(ratios) >= 2:
        b.add(
            "charge counter", "1", "%", 100.0, [r for _, _, r, _ in ratios], [t for _, t, _, _ in ratios],
            [k for k, *_ in ratios], [k for k, *_ in ratios],
            [c / np.median([q for *_, q in ratios]) for *_, c in ratios],
            np.full(len(ratios), 3600.0), time=[t - b.origin for _, t, _, _ in ratios],
        )  # fmt: skip
    speeds = measured_speed(b)
    return (
        np.zeros(len(depths) if len(depths) >= 2 else 0),
        np.zeros(len(known)),
        np.zeros(len(ratios) if len(ratios) >= 2 else 0),
        speeds,
    )


def measured_speed(b: Builder):
    """Speed along the path that an instrument measured (channel ``measured_speed``), means of 20 s of settled glide."""
    moments, speed = finite(b.recording, "measured_speed")
    if moments.size < 30:
        return np.empty(0, int)
    rows = b.rows
    good = np.flatnonzero(rows.settled)
    total = np.concatenate([[0.0], np.cumsum(speed)])
    low, high = (
        np.searchsorted(moments, rows.time[good] + way, side) for way, side in ((-10.0, "left"), (10.0, "right"))
    )
    count = high - low
    good, known = good[count > 0], (total[high] - total[low])[count > 0] / count[count > 0]
    sane = sane_legs(b, good, known)
    good, known = good[sane], known[sane]
    if good.size < 10:
        return np.empty(0, int)
    take = np.arange(0, good.size, max(1, int(round(20.0 / np.median(np.diff(rows.time))))))
    good, known = good[take], known[take]
    leg = rows.leg[good]
    b.add(
        "speed through water", "m s-1", "cm/s", 100.0, known, rows.time[good], leg, b.leg_block[leg],
        np.ones(good.size), np.full(good.size, 20.0), depth=rows.depth[good], direction=rows.direction[good],
        time=rows.time[good] - b.origin, pitch=np.abs(rows.pitch[good]), temperature=rows.temperature[good],
    )  # fmt: skip
    return good


def sane_legs(b: Builder, rows: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Rows of legs whose measured speed agrees with the others'; a profiler that lost the bottom spoils a whole leg.

    Compared is the speed over that of the depth along the hull's axis, whose median is alike for all legs of one way.
    """
    along = np.abs(np.gradient(b.rows.depth, b.rows.time)[rows]) / np.sin(np.maximum(np.abs(b.rows.pitch[rows]), 0.1))
    ratio = speed / np.maximum(along, 0.02)
    keep = np.ones(rows.size, bool)
    legs, direction = b.rows.leg[rows], b.rows.direction[rows]
    for way in (-1.0, 1.0):
        own = np.unique(legs[direction == way])
        if own.size < 5:
            continue
        # The last third tells of series that fail on the way down.
        level = np.array([np.median(ratio[legs == leg]) for leg in own])
        late = np.array([np.median(ratio[legs == leg][-(max((legs == leg).sum() // 3, 1)) :]) for leg in own])
        for values in (level, late):
            scatter = 1.4826 * np.median(np.abs(values - np.median(values)))
            wild = np.abs(values - np.median(values)) > max(6.0 * scatter, 0.08)
            keep &= ~np.isin(legs, own[wild])
    lost = np.unique(legs[~keep])
    if lost.size:
        when = ", ".join(f"{(b.ways[k].start_time - b.origin) / 86400.0:.2f}" for k in lost[:5])
        b.notes.append(
            f"The measured speed of {lost.size} half yos (day {when}) disagrees with all others and was left out: "
            "corrupt casts."
        )
    return keep
