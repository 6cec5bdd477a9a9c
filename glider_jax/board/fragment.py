"""An energy model as a vehicle TOML fragment and as JSON, with covariance and provenance; standard library
and NumPy."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.board.fits import BRAKE, CLIMB, HOTEL, INTERCEPT, SLOPE, SURFACE, UNITS, EnergyModel, PumpFit
from glider_jax.errors import ConfigError

_KEYS = {CLIMB: "pump_climb_to_dive", BRAKE: "brake", HOTEL: "hotel", SURFACE: "surface"}


def _number(value: float) -> str:
    if not math.isfinite(value):
        raise ConfigError(f"energy model: expected finite numbers, found {value}. The fit has failed.")
    return repr(float(f"{value:.8g}"))


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)


def vehicle_toml(model: EnergyModel, files: dict[str, str] | None = None, name: str | None = None) -> str:
    """The fragment as text: ``[energy]`` and one ``[[covariance]]`` block over all fitted quantities.

    Parameters
    ----------
    model : from ``fits.fit_energy``.
    files : path to SHA-256 of the recordings, written as comments.
    name : of the vehicle; the ``[vehicle]`` table is left out without it.
    """
    lines = [
        f"# Energy model fitted to {model.name}. SI units; sigma is 1-sigma, random and shared errors together."
    ]
    lines += [f"# recording {path} sha256 {digest}" for path, digest in (files or {}).items()]
    lines += [f"# shared errors: {model.gains.source}"]
    lines += [f"# warning: {sentence}" for sentence in model.warnings]
    pump = model.pump
    if pump is not None:
        lines += [
            f"# dive to climb: form {pump.form}, held-out error {pump.held_out:.1f} J"
            + (f" (form {model.other.form}: {model.other.held_out:.1f} J)" if model.other else "")
            + f", scatter of single strokes {pump.scatter:.1f} J, fitted from {pump.depths[0]:.1f} to "
            + f"{pump.depths[1]:.1f} m"
        ]
    lines.append("")
    if name:
        lines += ["[vehicle]", f"name = {_text(name)}", ""]
    lines.append("[energy]")
    for key, short in _KEYS.items():
        if key in model.estimates:
            e = model.estimates[key]
            source = _text(_source(model, e.source))
            inner = f"value = {_number(e.value)}, sigma = {_number(e.sigma)}, source = {source}"
            lines.append(f"{short} = {{ {inner} }}  # {UNITS[key]}")
    if INTERCEPT in model.estimates:
        a, b = model.estimates[INTERCEPT], model.estimates[SLOPE]
        lines += ["", "[energy.pump_dive_to_climb]  # J and J per metre of depth, for reference_volume (cc)"]
        lines += [f"intercept = {_number(a.value)}", f"intercept_sigma = {_number(a.sigma)}"]
        lines += [f"slope = {_number(b.value)}", f"slope_sigma = {_number(b.sigma)}"]
        if pump is not None and pump.reference_volume > 0:
            lines.append(f"reference_volume = {_number(1e6 * pump.reference_volume)}")
        lines.append(f"source = {_text(_source(model, a.source))}")
    if model.names:
        lines += ["", "[[covariance]]"]
        lines.append("names = [" + ", ".join(_text(n) for n in model.names) + "]")
        rows = ["[" + ", ".join(_number(v) for v in row) + "]" for row in model.covariance]
        lines.append("matrix = [\n    " + ",\n    ".join(rows) + ",\n]")
        lines.append(f"source = {_text(f'fit to {model.name}; {model.gains.source}')}")
    return "\n".join(lines) + "\n"


def _source(model: EnergyModel, text: str) -> str:
    return f"fit to {model.name}: {text}"


def write_atomically(path: str | Path, text: str) -> None:
    """Write a file so that a reader sees the old or the new content, never half of one."""
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(target.name + ".part")
    with open(temporary, "w", encoding="utf-8") as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    temporary.replace(target)


def _pump_dict(pump: PumpFit | None, level: float) -> dict[str, Any] | None:
    if pump is None:
        return None
    return {
        "form": pump.form,
        "intercept_j": float(pump.theta[0]),
        "slope_j_per_m": float(pump.theta[1]),
        "covariance": pump.covariance.tolist(),
        "reference_volume_m3": pump.reference_volume,
        "held_out_error_j": pump.held_out,
        "scatter_j": pump.scatter,
        "strokes": pump.count,
        "outliers": pump.outliers,
        "depths_m": list(pump.depths),
        "reduced_chi2": pump.chi2,
        "residual_autocorrelation": pump.autocorrelation,
        "residual_trend_j_per_day": pump.trend,
        "slope_identifiable": pump.identifiable,
        "intervals": _intervals(pump, level),
    }


def _intervals(pump: PumpFit, level: float) -> list[dict[str, float]]:
    """Mean energy, its half interval and that of a single stroke, before shared errors, over the depths fitted."""
    depths = np.linspace(*pump.depths, 5)
    columns = {
        "depth_m": depths,
        "energy_j": pump.predict(depths),
        "half_interval_of_mean_j": pump.interval(depths, level),
        "half_interval_of_stroke_j": pump.interval(depths, level, single=True),
    }
    return [{name: float(values[row]) for name, values in columns.items()} for row in range(depths.size)]


def model_dict(model: EnergyModel, level: float = 0.95) -> dict[str, Any]:
    """Everything about a fit as plain data for JSON; intervals are for each quantity on its own."""
    return {
        "name": model.name,
        "quantities": {
            key: {
                "value": e.value,
                "sigma": e.sigma,
                "random_sigma": e.random,
                "shared_sigma": e.shared,
                "half_interval": e.interval(level),
                "level": level,
                "unit": UNITS[key],
                "count": e.count,
                "scatter": e.scatter,
                "source": e.source,
            }
            for key, e in model.estimates.items()
        },
        "covariance": {"names": list(model.names), "matrix": model.covariance.tolist()},
        "pump": _pump_dict(model.pump, level),
        "pump_other_form": _pump_dict(model.other, level),
        "steady": [
            {
                "phase": level.phase,
                "state": level.state,
                "mean_w": float(level.mean),
                "mean_sd_w": float(level.mean_sd),
                "median_w": level.median,
                "floor_w": level.floor,
                "seconds": level.seconds,
            }
            for level in model.levels
        ],
        "warnings": list(model.warnings),
        "brake_included_in_pump": model.brake_included,
        "shared_errors": model.gains.source,
    }
