"""Every named number of a vehicle: unit, default, uncertainty, source and allowed range.

Standard library only. ``readers.vehicles`` takes from here what a file leaves unsaid, and lists it in
``Vehicle.assumed``. Effects that a base model does not name (compressibility, thermal expansion) default to zero:
a file that leaves them out flies without them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class QuantitySpec:
    """What is known of a quantity before any file is read.

    ``value`` and ``sigma`` apply where nothing names it. ``bare_sigma`` is the 1-sigma, as a share of the value,
    assumed for a number given without one; 0 takes it as exact. ``file_unit`` is the unit of a bare number in a file.
    """

    unit: str
    value: float
    sigma: float
    source: str
    low: float
    high: float
    text: str
    bare_sigma: float = 0.0
    file_unit: str = ""


_FLIGHT = "gliderflight defaults for a Slocum (Merckelbach et al. 2010, 2019)"
_COMET = "recordings of the glider comet, 2019: 58 pump events between 30 and 42 dbar"
_COMPASS = "Slocum compass: about 1 degree calibrated, 5 degrees not"
_RADAR = "HF radar against ADCP: 5.1 to 9.2 cm/s rms, hourly"

QUANTITIES: dict[str, QuantitySpec] = {
    "flight.mass": QuantitySpec(
        "kg", 52.0, 0.010, "nominal Slocum 200 m electric; sigma judgement", 20.0, 200.0,
        "mass of the glider", 6e-5,
    ),
    "flight.volume": QuantitySpec(
        "m3", 0.0507565, 0.0, "neutral at 1024.5 kg m-3 with the default mass; its spread is carried by the mass",
        0.02, 0.2, "hull volume at the surface and 15 degC with the pump at zero",
    ),
    "flight.wing_area": QuantitySpec(
        "m2", 0.1, 0.0, f"{_FLIGHT}: reference area of every coefficient", 0.01, 1.0, "reference area S",
    ),
    "flight.parasite_drag": QuantitySpec(
        "1", 0.15, 0.03, f"{_FLIGHT}; spread between vehicles 0.07 to 0.25", 0.01, 1.0,
        "drag coefficient at zero angle of attack", 0.05,
    ),
    "flight.induced_drag": QuantitySpec(
        "rad-2", 10.5, 1.0, f"{_FLIGHT}; sigma judgement", 0.0, 100.0, "drag per squared angle of attack",
    ),
    "flight.lift_slope": QuantitySpec(
        "rad-1", 7.5, 0.75, f"{_FLIGHT}: 3.8 hull + 3.73 wings; sigma judgement", 0.5, 30.0,
        "lift per angle of attack, hull and wings",
    ),
    "flight.drag_fitted_at_pitch": QuantitySpec(
        "rad", 0.0, 0.0, "0: the drag was not fitted to vertical speed", 0.0, 1.0,
        "pitch of the steady glides whose vertical speed the parasite drag was fitted to, with this file's lift",
    ),
    "flight.pump_volume": QuantitySpec(
        "m3", 230e-6, 0.0, "Slocum shallow pump, 230 cc each way", 1e-6, 2e-3,
        "commanded volume, plus to climb and minus to dive", 0.0, "cc",
    ),
    "flight.pump_rate": QuantitySpec(
        "m3 s-1", 32e-6, 6e-6, "glidersim, shallow-100 pump: 32 cc/s; measured 34 to 45 on comet", 1e-7, 1e-3,
        "speed of the pump", 0.0, "cc/s",
    ),
    "flight.hull_compressibility": QuantitySpec(
        "Pa-1", 0.0, 0.0, "left out unless named", -1e-9, 5e-9, "share of volume lost per pascal",
    ),
    "flight.thermal_expansion": QuantitySpec(
        "K-1", 0.0, 0.0, "left out unless named", -1e-3, 1e-3, "share of volume gained per kelvin above 15 degC",
    ),
    "energy.hotel": QuantitySpec(
        "W", 2.6, 0.5, "mean of comet 2019 with CTD: 2.6 W, floor 1.4 W", 0.0, 200.0,
        "steady load, all the time", 0.05,
    ),
    "energy.pump_dive_to_climb.intercept": QuantitySpec(
        "J", 210.0, 46.0, _COMET, -1e4, 1e5, "pump energy of a turn from dive to climb at the surface", 0.10,
    ),
    "energy.pump_dive_to_climb.slope": QuantitySpec(
        "J m-1", 5.69, 1.26, f"{_COMET}: 5.65 J/dbar at 1.007 dbar per metre", 0.0, 1e3,
        "growth of that energy with depth", 0.05,
    ),
    "energy.pump_dive_to_climb.reference_volume": QuantitySpec(
        "m3", 460e-6, 0.0, "twice the commanded pump volume", 1e-6, 4e-3,
        "volume moved from dive to climb for which the line holds; energy scales with the volume moved", 0.0, "cc",
    ),
    "energy.pump_climb_to_dive": QuantitySpec(
        "J", 178.0, 20.0, "comet: 169 J in 2016 and 187 J in 2019 per 460 cc", 0.0, 1e5,
        "pump energy of a turn from climb to dive, near the surface", 0.10,
    ),
    "energy.brake": QuantitySpec(
        "J", 0.0, 0.0, "included in the pump's events of comet", 0.0, 1e4, "pump brake, at every inflection", 0.10,
    ),
    "energy.surface": QuantitySpec(
        "W", 2.5, 1.0, "comet: 0.22 to 0.24 A idle with GPS, 0.40 to 0.59 A on an Iridium call, at 14 V", 0.0, 500.0,
        "load at the surface on top of hotel", 0.10,
    ),
    "perturbation.heading": QuantitySpec(
        "rad", math.radians(3.0), 0.0, _COMPASS, 0.0, 1.0, "1-sigma of the compass error, constant per glider",
    ),
    "perturbation.current_error": QuantitySpec(
        "m s-1", 0.07, 0.0, _RADAR, 0.0, 2.0, "1-sigma per component of the error of the current product",
    ),
    "perturbation.current_error_time": QuantitySpec(
        "s", 86400.0, 0.0, "judgement: about one day, as random-flight models of shelf currents use", 60.0, 3e7,
        "e-folding time of the current error",
    ),
    "perturbation.current_error_length": QuantitySpec(
        "m", 25e3, 0.0, "judgement: a few cells of a 6-km product", 100.0, 1e7, "e-folding length of the current error",
    ),
    "perturbation.initial_position": QuantitySpec(
        "m", 10.0, 0.0, "judgement: GPS 4 m rms and the drift since the last fix", 0.0, 1e5,
        "1-sigma per component of the first position",
    ),
    "perturbation.speed": QuantitySpec(
        "1", 0.05, 0.0, "judgement", 0.0, 1.0, "1-sigma share by which speed through water differs from the model's",
    ),
    "perturbation.surface_stay": QuantitySpec(
        "1", 0.25, 0.0, "judgement: stays of 7 to 13 minutes where 10 were expected", 0.0, 2.0,
        "1-sigma share of the surface stay",
    ),
}  # fmt: skip

#: section of a vehicle file in which the quantities of a group stand
SECTIONS = {"flight": "vehicle", "energy": "energy", "perturbation": "perturbation"}
