"""From energy drawn to charge, state of charge and voltage of a pack; NumPy, after the compiled run.

All loads of a glider draw constant power, so energy is what a mission spends and charge follows from the falling
voltage: with the open-circuit voltage V(s) at state of charge s, drawing energy lowers s by dE / (Q V(s)).
"""

from __future__ import annotations

import numpy as np

from glider_jax.config import Battery, Mission
from glider_jax.errors import ConfigError, Outcome

_NODES = 513


def discharge_table(battery: Battery):
    """States of charge from full to empty, the share of the energy drawn there, and open-circuit voltages (V)."""
    points = np.array(sorted(battery.voltage_curve), float)
    if points.ndim != 2 or points.shape[0] < 2 or np.any(points[:, 1] <= 0):
        raise ConfigError(
            f"battery '{battery.name}': voltage_curve: expected two or more (state of charge, volt) points with "
            f"positive voltages, found {battery.voltage_curve}. Correct the vehicle file."
        )
    soc = np.linspace(1.0, 0.0, _NODES)
    volts = np.interp(soc, points[:, 0], points[:, 1])
    share = np.concatenate([[0.0], np.cumsum(0.5 * (volts[1:] + volts[:-1]))])
    return soc, share / share[-1], volts


def energy_limits(battery: Battery, mission: Mission, available):
    """Energy at which each member's mission ends, and why.

    Parameters
    ----------
    available : (n,) J that each member's pack holds.

    Returns
    -------
    limits : (n,) J.  codes : (n,) outcome codes: empty, or aborted at the mission's or the pack's threshold.
    """
    soc, share, volts = discharge_table(battery)
    available = np.asarray(available, float)
    limits = available.copy()
    codes = np.full(available.shape, int(Outcome.BATTERY_EMPTY))
    undervolts = mission.aborts.undervolts
    if undervolts is not None and volts[-1] < undervolts:
        reached = share[np.argmax(volts < undervolts)] if np.any(volts < undervolts) else 1.0
        limits, codes = np.minimum(limits, reached * available), np.full(available.shape, int(Outcome.BATTERY_ABORT))
    if mission.aborts.remaining_charge:
        reached = np.interp(1.0 - mission.aborts.remaining_charge, 1.0 - soc, share) * available
        codes = np.where(reached < limits, int(Outcome.BATTERY_ABORT), codes)
        limits = np.minimum(limits, reached)
    return limits, codes


def mean_voltage(battery: Battery) -> float:
    """Open-circuit voltage averaged over the charge, V; a pack's energy is its charge times this."""
    _, _, volts = discharge_table(battery)
    return float(np.mean(0.5 * (volts[1:] + volts[:-1])))


def battery_state(battery: Battery, energy, available, power):
    """Charge drawn (C), state of charge (0..1) and terminal voltage (V).

    Parameters
    ----------
    energy : (n, o) J drawn since full.  available : (n,) J.  power : (n,) W, the steady load that the voltage feels.
    """
    soc, share, volts = discharge_table(battery)
    used = np.clip(energy / available[:, None], 0.0, 1.0)
    state = np.interp(used, share, soc)
    open_circuit = np.interp(state, soc[::-1], volts[::-1])
    sag = power[:, None] / open_circuit * battery.internal_resistance.value
    charge = available / mean_voltage(battery)
    return charge[:, None] * (1.0 - state), state, open_circuit - sag
