"""The reference field against the published test values of the World Magnetic Model of the same epoch."""

from __future__ import annotations

import numpy as np
import pytest

from glider_jax.environment.geomagnetism import declination, field

YEAR_2020 = (2020.0 - 1970.0) * 365.2425 * 86400.0


@pytest.mark.parametrize(
    ("latitude", "longitude", "north", "east", "down"),
    [
        (80.0, 0.0, 6570.4, -146.3, 54606.0),
        (0.0, 120.0, 39624.3, 109.9, -10932.5),
        (-80.0, 240.0, 5940.6, 15772.1, -52480.8),
    ],
)
def test_published_values(latitude, longitude, north, east, down):
    """WMM2020 at sea level, epoch 2020.0; degrees 9 to 12 and the other model leave less than 200 nT."""
    assert field(latitude, longitude, 2020.0) == pytest.approx((east, north, down), abs=200.0)
    assert declination(latitude, longitude, YEAR_2020) == pytest.approx(
        np.arctan2(east, north), abs=np.radians(0.6)
    )


def test_it_drifts_with_the_years():
    """West of Ireland the compass turns east by a sixth of a degree per year."""
    change = declination(53.0, -12.0, YEAR_2020 + 5 * 3.15576e7) - declination(53.0, -12.0, YEAR_2020)
    assert 0.5 < np.degrees(change) < 1.5
