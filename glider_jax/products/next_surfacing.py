"""The live job: forecast the next surfacing from what a pilot has, freeze the forecast, score the last one.

The command line parses and prints; everything else happens here. JAX is loaded only when members fly.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.config import Vehicle
from glider_jax.errors import ConfigError, DataError
from glider_jax.inference.evidence import Situation
from glider_jax.products.coordinates import LocalFrame, iso_time, place_text
from glider_jax.products.live_inputs import (
    DAY,
    HOUR,
    Evidence,
    Options,
    course,
    gather,
    read_floor,
    read_product,
    uncovered,
    with_charge,
)
from glider_jax.products.live_missions import believes_dives
from glider_jax.readers.dead_reckoning import finite
from glider_jax.records import Recording, Track

MILE = 1852.0
SPREAD = {"p05": 0.05, "p25": 0.25, "median": 0.5, "p75": 0.75, "p95": 0.95}


def run_next(options: Options, out: Path | None) -> dict[str, Any]:
    """Forecast the next surfacing and what follows; write and freeze it under ``out`` unless that is None.

    Returns
    -------
    The summary of every forecast (``products.summary``) with ``next``, ``inputs``, ``outlook``, ``warnings``,
    ``scored`` and ``files`` besides.
    """
    if options.members < 50:
        raise ConfigError(
            f"--members: expected at least 50, found {options.members}. A region needs members."
        )
    if not 1.0 <= options.hours <= 24.0 * 60:
        raise ConfigError(f"--hours: expected 1 to 1440, found {options.hours:g}.")
    evidence = gather(options)
    from glider_jax.inference.live import assemble, fly
    from glider_jax.products import frozen
    from glider_jax.products.summary import summarise
    from glider_jax.readers.vehicles import read_vehicle

    vehicle = read_vehicle(options.vehicle)
    situation = with_charge(evidence.situation, options)
    grid = read_product(options, situation)
    floor = read_floor(options, situation)
    ruled = evidence.mission is not None and not believes_dives(evidence.warnings)
    horizon = options.hours * HOUR
    flown = fly(
        assemble(
            situation, vehicle, n=options.members, seed=options.seed, horizon=horizon,
            interval=min(900.0, horizon / 96.0) if horizon <= 4 * DAY else horizon / 384.0, mission=evidence.mission,
            product=None if grid is None else course(grid, situation, situation.behaviour.dive_to),
            bathymetry=floor, ruled=ruled,
        )
    )  # fmt: skip
    settings = flown.track.settings | {"n": options.members}
    if options.reserve is not None:
        settings["reserve_fraction"] = options.reserve
    flown = replace(flown, track=replace(flown.track, settings=settings))
    battery = _outlook(evidence.recording, flown, vehicle, options)
    flown = replace(flown, track=charged(flown.track, battery))
    result = summarise(flown.track, reserve=options.reserve)
    warnings = list(evidence.warnings)
    if grid is not None:
        warnings += uncovered(grid, situation, horizon)
    result["next"] = next_entry(flown, evidence.now, warnings)
    result["outlook"] = battery
    result["inputs"] = _inputs(situation, vehicle, evidence, options)
    result["warnings"] = warnings
    result["scored"] = None
    result["files"] = {}
    if out is not None:
        past, _ = frozen.load(out) if out.is_dir() else ([], [])
        done = [row for row in frozen.score_all(past, situation.segments) if not row["waiting"]]
        result["scored"] = done[-1] if done else None
        path = frozen.freeze(flown, out, seed=options.seed, settings={"hours": options.hours, "ruled": ruled})
        result["files"]["frozen"] = str(path)
        result["files"] |= {
            kind: str(p) for kind, p in _write(flown.track, result, out, options.outputs, floor, grid).items()
        }
    return result


def next_entry(flown, now: float, warnings: list[str]) -> dict[str, Any]:
    """Time, place, regions and reasons of the next first fix, given that it has not come by ``now``."""
    from glider_jax.products.regions import regions_of_metres
    from glider_jax.products.shapes import region_entry

    known, track = flown.scenario.situation, flown.track
    up = np.isfinite(flown.fix_time) & np.isfinite(flown.fix_latitude)
    share = float(up.mean())
    if up.sum() < 10:
        raise DataError(
            f"{known.name}: expected members that surface within the forecast, found {int(up.sum())} of {up.size}. "
            "Ask for more --hours."
        )
    later = up & (flown.fix_time > now)
    overdue = 1.0 - later.sum() / up.sum()
    if later.sum() >= max(30, 0.03 * up.sum()):
        up = later
    else:
        warnings.append(f"overdue: {100 * overdue:.0f} % of the members are up by {iso_time(now)}")
    times = np.quantile(flown.fix_time[up], list(SPREAD.values()))
    frame = LocalFrame(known.latitude, known.longitude)
    cloud = np.stack(frame.to_metres(flown.fix_latitude[up], flown.fix_longitude[up]), axis=1)
    middle = np.median(cloud, axis=0)
    place = tuple(float(v) for v in frame.to_degrees(*middle))
    codes = track.surfacing_reason[up, 0].astype(int)
    estimate = flown.scenario.estimate
    first = min(int(np.searchsorted(estimate.time, times[2])) + 1, estimate.time.size)
    current = estimate.mean[:, :first].mean(axis=1)
    return {
        "fix": {"time": iso_time(known.time), **_place(known.latitude, known.longitude)},
        "dives": iso_time(known.time + known.departure),
        "time": {k: iso_time(float(t)) for k, t in zip(SPREAD, times, strict=True)},
        "hours_from_now": {k: round((float(t) - now) / HOUR, 3) for k, t in zip(SPREAD, times, strict=True)},
        "place": _place(*place),
        "distance_km": round(float(np.hypot(*middle)) / 1e3, 3),
        "distance_nm": round(float(np.hypot(*middle)) / MILE, 3),
        "bearing_true_deg": round(math.degrees(math.atan2(middle[0], middle[1])) % 360.0, 1),
        "regions": [region_entry(r) for r in regions_of_metres(cloud, frame, (0.5, 0.9))],
        "probability_within_forecast": round(share, 4),
        "probability_up_by_now": round(float(overdue), 4),
        "reasons": [
            {"reason": _reason(flown, k), "probability": round(float((codes == k).mean()), 4)}
            for k in sorted(set(codes[codes >= 0].tolist()), key=lambda k: -(codes == k).sum())
        ],
        "current": {
            "east": round(float(current[0]), 4),
            "north": round(float(current[1]), 4),
            "sd": round(float(estimate.sd[:first].mean()), 4),
            "observations": estimate.observations,
            "product_weight": round(estimate.product_weight, 3),
            "parts_sd": {k: round(v, 4) for k, v in estimate.strengths.items()},
        },
        "speed_through_water": round(math.exp(known.behaviour.speed.centre), 4),
    }


def _reason(flown, code: int) -> str:
    """A reason as the mission names it; without a mission, that it comes up as it did before."""
    name = flown.track.reasons[code]
    if flown.scenario.ruled or name == "waypoint":
        return name
    heard = [s.reason.strip() for s in flown.scenario.situation.surfacings if s.reason.strip()]
    return f"as before ({heard[-1]})" if heard else "as before"


def _place(latitude: float, longitude: float) -> dict[str, Any]:
    return {
        "latitude": round(latitude, 6), "longitude": round(longitude, 6), "text": place_text(latitude, longitude)
    }  # fmt: skip


def _outlook(recording: Recording | None, flown, vehicle: Vehicle, options: Options) -> dict[str, Any]:
    from glider_jax.products.outlook import outlook

    track, known = flown.track, flown.scenario.situation
    span = max(float(track.time[-1] - track.time[0]), 1.0)
    drawn = np.asarray(track.charge_used[:, -1], float)
    energy = np.asarray(track.energy[:, -1], float)
    share = energy / np.maximum(energy.sum(axis=1), 1e-9)[:, None]
    mean = (share * drawn[:, None]).mean(axis=0) / span
    counter = finite(recording, "charge_used") if recording is not None else (np.empty(0), np.empty(0))
    heard = [s for s in known.surfacings if s.charge_used is not None]
    time = np.concatenate([counter[0], [s.charge_used.time for s in heard]])
    charge = np.concatenate([counter[1], [s.charge_used.value for s in heard]])
    order = np.argsort(time, kind="stable")
    mine = time[order] <= known.time + HOUR
    return outlook(
        now=known.time, battery=vehicle.battery, simulated=drawn / span,
        components=dict(zip(track.components, mean.tolist(), strict=True)),
        counter=(time[order][mine], charge[order][mine]), charge_used=known.charge_used, capacity=known.capacity,
        relative_charge=known.relative_charge, reserve=options.reserve, way_home=options.way_home, seed=options.seed,
    )  # fmt: skip


def charged(track: Track, battery: dict[str, Any]) -> Track:
    """The track with the pack as it is: draws scaled to the counter, the share left as the glider has it.

    Where the share left is not known the pack counts as full, and the track's notes say so.
    """
    factor = battery["ah_per_day"]["scaled_by"] or 1.0
    used = np.asarray(track.charge_used) * factor
    track = replace(track, charge_used=used, energy=np.asarray(track.energy) * factor)
    left = battery["charge_left_percent"]
    if left is None or not battery["capacity_ah"]:
        return replace(
            track, notes=(*track.notes, "charge left not known: the forecast begins with a full pack")
        )
    share = left / 100.0 - used / (3600.0 * battery["capacity_ah"])
    return replace(track, state_of_charge=np.clip(share, 0.0, 1.0))


def _inputs(situation: Situation, vehicle: Vehicle, evidence: Evidence, options: Options) -> dict[str, Any]:
    recording = evidence.recording
    assumed = list(situation.assumed)
    if options.vehicle is None:
        assumed.append(f"vehicle not given: energies of '{vehicle.name}' assumed")
    assumed += [f"vehicle: {text}" for text in vehicle.assumed]
    return {
        "glider": situation.name,
        "now": iso_time(evidence.now),
        "ages_h": {k: None if math.isnan(v) else round(v / HOUR, 3) for k, v in situation.ages.items()}
        | {"fix_to_now": round((evidence.now - situation.time) / HOUR, 3)},
        "segments": len(situation.segments),
        "surfacings_heard": len(situation.surfacings),
        "files": {str(name).replace("\\", "/").rsplit("/", 1)[-1]: v for name, v in situation.files.items()},
        "mission": None if evidence.mission is None else evidence.mission.name,
        "missing": [] if recording is None else list(recording.missing),
        "repairs": []
        if recording is None
        else [f"{r.count} x {r.kind}: {r.detail}" for r in recording.repairs],
        "assumed": assumed,
    }


def _write(
    track, result: dict[str, Any], out: Path, outputs: frozenset[str], floor=None, currents=None
) -> dict[str, Path]:
    """Products of the forecast beside the summary; it is always written. ``floor``, ``currents``: drawn."""
    from glider_jax.products.atomic import write_text

    files = {"json": write_text(out / "next.json", json.dumps(result, allow_nan=False, indent=1) + "\n")}
    if "nc" in outputs:
        from glider_jax.products.netcdf import NetcdfWriter

        writer = NetcdfWriter(out / "next.nc", members=track.n)
        writer.append(track)
        files["nc"] = writer.close(complete=True)
    if "geojson" in outputs:
        from glider_jax.products.geojson import write_geojson

        files["geojson"] = write_geojson(track, result, out / "next.geojson")
    if "kmz" in outputs:
        from glider_jax.products.kml import write_kml

        files["kmz"] = write_kml(track, result, out / "next.kmz")
    if "html" in outputs:
        from glider_jax.products.html.forecast import Fields, write_report

        files["html"] = write_report(track, result, out / "next.html", fields=Fields(floor, currents))
    return files
