"""Drift in the same current as other tools: python -m tests.benchmarks.bench_peers --peers FOLDER [--quick].

The drift-only part of a mission is all that these tools have, so the forecaster flies its whole step (yos, seafloor,
energy, records) with a forward speed of a hundredth of a millimetre per second. The water is a gyre with a rotating
tide on an hourly grid. Each tool runs under its own Python, in a folder of ``--peers`` named as in ``PEERS``; how to
make them stands in peers/README.md. Nothing is written to disk by anyone; compiling is left out.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.benchmarks.measuring import command_line, least, least_and_median, middle, part, repeated, table

#: Folder of the virtual environment, adapter, and what it is.
PEERS = {
    "parcels3": ("drift_parcels3.py", "Parcels 3"),
    "parcels4": ("drift_parcels4.py", "Parcels 4"),
    "opendrift": ("drift_opendrift.py", "OpenDrift"),
}
CENTRE = (39.0, -72.0)
CELLS, SPACING = 60, 6000.0
#: m s-1: forward speed through the water, which over fifteen days is thirteen metres.
STILL = 1e-5
#: s: the longest a peer may take.
LIMIT = 3600.0


def ocean(days: float):
    """Axes and velocities (time, lat, lon) of a gyre of 0.25 m/s, 60 km wide, with a rotating tide of 0.2 m/s."""
    from tests.benchmarks.peers.drifting import metres_per_degree

    side = SPACING * (np.arange(CELLS) - 0.5 * (CELLS - 1))
    east, north = metres_per_degree(CENTRE[0])
    time = 3600.0 * np.arange(int(np.ceil(days * 24.0)) + 3)
    y, x = np.meshgrid(side, side, indexing="ij")
    turn = 0.25 / 60e3 * np.exp(0.5 - 0.5 * (x**2 + y**2) / 60e3**2)
    phase = 2.0 * np.pi * time[:, None, None] / 44712.0
    u, v = 0.20 * np.cos(phase) - turn * y, 0.20 * np.sin(phase) + turn * x
    return time, CENTRE[0] + side / north, CENTRE[1] + side / east, u, v


def write_field(path: Path, time, latitude, longitude, u, v) -> None:
    """The field as a plain netCDF file with CF names."""
    import xarray

    axes = {"time": time, "lat": latitude, "lon": longitude}
    names = {"u": ("x_sea_water_velocity", u), "v": ("y_sea_water_velocity", v)}
    data = xarray.Dataset(
        {k: (tuple(axes), w.astype(np.float32), {"standard_name": s, "units": "m s-1"}) for k, (s, w) in names.items()},
        coords=axes,
    )
    data["time"].attrs = {"standard_name": "time", "units": "seconds since 2000-01-01 00:00:00"}
    data["lat"].attrs = {"standard_name": "latitude", "units": "degrees_north"}
    data["lon"].attrs = {"standard_name": "longitude", "units": "degrees_east"}
    data.to_netcdf(path)


def own_drift(n: int, days: float, repeat: int, field):
    """Starts and ends (2, n) in degrees by the forecaster, and its seconds."""
    import jax

    from glider_jax.mission.ensemble import run_members
    from glider_jax.mission.forecast import bring_home, draw_run, prepare
    from glider_jax.mission.randoms import START_STREAM, normals, words
    from glider_jax.products.job import Options, read_inputs
    from glider_jax.records import CurrentGrid

    time, latitude, longitude, u, v = field
    inputs = read_inputs(Options(n=n))
    grid = CurrentGrid(
        time, np.zeros(1), latitude, longitude,
        u[:, None].astype(np.float32).astype(float), v[:, None].astype(np.float32).astype(float), None,
    )  # fmt: skip
    # 0.3 m/s vertical at a hundredth of a millimetre per second forward: a pitch just below the vertical.
    pitch = float(np.arctan(0.3 / STILL))
    mission = replace(
        inputs.mission, start=0.0, start_position=CENTRE, waypoints=((38.0, -72.0), (38.0, -73.0)),
        current_correction=False, yo=replace(inputs.mission.yo, dive_pitch=pitch, climb_pitch=pitch),
    )  # fmt: skip
    quantities = dict(inputs.vehicle.quantities)
    sd = 15e3
    for name, value in (("current_error", 0.0), ("initial_position", sd), ("speed", 0.0)):
        key = f"perturbation.{name}"
        quantities[key] = replace(quantities[key], value=value)
    vehicle = replace(inputs.vehicle, quantities=quantities)
    nodes = np.array([STILL, STILL]), np.array([0.0, 1.0])
    run = prepare(mission, vehicle, currents=grid, speeds=nodes, duration=days * 86400.0, current_error=0.0)

    def fly():
        members, available = draw_run(run, 0, n)
        flown = run_members(
            members, run.plan, run.shape, run.environment, run.column, *run.origin, spread=run.spread, fix_sd=sd
        )
        jax.block_until_ready(flown)
        return members, available, flown

    members, available, flown = fly()
    spent = repeated(fly, repeat)
    track = bring_home(run, members, available, *flown)
    if not track.active[:, -1].all():
        raise RuntimeError("some members of the drift ended before the others")
    off = np.stack(normals(*words(tuple(map(np.asarray, members.key)), np.int32(0), START_STREAM), np.float32))
    stretch = np.stack([np.asarray(s, float) for s in run.frame.stretch(0.0)])
    starts = run.frame.to_degrees(*(sd * off.astype(float) * stretch[:, None]))
    steps = float(np.mean(np.asarray(flown[0].steps)))
    return np.stack(starts[::-1]), np.stack([track.longitude[:, -1], track.latitude[:, -1]]), spent, steps


def peer_drift(python: Path, script: str, field: Path, starts: Path, days: float, repeat: int) -> dict:
    """What an adapter measured, or the reason why there is nothing."""
    command = [str(python), str(Path(__file__).parent / "peers" / script), str(field), str(starts)]
    try:
        made = subprocess.run(
            [*command, "--days", f"{days:g}", "--repeat", str(repeat)],
            capture_output=True, text=True, timeout=LIMIT, cwd=field.parent,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return {"skipped": f"took longer than {LIMIT:g} s"}
    if made.returncode:
        return {"skipped": (made.stderr.strip().splitlines() or ["no message"])[-1][:300]}
    return json.loads(made.stdout.strip().splitlines()[-1])


def distance_km(one, two) -> np.ndarray:
    """Distances between points (2, n) of longitude and latitude that lie near each other."""
    from tests.benchmarks.peers.drifting import metres_per_degree

    east, north = metres_per_degree(0.5 * (one[1] + two[1]))
    return np.hypot((one[0] - two[0]) * east, (one[1] - two[1]) * north) / 1000.0


def measure(n: int, days: float, repeat: int, peer_repeat: int, peers: Path | None) -> dict:
    """Drift ``n`` particles by the forecaster and by every peer that is here."""
    from glider_jax_cli.session import compiled_cache

    compiled_cache()
    field = ocean(days)
    starts, ends, spent, steps = own_drift(n, days, repeat, field)
    found: dict = {"n": n, "days": days, "steps_per_member": steps, "glider_jax": spent, "peers": {}}
    moved = distance_km(starts, ends)
    found["displacement_km"] = {"median": float(np.median(moved)), "max": float(moved.max())}
    with tempfile.TemporaryDirectory() as folder:
        water, places = Path(folder) / "field.nc", Path(folder) / "starts.npy"
        write_field(water, *field)
        np.save(places, starts)
        for name, (script, label) in PEERS.items():
            python = None if peers is None else peers / name / "bin" / "python"
            if python is None or not python.exists():
                found["peers"][name] = {"skipped": f"no {label} under --peers; see peers/README.md"}
                continue
            result = peer_drift(python, script, water, places, days, peer_repeat)
            if "longitude" in result:
                theirs = np.array([result.pop("longitude"), result.pop("latitude")])
                apart = distance_km(ends, theirs)
                result["apart_km"] = {"median": float(np.median(apart)), "max": float(np.max(apart))}
                result["cpu_ratio"] = least(result["cpu_s"]) / least(spent["cpu_s"])
                result["cpu_ratio_median"] = middle(result["cpu_s"]) / middle(spent["cpu_s"])
            found["peers"][name] = result
    return found


def tables(found: dict) -> list[dict]:
    """The comparison as one table."""
    method = f"midpoint, {found['days'] * 86400.0 / found['steps_per_member']:.0f} s, whole mission step"
    own = found["glider_jax"]
    rows = [["glider_jax", method, *least_and_median(own["cpu_s"]), *least_and_median(own["wall_s"]), "1", "", ""]]
    for name, result in found["peers"].items():
        if "skipped" in result:
            rows.append([PEERS[name][1], f"not run: {result['skipped']}", *[""] * 7])
            continue
        rows.append([
            result["version"], result["method"], *least_and_median(result["cpu_s"]),
            *least_and_median(result["wall_s"]), f"{result['cpu_ratio']:.1f}", f"{result['apart_km']['median']:.3f}",
            f"{result['apart_km']['max']:.3f}",
        ])  # fmt: skip
    return [
        table(
            f"Drift only, {found['n']:,} particles, {found['days']:g} days",
            ["tool", "method", "CPU s, least", "CPU s, median", "wall s, least", "wall s, median",
             "CPU against glider_jax", "end points apart, median km", "most km"],
            rows,
            f"Particles moved {found['displacement_km']['median']:.0f} km (median). glider_jax flies its whole mission "
            "step with no forward speed: yos, energy and records are part of its time. Peers keep no records. "
            "Compiling is left out of all CPU seconds.",
        )
    ]  # fmt: skip


def main() -> None:
    """Command line of the benchmark."""
    given = command_line(__doc__, peers=True, sizes=True)
    n, days, repeat, peer_repeat = (500, 2.0, 3, 1) if given.quick else (5000, 15.0, 11, 3)
    n = given.members[0] if given.members else n
    days = given.days[0] if given.days else days
    repeat, peer_repeat = (given.repeat, given.repeat) if given.repeat else (repeat, peer_repeat)
    found = measure(n, days, repeat, peer_repeat, given.peers)
    part("peers", found, tables(found), given.out)


if __name__ == "__main__":
    main()
