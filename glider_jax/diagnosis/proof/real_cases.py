"""Real recordings with an effect concealed, through the diagnosis itself, beside independent numbers.

Imports the diagnosis when called. A newcomer would get wrong: nothing is put into these recordings. What is concealed
is what the base model is not told: a correction of the pitch, drag grown since a calibration, loads that differ between
dives and climbs, a pump that works against pressure, and the currents.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.diagnosis.proof import real_check as check
from glider_jax.errors import DataError

VOLUME_2016, CORRUPT_2016 = 70.0 / 1004.0, 34
VOLUME_JULY, MASS_JULY, DRAG_JULY = 0.071556, 73.3, 0.1699
#: The glider comet as it was trimmed on 22 July 2019, before it flew in August: what a pilot had then.
JULY = f"""
[vehicle]
name = "comet, July 2019"
mass = {{ value = {MASS_JULY}, sigma = 0.045, source = "trim of 22 July 2019: 45 g to be added" }}
volume = {{ value = {VOLUME_JULY}, source = "trim of 22 July 2019" }}
wing_area = 0.1
parasite_drag = {{ value = {DRAG_JULY}, sigma = 0.004, source = "trim of 22 July 2019" }}
induced_drag = {{ value = 10.5, sigma = 1.0 }}
lift_slope = {{ value = 7.53, sigma = 0.75 }}
drag_fitted_at_pitch = {{ value = 26.0, unit = "deg", source = "vertical speed of its dives and climbs" }}
pump_volume = {{ value = 230.0, unit = "cc" }}
pump_rate = {{ value = 35.0, sigma = 3.0, unit = "cc/s" }}
hull_compressibility = {{ value = 5e-10, sigma = 1e-10 }}
thermal_expansion = {{ value = 6e-5, sigma = 2e-5, source = "aluminium hull, 5 to 7e-5" }}

[energy]
hotel = {{ value = 2.6, sigma = 0.3, source = "one load all the time" }}
pump_climb_to_dive = {{ value = 187.0, sigma = 10.0 }}
brake = {{ value = 0.0, sigma = 0.0 }}
surface = {{ value = 2.5, sigma = 1.0 }}

[energy.pump_dive_to_climb]
intercept = {{ value = 420.0, sigma = 200.0, unit = "J" }}
slope = {{ value = 0.0, sigma = 0.0, unit = "J/m" }}
reference_volume_cc = 460.0
source = "one cost at every depth; what it is at the surface nobody measured"

[battery]
pack = "lithium_primary_4s"
"""
#: Recordings whose currents are kept from the tool, with the bundled vehicle that is nearest.
CURRENTS = (
    ("ru28_2017", "slocum_g1_shallow"), ("osu684_2025", "slocum_g3"), ("comet2019", "slocum_g1_comet"),
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One line of the table: case, what is compared, what the tool says, what is known otherwise, whether it holds."""

    case: str
    what: str
    tool: str
    known: str
    holds: bool | None


@dataclass
class Proof:
    """Rows of one case, the diagnoses behind them, and what the figures draw."""

    rows: list[Row] = field(default_factory=list)
    contents: dict[str, dict[str, Any]] = field(default_factory=dict)
    drawn: dict[str, Any] = field(default_factory=dict)
    seconds: float = 0.0


def effect(content: dict[str, Any], id: str) -> dict[str, Any] | None:
    """A named effect of a diagnosis, or None."""
    return next((one for one in content["effects"] if one["id"] == id), None)


def value(entry: dict[str, Any], name: str | None = None) -> tuple[float, float, float]:
    """A parameter of an effect: value and 90 % interval, SI."""
    one = next(p for p in entry["parameters"] if name in (None, p["name"]))
    return one["value"], *one["interval_90"]


def calibrated(content: dict[str, Any], name: str) -> tuple[float, float]:
    """A calibration of the vehicle: fitted value and sd."""
    one = next(c for c in content["calibration"] if c["name"] == name)
    return one["fitted"], one["sd"]


def named(content: dict[str, Any]) -> str:
    """The ids that a diagnosis names, in order."""
    return ", ".join(one["id"] for one in content["effects"]) or "nothing"


def evidence_of(content: dict[str, Any], id: str) -> float:
    """Evidence in nats for an effect, named or not."""
    one = effect(content, id) or next((n for n in content["not_found"] if n["id"] == id), None)
    return float("nan") if one is None or one["evidence"] is None else float(one["evidence"])


