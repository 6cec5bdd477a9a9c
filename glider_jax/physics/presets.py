"""Named parameter sets, one function per published or measured source.

Imports the configuration records only. Each returns quantities by the dotted names of a vehicle file; ``apply`` puts
them over a vehicle's own. Spreads without a source are marked as judgement.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from math import pi, radians, sqrt, tan

from glider_jax.config import Quantity, Vehicle
from glider_jax.errors import ConfigError, did_you_mean


def merckelbach_2019() -> dict[str, Quantity]:
    """Slocum flight coefficients after calibration with a current meter."""
    source = "Merckelbach et al. 2019, doi:10.1175/JTECH-D-18-0168.1, and the defaults of gliderflight 1.2"
    return {
        "flight.wing_area": Quantity(0.1, 0.0, "m2", source),
        "flight.parasite_drag": Quantity(0.15, 0.03, "1", source + "; sd judgement"),
        "flight.induced_drag": Quantity(10.5, 2.0, "rad-2", source + "; sd judgement"),
        "flight.lift_slope": Quantity(
            3.8 + wing_lift_slope(7.0, 43.0), 0.75, "rad-1", source + "; sd judgement"
        ),
        "flight.hull_compressibility": Quantity(5e-10, 1e-10, "Pa-1", source + "; sd judgement"),
    }


def merckelbach_2010() -> dict[str, Quantity]:
    """Slocum flight coefficients of the first paper, from depth rates alone; recalled, not re-read."""
    source = "Merckelbach et al. 2010, doi:10.1175/2009JTECHO710.1, recalled"
    return {
        "flight.wing_area": Quantity(0.1, 0.0, "m2", source),
        "flight.parasite_drag": Quantity(0.10, 0.02, "1", source + "; sd judgement"),
        "flight.induced_drag": Quantity(2.88, 0.6, "rad-2", source + "; sd judgement"),
        "flight.lift_slope": Quantity(
            2.4 + wing_lift_slope(7.0, 43.0), 0.6, "rad-1", source + "; sd judgement"
        ),
        "flight.hull_compressibility": Quantity(5e-10, 1e-10, "Pa-1", source + ", 4e-10 to 6e-10"),
    }


def graver_2005() -> dict[str, Quantity]:
    """Slocum coefficients of steady glides, restated for the reference area of 0.1 m2."""
    source = "Graver 2005, C_D = 0.214 + 32.3 a**2 and C_L = 11.76 a on 0.0356 m2"
    share = 0.0356 / 0.1
    return {
        "flight.wing_area": Quantity(0.1, 0.0, "m2", source),
        "flight.parasite_drag": Quantity(0.214 * share, 0.015, "1", source + "; sd judgement"),
        "flight.induced_drag": Quantity(32.3 * share, 2.5, "rad-2", source + "; sd judgement"),
        "flight.lift_slope": Quantity(11.76 * share, 0.8, "rad-1", source + "; sd judgement"),
    }


def comet_2019() -> dict[str, Quantity]:
    """The glider comet in the German Bight, August 2019, as measured from its recordings."""
    flight = "fit to comet, 21 August 2019, half-yo bootstrap"
    pump = "comet 2019, 58 strokes of 460 cm3 between 30 and 42 dbar, per metre at 1.007 dbar"
    return {
        **merckelbach_2019(),
        "flight.parasite_drag": Quantity(0.2075, 0.0012, "1", flight),
        "flight.volume": Quantity(71.548e-3, 6e-6, "m3", flight + "; sd against the published trim"),
        "flight.pump_volume": Quantity(230e-6, 0.0, "m3", "strokes of 460 cm3"),
        "flight.pump_rate": Quantity(37e-6, 2e-6, "m3 s-1", "34 to 40 cm3/s measured on comet"),
        "energy.pump_dive_to_climb.intercept": Quantity(210.0, 46.0, "J", pump),
        "energy.pump_dive_to_climb.slope": Quantity(5.65 * 1.007, 1.25 * 1.007, "J m-1", pump),
        "energy.pump_dive_to_climb.reference_volume": Quantity(460e-6, 0.0, "m3", pump),
        "energy.pump_climb_to_dive": Quantity(
            187.0, 47.0, "J", "comet 2019, 460 cm3 drawn in near the surface"
        ),
        "energy.brake": Quantity(0.0, 0.0, "J", "included in the pump's events"),
        "energy.hotel": Quantity(2.6, 0.3, "W", "mean of comet 2019, floor 1.4 W; sd judgement"),
    }


def comet_2016() -> dict[str, Quantity]:
    """The glider comet in the Baltic, 2016, with a current meter on board, as measured from its recordings."""
    return {
        **merckelbach_2019(),
        "flight.parasite_drag": Quantity(
            0.151, 0.005, "1", "fit to comet 2016 with corrected pitch; sd judgement"
        ),
        "energy.pump_climb_to_dive": Quantity(
            169.0, 30.0, "J", "comet 2016, 460 cm3 drawn in near the surface"
        ),
        "energy.hotel": Quantity(
            4.9, 0.5, "W", "mean of comet 2016 with current meter, CTD and optics; sd judgement"
        ),
        "energy.brake": Quantity(0.0, 0.0, "J", "included in the pump's events"),
    }


PRESETS: dict[str, Callable[[], dict[str, Quantity]]] = {
    "merckelbach_2019": merckelbach_2019,
    "merckelbach_2010": merckelbach_2010,
    "graver_2005": graver_2005,
    "comet_2019": comet_2019,
    "comet_2016": comet_2016,
}


def wing_lift_slope(aspect_ratio: float, sweep_deg: float) -> float:
    """Lift coefficient per radian of swept wings of finite aspect ratio, on their own area.

    References
    ----------
    Merckelbach et al. 2010, doi:10.1175/2009JTECHO710.1, wing lift.
    """
    swept = aspect_ratio**2 * (1.0 + tan(radians(sweep_deg)) ** 2)
    return 2.0 * pi * aspect_ratio / (2.0 + sqrt(swept + 4.0))


def apply(vehicle: Vehicle, preset: str) -> Vehicle:
    """The vehicle with a preset's quantities in place of its own.

    Raises
    ------
    ConfigError : there is no preset of that name.
    """
    if preset not in PRESETS:
        raise ConfigError(
            f"preset: unknown name '{preset}'.{did_you_mean(preset, PRESETS)} Known are {', '.join(PRESETS)}."
        )
    return dataclasses.replace(vehicle, quantities={**vehicle.quantities, **PRESETS[preset]()})
