"""The flown truth: equations of motion, signs of effects, decisions of the mission."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from glider_jax.diagnosis.proof.cases import REGIONS, SIGMA, VEHICLES, plan_of
from glider_jax.diagnosis.proof.ocean import DAY, HOUR, Ocean
from glider_jax.diagnosis.proof.strength import observe, prepare, steady
from glider_jax.diagnosis.proof.truth import GRAVITY, fly

REGION = 1


class Still(Ocean):
    """An ocean of one density without motion, over a flat floor."""

    def __init__(self, hours: float = 3.0, depth: float = 300.0):
        super().__init__(REGIONS[REGION], np.random.default_rng(1), hours * HOUR, quiet=True)
        self.floor = depth

    def table(self, time, deepest=420.0):
        rho, temperature = super().table(time, deepest)
        return np.full_like(rho, 1026.6), np.full_like(temperature, 12.0)

    def flow(self, east, north, time):
        return 0.0, 0.0

    def bottom(self, east, north):
        return np.full(np.shape(east), self.floor)


def flown(effects=None, hours=3.0, vehicle=VEHICLES[REGION], **plan):
    changed = replace(plan_of(REGION), **plan)
    return fly(Still(hours), vehicle, changed, effects or {}, np.random.default_rng(2))


def settled(f, phase):
    """Seconds of a phase well after its beginning and below the surface."""
    begin = np.concatenate([[0], np.flatnonzero(np.diff(f["phase"]) != 0) + 1])
    since = (
        np.arange(f["phase"].size) - begin[np.searchsorted(begin, np.arange(f["phase"].size), "right") - 1]
    )
    return (f["phase"] == phase) & (since > 90) & (f["depth"] > 8)


@pytest.fixture(scope="module")
def base():
    return flown()


@pytest.mark.parametrize("phase", [-1, 1])
def test_flight_settles_at_the_steady_glide(base, phase):
    v, use = VEHICLES[REGION], settled(base, phase)
    push = GRAVITY * (1026.6 * (v.volume + base["ballast"][use]) - v.mass)
    rise, speed = steady(
        push,
        base["pitch"][use],
        1026.6,
        np.full(push.size, v.parasite_drag),
        v.induced_drag,
        v.lift_slope,
        v.wing_area,
    )
    assert base["rise"][use].mean() == pytest.approx(rise.mean(), rel=0.004)
    assert base["speed"][use].mean() == pytest.approx(speed.mean(), rel=0.004)


def test_the_steady_glide_balances_its_forces():
    push, pitch, rho, drag, induced, lift, area = 2.3, 0.45, 1026.0, 0.15, 10.5, 7.5, 0.1
    rise, speed = steady(np.array([push]), np.array([pitch]), rho, np.array([drag]), induced, lift, area)
    u, w = float(speed[0]), float(rise[0])
    path = np.arctan2(w, u)
    attack = path - pitch
    q = 0.5 * rho * area * (u * u + w * w)
    lifted, dragged = q * lift * attack, q * (drag + induced * attack**2)
    # On a climb the lift of a nose below the path pushes down and forward.
    assert lifted * np.sin(path) - dragged * np.cos(path) == pytest.approx(0.0, abs=1e-3)
    assert push - lifted * np.cos(path) - dragged * np.sin(path) == pytest.approx(0.0, abs=2e-3)


def test_speed_lags_after_an_inflection(base):
    begin = next(s.start for s in base.strokes[2:] if s.direction > 0)
    end = begin + 150
    rise = base["rise"][begin : end + 1]
    done = np.argmax(rise > 0.95 * rise[-1])
    assert rise[0] < 0.0 < rise[30]
    assert 30 < done < 110  # pump, pitch and added mass together


def test_added_mass_slows_the_approach(monkeypatch):
    from glider_jax.diagnosis.proof import truth

    def approach():
        f = flown(hours=1.0)
        begin = next(s.start for s in f.strokes[1:] if s.direction > 0)
        return f["rise"][begin : begin + 60].mean()

    with_mass = approach()
    monkeypatch.setattr(truth, "NORMAL", 0.0)
    monkeypatch.setattr(truth, "AXIAL", 0.0)
    assert approach() > with_mass + 0.0015


SIGNS = [
    # effect, change of |rise| on dives and on climbs, cm/s, from the sensitivities of a glider of this kind
    ({"flight.ballast_offset.mass": 0.03}, 1, -1),
    ({"flight.hull_compressibility.compressibility": 4e-10}, 1, -1),
    (
        {"flight.thermal_expansion.expansion": 5e-5},
        1,
        -1,
    ),  # the water is colder than 15 degC: the hull shrinks
    ({"flight.drag_bias.share": 0.2}, -1, -1),
    ({"flight.pitch_offset.offset": 0.02}, -1, 1),
    ({"flight.pitch_gain.gain": 0.05}, 1, 1),
    ({"flight.oil_gain.gain": 0.05}, 1, 1),
    ({"flight.drag_asymmetry.share": 0.15}, 1, -1),
    ({"flight.mean_upwelling.velocity": 0.005}, -1, 1),
]


@pytest.mark.parametrize(("effect", "dive", "climb"), SIGNS)
def test_effects_act_in_their_direction(base, effect, dive, climb):
    other = flown(effect)
    for phase, sign in ((-1, dive), (1, climb)):
        change = [-np.gradient(f["depth"])[settled(f, phase)].mean() * phase for f in (base, other)]
        assert sign * (change[1] - change[0]) > 0.0015


def test_what_is_flown_agrees_with_what_strength_expects():
    ocean, v, plan = Still(8.0), VEHICLES[REGION], plan_of(REGION)

    def world(effects):
        return prepare(ocean, v, fly(ocean, v, plan, effects, np.random.default_rng(2)), SIGMA)

    still = world({})
    for effect in (
        {"flight.ballast_offset.mass": 0.03},
        {"flight.lift_loss.loss": 0.2},
        {"flight.drag_bias.share": 0.1},
    ):
        moved = world(effect)
        told = observe(still, effect)["rise"] - observe(still, {})["rise"]
        for phase in (-1, 1):
            seen = np.diff([np.mean(w.nodes["rise"][w.nodes["phase"] == phase]) for w in (still, moved)])[0]
            assert seen == pytest.approx(told[still.nodes["phase"] == phase].mean(), abs=0.0006)


def test_heading_errors_turn_the_track(base):
    other = flown({"navigation.magnetic_declination.angle": 0.2})
    until = 2000
    course = [np.arctan2(f["east"][until], f["north"][until]) for f in (base, other)]
    assert course[1] - course[0] == pytest.approx(0.2, abs=0.01)


def test_hidden_currents_carry_glider_and_surface_drift_alike():
    still = flown(hours=1.0)
    other = flown({"navigation.mean_current.east": 0.1, "navigation.mean_current.north": -0.05}, hours=1.0)
    assert other["east"][1800] - still["east"][1800] == pytest.approx(180.0, rel=0.03)
    assert other["north"][1800] - still["north"][1800] == pytest.approx(-90.0, rel=0.03)
    windy = flown({"navigation.surface_windage.east": 0.1}, hours=1.0)
    stay = int(plan_of(REGION).surface_stay)
    assert windy["east"][stay] - still["east"][stay] == pytest.approx(0.1 * stay, rel=0.01)


def test_current_shear_acts_at_depth_only():
    f = flown({"navigation.current_shear.east": 0.1, "navigation.current_shear.scale": 5.0}, hours=1.0)
    still = flown(hours=1.0)
    start = int(plan_of(REGION).surface_stay)
    assert f["east"][start - 1] == pytest.approx(still["east"][start - 1])
    assert f["east"][start + 1800] - still["east"][start + 1800] == pytest.approx(0.1 * 1800, rel=0.15)


def test_inertial_motion_turns_with_the_hemisphere():
    effects = {"navigation.inertial_oscillation.cosine": 0.2}
    f, still = flown(effects, hours=4.0), flown(hours=4.0)
    # North of the equator the motion turns clockwise: eastward first, then southward.
    k = 4 * 3600 - 1
    assert f["north"][k] - still["north"][k] < -100.0


def test_the_mission_is_flown_as_ordered(base):
    plan = plan_of(REGION)
    f = flown(hours=8.0)
    phase = f["phase"]
    assert plan.dive_to - 1 < f["depth"].max() < plan.dive_to + 6
    up = np.flatnonzero((phase[1:] == 0) & (phase[:-1] != 0)) + 1
    down = np.flatnonzero((phase[1:] != 0) & (phase[:-1] == 0)) + 1
    assert np.all(f["depth"][phase == 0] < 0.5)
    assert np.diff(np.stack([up[: down.size - 1], down[1 : up.size + 1]]), axis=0) == pytest.approx(
        plan.surface_stay, abs=5
    )
    for begin, end in zip(down, up, strict=False):
        assert plan.surface_every <= end - begin < plan.surface_every + 2500
    turns = f["depth"][[s.start for s in f.strokes if s.direction < 0 and f["phase"][s.start - 1] > 0]]
    assert np.all(np.abs(turns - plan.climb_to) < 2.0)


def test_a_shallow_floor_turns_dives_by_the_altimeter():
    ocean = Still(2.0, depth=50.0)
    f = fly(ocean, VEHICLES[REGION], plan_of(REGION), {}, np.random.default_rng(2))
    assert 50 - plan_of(REGION).altitude - 1 < f["depth"].max() < 50 - 1


def test_the_vehicle_reckons_without_angle_of_attack():
    f = flown(hours=2.0)
    begin = int(plan_of(REGION).surface_stay) + 5
    true = np.hypot(f["east"][-1] - f["east"][begin], f["north"][-1] - f["north"][begin])
    reckoned = np.hypot(
        f["reckoned_east"][-1] - f["reckoned_east"][begin],
        f["reckoned_north"][-1] - f["reckoned_north"][begin],
    )
    assert 1.03 < reckoned / true < 1.2


def test_the_truth_shares_no_physics_with_what_explains_it():
    import ast
    from pathlib import Path

    from glider_jax.diagnosis import proof

    allowed = ("glider_jax.diagnosis.proof", "glider_jax.errors", "glider_jax.environment.seawater")
    # The runs on real recordings make nothing and call the diagnosis; their independent look is held to this below.
    runs = {"real_cases.py", "real_report.py", "real_check.py"}
    check = ast.walk(ast.parse((Path(proof.__file__).parent / "real_check.py").read_text(encoding="utf-8")))
    modules = [node.module or "" for node in check if isinstance(node, ast.ImportFrom)]
    parts = ("physics", "inference", "mission", "diagnosis.run", "diagnosis.screen")
    assert modules and not [m for m in modules if m.startswith(tuple(f"glider_jax.{part}" for part in parts))]
    for path in sorted(Path(proof.__file__).parent.glob("*.py")):
        if path.name in runs:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                assert (
                    "jax" not in name
                    or name == "glider_jax"
                    or name.startswith(allowed)
                    or (name == "glider_jax_data" and path.name == "spikes.py")
                ), f"{path.name} imports {name}"


def test_three_and_a_half_days_take_seconds():
    import time

    ocean = Ocean(REGIONS[0], np.random.default_rng(1), 0.35 * DAY)
    began = time.process_time()
    fly(ocean, VEHICLES[0], plan_of(0), {}, np.random.default_rng(1))
    assert time.process_time() - began < 2.0  # a tenth of a mission