def comet2016(out: Path, tell: Callable[[str], None]) -> Proof:
    """The pitch scale that its author had to correct: unseen by vertical speed, named with the profiler's speed."""
    import glider_jax_data
    from glider_jax.diagnosis.run import diagnose
    from glider_jax.readers.recordings import read_recording
    from glider_jax.readers.vehicles import read_vehicle

    recording = read_recording(glider_jax_data.path("gliderflight/comet2016.nc"))
    vehicle = read_vehicle(glider_jax_data.path("gliderflight/comet2016.toml"))
    tell("comet 2016, vertical speed alone")
    alone = diagnose(recording=recording, vehicle=vehicle, streams=["vertical_speed"], out=out / "comet2016-alone")
    tell("comet 2016, with the measured speed")
    both = diagnose(recording=recording, vehicle=vehicle, out=out / "comet2016")
    known = check.pitch_scale(recording, VOLUME_2016, CORRUPT_2016)
    proof = Proof(contents={"alone": alone, "both": both})
    case, gain = "comet 2016", effect(both, "flight.pitch_gain")
    first = named(alone)
    proof.rows.append(Row(case, "named by vertical speed alone", first, "nothing can be told", first == "nothing"))
    drag, sd = calibrated(alone, "flight.parasite_drag")
    proof.rows.append(
        Row(case, "drag coefficient by vertical speed alone", f"{drag:.3f} +- {sd:.3f}",
            f"{known['drag by vertical speed alone'].value:.3f}, wrong by the hidden scale", drag > 0.19)
    )  # fmt: skip
    least = next(
        (n["minimum_detectable"][0]["minimum"] for n in alone["not_found"] if n["id"] == "flight.pitch_gain"), None
    )
    proof.rows.append(
        Row(case, "smallest pitch scale that vertical speed alone would show",
            "none" if least is None else f"{100 * least:.0f} %", "13 % is there", least is None or least > 0.13)
    )  # fmt: skip
    proof.rows.append(
        Row(case, "named first with the measured speed", named(both), "flight.pitch_gain",
            bool(both["effects"]) and both["effects"][0]["id"] == "flight.pitch_gain")
    )  # fmt: skip
    if gain is not None:
        middle, low, high = value(gain)
        proof.rows.append(
            Row(case, "pitch scale", f"{middle:.3f} (90 % {low:.3f} to {high:.3f})", str(known["gain"]),
                low < known["gain"].value < high)
        )  # fmt: skip
    drag, sd = calibrated(both, "flight.parasite_drag")
    proof.rows.append(
        Row(case, "drag coefficient with it", f"{drag:.3f} +- {sd:.3f}", str(known["drag"]), abs(drag - 0.155) < 0.02)
    )  # fmt: skip
    for stream, other in (("vertical speed", "rise"), ("speed through water", "speed")):
        held = both["held_out"]["streams"][stream]
        before, after = held["before"]["rms"], held["after"]["rms"]
        proof.rows.append(
            Row(case, f"held-out rms of {stream}, before and after", f"{before:.2f}, {after:.2f} cm/s",
                f"{known[f'{other} rms before'].value:.2f}, {known[f'{other} rms after'].value:.2f} cm/s",
                after < before)
        )  # fmt: skip
    proof.rows.append(
        Row(case, "corrupt casts of the profiler", next((n for n in both["notes"] if "corrupt" in n), "none"),
            "one half yo", any("1 half yo" in n for n in both["notes"]))
    )  # fmt: skip
    return proof


