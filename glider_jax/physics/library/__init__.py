"""Every known term that a base model may leave out.

``LIBRARY`` is the explicit list, ``TERMS_BY_ID`` the same by id, ``CONFUSION_CLASSES`` the groups of effects of which
no single member may be claimed without the datum that decides. Adding a term is one class and one line in its
module's ``TERMS``.
"""

from __future__ import annotations

from glider_jax.physics.library import attitude, energy, flow, hull, loads, mission, navigation, sensor, water
from glider_jax.physics.term import AbstractTerm

LIBRARY: tuple[type[AbstractTerm], ...] = (
    *hull.TERMS,
    *flow.TERMS,
    *attitude.TERMS,
    *water.TERMS,
    *navigation.TERMS,
    *energy.TERMS,
    *loads.TERMS,
    *sensor.TERMS,
    *mission.TERMS,
)

TERMS_BY_ID: dict[str, type[AbstractTerm]] = {kind.info.id: kind for kind in LIBRARY}

CONFUSION_CLASSES: dict[str, tuple[str, ...]] = {
    "ballast": ("flight.ballast_offset", "flight.oil_offset", "flight.salinity_bias"),
    "speed scale": ("flight.drag_bias", "flight.pitch_gain", "flight.oil_gain", "sensor.pressure_gain"),
    "vertical offset": ("flight.pitch_offset", "flight.mean_upwelling", "flight.ballast_offset"),
    "lift": ("flight.lift_loss", "navigation.speed_bias", "navigation.attack_neglected"),
    "buoyancy with depth": ("flight.hull_compressibility", "flight.bladder_air"),
    "constant heading error": ("navigation.magnetic_declination", "navigation.compass_deviation"),
    "pump with depth": ("energy.pump_slope", "energy.pump_pressure_nonlinearity"),
    "steady drain": (
        "energy.hotel_bias",
        "sensor.coulomb_gain",
        "sensor.current_gain",
        "sensor.current_offset",
        "energy.fin_activity",
    ),
    "surfacing cost": ("energy.iridium_call", "energy.air_pump", "energy.surface_load"),
    "slowing down": ("flight.drag_growth", "flight.pitch_drift"),
    "getting heavier": (
        "flight.mass_growth",
        "flight.water_ingress",
        "flight.oil_loss",
        "sensor.salinity_drift",
    ),
    "growing drain": ("energy.hotel_growth", "energy.leak_drain"),
}


def confusion_class(id: str) -> tuple[str, ...]:
    """Labels of the classes that a term belongs to; empty for a term that nothing imitates."""
    return tuple(label for label, members in CONFUSION_CLASSES.items() if id in members)
