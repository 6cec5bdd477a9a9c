"""Several missions at once give what each gives alone."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from glider_jax.errors import ConfigError
from glider_jax.products.fleet import run_fleet
from glider_jax.products.job import Options, run_ensemble

MISSION = """
[mission]
name = "{name}"
start = 2009-09-05T12:00:00Z
start_position = [{lat}, -73.2]
waypoints = [[{lat}, -73.6], [{lat}, -73.2]]

[yo]
dive_to = {depth}
climb_to = 3.0
pitch = 26.0

[[surface]]
kind = "every"
seconds = 10800.0
"""


@pytest.fixture
def missions(tmp_path):
    paths = []
    for name, lat, depth in (("inshore", 39.1, 40.0), ("offshore", 39.2, 60.0)):
        paths.append(tmp_path / f"{name}.toml")
        paths[-1].write_text(MISSION.format(name=name, lat=lat, depth=depth))
    return paths


OPTIONS = Options(
    n=8, days=0.5, currents=("uniform:east=0.1,north=0.05",), bathymetry="sloping:depth=55,slope=0",
    outputs=frozenset({"nc", "json"}),
)  # fmt: skip


def test_a_fleet_is_its_missions(missions, tmp_path):
    found = run_fleet(OPTIONS, missions, tmp_path / "fleet")
    assert list(found) == ["inshore", "offshore"]
    told = json.loads((tmp_path / "fleet" / "fleet.json").read_text())
    for name, path in zip(found, missions, strict=True):
        assert (tmp_path / "fleet" / name / "forecast.nc").exists()
        assert told["missions"][name]["surfacings"] == found[name].summary["surfacings"]
        alone = run_ensemble(replace(OPTIONS, mission=path), None).track
        track = found[name].track
        # Another frame rounds otherwise: places agree to metres, not to the bit.
        assert track.latitude[:, 0] == pytest.approx(alone.latitude[:, 0], abs=1e-6)
        apart = 111e3 * np.hypot(track.latitude - alone.latitude, 0.77 * (track.longitude - alone.longitude))
        assert apart.max() < 20.0
        np.testing.assert_allclose(track.energy[:, -1].sum(-1), alone.energy[:, -1].sum(-1), rtol=1e-3)
    # They are different missions.
    assert abs(found["inshore"].track.latitude.mean() - found["offshore"].track.latitude.mean()) > 0.05


def test_missions_of_one_name_are_refused(missions):
    with pytest.raises(ConfigError, match="more than once"):
        run_fleet(OPTIONS, [missions[0], missions[0]], None)