def comet2019(folder: Path, out: Path, tell: Callable[[str], None]) -> Proof:
    """Drag grown since July, loads of dives and climbs, the pump against pressure, and the fin that draws nothing."""
    from glider_jax.diagnosis.regimes import split
    from glider_jax.diagnosis.run import diagnose
    from glider_jax.readers.recordings import read_recording
    from glider_jax.readers.vehicles import read_vehicle

    recording = read_recording(_there(folder, "comet2019"))
    written = out / "comet-july-2019.toml"
    written.parent.mkdir(parents=True, exist_ok=True)
    written.write_text(JULY.lstrip(), encoding="utf-8")
    vehicle = read_vehicle(written)
    tell("comet 2019, two missions")
    content = diagnose(recording=recording, vehicle=vehicle, out=out / "comet2019")
    parts = split(recording)
    proof = Proof(contents={"comet2019": content})
    told = content.get("regimes", [])
    case = "comet 2019"
    proof.rows.append(Row(case, "missions found", str(max(len(told), 1)), "two, 9 and 21 August", len(told) == 2))
    for number, part in enumerate(parts, start=1):
        known = check.loads(part)
        levels = told[number - 1]["levels"] if len(told) == len(parts) else {}
        for way in ("dives", "climbs"):
            level = levels.get(f"hotel power, {way}")
            if level is None or way not in known:
                continue
            near = abs(level["value"] - known[way].value) < 0.15 * known[way].value
            proof.rows.append(
                Row(case, f"load on {way}, mission {number}", f"{level['value']:.2f} W", str(known[way]), near)
            )
        drag = check.drag_of(check.samples(part, 8.0, 35.0), VOLUME_JULY, MASS_JULY)
        level = levels.get("flight.parasite_drag")
        if level is not None:
            proof.rows.append(
                Row(case, f"drag coefficient, turns included, mission {number} ({DRAG_JULY:.3f} in July)",
                    f"{level['value']:.3f} +- {level['sd']:.3f}", f"{drag.value:.3f} +- {drag.error:.3f}",
                    abs(level["value"] - drag.value) < 3.0 * np.hypot(level["sd"], drag.error))
            )  # fmt: skip
        ids = told[number - 1]["effects"] if len(told) == len(parts) else []
        growing = [id for id in ids if "growth" in id]
        proof.rows.append(Row(case, f"named, mission {number}", ", ".join(ids) or "nothing", "", None))
        proof.rows.append(
            Row(case, f"growth named within mission {number}", ", ".join(growing) or "none", "none", not growing)
        )
    tell("comet 2019, the pump")
    slope, count = check.pump_slope(parts[-1])
    asked = diagnose(
        recording=parts[-1], vehicle=vehicle, streams=["pump_out_energy"], only=["energy.pump_slope"], report=False
    )
    one = effect(asked, "energy.pump_slope")
    if one is not None:
        middle, low, high = value(one)
        proof.rows.append(
            Row(case, f"pump against depth, {count} strokes of mission 2, when asked for",
                f"{middle:.1f} J/m (90 % {low:.1f} to {high:.1f}), {one['evidence']:.1f} nats", str(slope),
                low < slope.value < high)
        )  # fmt: skip
        held = asked["held_out"]["streams"].get("pump out energy")
        if held:
            proof.rows.append(
                Row(case, "held-out rms of a stroke, before and after",
                    f"{held['before']['rms']:.0f}, {held['after']['rms']:.0f} J", "",
                    held["after"]["rms"] < held["before"]["rms"])
            )  # fmt: skip
    proof.contents["pump"] = asked
    fin = check.fin_current(parts[-1])
    joined = check.fin_current(recording)
    silent = all("energy.fin_activity" not in r["effects"] for r in told)
    proof.rows.append(
        Row("fin", "fin load named", "no" if silent else "yes",
            f"paired {fin['paired']}, placebo {fin['placebo, one cycle later'].value:.1f} and "
            f"{fin['placebo, one cycle earlier'].value:.1f} mA, means of both days {joined['means'].value:.0f} mA",
            silent)
    )  # fmt: skip
    weight = evidence_of(content, "energy.fin_activity")
    proof.rows.append(Row("fin", "evidence for a fin load, mission 2", f"{weight:.1f} nats", "below 4.3", weight < 4.3))
    proof.drawn["levels"] = [r["levels"] for r in told]
    return proof


def currents(folder: Path, out: Path, tell: Callable[[str], None]) -> Proof:
    """Currents that the tool was not told of: found from fixes, and later segments met better."""
    from glider_jax.diagnosis.run import diagnose
    from glider_jax.readers.recordings import read_recording
    from glider_jax.readers.vehicles import read_vehicle

    proof = Proof()
    for name, vehicle in CURRENTS:
        recording = read_recording(_there(folder, name))
        tell(f"{name}, currents kept from the tool")
        content = diagnose(
            recording=recording, vehicle=read_vehicle(vehicle), out=out / f"flow-{name}", whole=name == "comet2019",
            streams=_navigation(recording),
        )  # fmt: skip
        proof.contents[name] = content
        flow, one = content.get("flow"), effect(content, "navigation.mean_current")
        proof.rows.append(Row(name, "flow named", "yes" if one else "no", "currents were hidden", one is not None))
        if flow is None:
            continue
        proof.rows.append(
            Row(name, "flow found, rms over segments", f"{100 * flow['rms']:.0f} cm/s, {flow['evidence']:.0f} nats",
                _own(recording), None)
        )  # fmt: skip
        for row in flow["later"]:
            proof.rows.append(
                Row(name, f"{row['predicted']} later segments from the first {row['fitted']}: median miss without and "
                    "with the flow", f"{row['before_m']:.0f}, {row['after_m']:.0f} m",
                    f"persistence {row['persistence_m']:.0f} m", row["after_m"] < row["before_m"])
            )  # fmt: skip
        proof.drawn[name] = flow
    return proof


def _navigation(recording: Any) -> list[str] | None:
    """Names of the navigation streams that a recording has."""
    from glider_jax.readers.dives import surfacings

    drifts = any(stay.time.size >= 4 and stay.time[-1] - stay.time[0] >= 150.0 for stay in surfacings(recording))
    names = ["displacement_east", "displacement_north"]
    return names + (["surface_drift_east", "surface_drift_north"] if drifts else [])


def _own(recording: Any) -> str:
    """What the glider itself made of the currents, rms over its segments."""
    from glider_jax.readers.segments import dive_segments

    known = [(s.glider_current_east, s.glider_current_north) for s in dive_segments(recording)]
    size = [np.hypot(*pair) for pair in known if np.isfinite(pair).all()]
    return f"the glider's own: {100 * np.sqrt(np.mean(np.square(size))):.0f} cm/s" if size else ""


def _there(folder: Path, name: str) -> Path:
    path = folder / name / f"{name}.nc"
    if not path.exists():
        raise DataError(f"{path}: expected a recording, found no such file. Give the folder with the recordings.")
    return path
