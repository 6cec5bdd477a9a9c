"""The three speed models of a forecast: which forward speeds a member draws for its dive segments.

``shoebox`` flies one speed, as the manufacturer's simulator; ``distribution`` draws a speed for every dive segment
from what gliders were seen to do at that pitch; ``flight`` has no nodes, its speed follows from the forces.
Speeds over the ground contain the currents of the years they come from. Speeds through the water are drawn unless the
user asks otherwise, so that currents are not counted twice; where no currents are given, their unknown velocity is
then part of the forecast's uncertainty (``CURRENT_SPREAD``).
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from glider_jax.config import Mission, Vehicle
from glider_jax.errors import ConfigError, did_you_mean
from glider_jax.mission.speeds_fit import SpeedDistribution, read_speeds
from glider_jax_data import path as bundled_path

MODELS = ("shoebox", "distribution", "flight")
KINDS = ("auto", "over_ground", "through_water")
SHOEBOX_SPEED = 0.34
#: m s-1 per component: the currents' share of the spread of published speeds over ground on a shelf; see the notes of
#: the bundled distribution.
CURRENT_SPREAD = 0.129
_FAR_PITCH = math.radians(3.0)


def choose_speeds(
    mission: Mission, vehicle: Vehicle, model: str, *, kind: str = "auto", has_currents: bool, file: Path | None = None
) -> tuple[tuple[np.ndarray, np.ndarray] | None, list[str]]:
    """Nodes (m s-1) and cumulative probabilities of the forward speed, and what was assumed.

    Parameters
    ----------
    model : one of ``MODELS``.  kind : one of ``KINDS``; ``auto`` takes speeds through the water.
    file : a speed file to use instead of the vehicle's.

    Raises
    ------
    ConfigError : an unknown model or kind, or no distribution of that kind.
    """
    if model not in MODELS:
        known = ", ".join(MODELS)
        raise ConfigError(f"--speed: expected one of {known}, found '{model}'.{did_you_mean(model, MODELS)}")
    if kind not in KINDS:
        known = ", ".join(KINDS)
        raise ConfigError(f"--speed-kind: expected one of {known}, found '{kind}'.{did_you_mean(kind, KINDS)}")
    pitch = 0.5 * (mission.yo.dive_pitch + mission.yo.climb_pitch)
    if model == "flight":
        return None, []
    if model == "shoebox":
        speed = float(vehicle.speeds.get("shoebox", SHOEBOX_SPEED))
        return (np.array([speed, speed]), np.array([0.0, 1.0])), [f"one speed of {speed:g} m/s for all dives"]
    wanted = "through_water" if kind == "auto" else kind
    chosen, where = _nearest(_distributions(vehicle, file), pitch, wanted, file or vehicle.speeds.get("distribution"))
    notes = [
        f"speeds drawn from {chosen.segments} segments at {math.degrees(chosen.pitch):.0f} degrees, "
        f"{wanted.replace('_', ' ')} ({where})"
    ]
    if chosen.assumption:
        notes.append(f"speeds: {chosen.assumption}")
    if abs(chosen.pitch - pitch) > _FAR_PITCH:
        notes.append(
            f"no speeds known near {math.degrees(pitch):.0f} degrees: those of "
            f"{math.degrees(chosen.pitch):.0f} degrees used"
        )
    if wanted == "over_ground" and has_currents:
        notes.append("speeds over the ground flown in currents: the currents' spread is counted twice")
    return (np.asarray(chosen.speeds, float), np.asarray(chosen.probabilities, float)), notes


def _distributions(vehicle: Vehicle, file: Path | None) -> tuple[SpeedDistribution, ...]:
    if file is not None:
        return read_speeds(file)
    given = vehicle.speeds.get("file")
    if given:
        return read_speeds(given)
    return read_speeds(bundled_path(f"speeds/{vehicle.speeds.get('distribution', 'paper2010')}.json"))


def _nearest(known, pitch, kind, where):
    fitting = [d for d in known if d.kind == kind]
    if not fitting:
        have = ", ".join(sorted({d.kind for d in known}))
        raise ConfigError(f"{where}: expected a distribution of kind '{kind}', found only {have}. Give --speed-kind.")
    return min(fitting, key=lambda d: abs(d.pitch - pitch)), where or "bundled"


def current_error(vehicle: Vehicle, model: str, kind: str, has_currents: bool) -> tuple[float, str]:
    """1-sigma error per component (m s-1) of currents that state none of their own, and why."""
    stated = vehicle.value("perturbation.current_error")
    if has_currents:
        return stated, ""
    if model == "distribution" and kind == "over_ground":
        return 0.0, "no currents given: their effect is in the spread of the speeds over ground"
    return max(stated, CURRENT_SPREAD), (
        f"no currents given: an unknown current of {max(stated, CURRENT_SPREAD):g} m/s (1 sigma per component) assumed"
    )
