"""Motion between steady glides: what stays, what settles, and the same from an independent integration."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from glider_jax.inference.settling import AXIAL, NORMAL, Forces, motion, steady_of

STEP, MASS, AREA, DENSITY, PARASITE, INDUCED, LIFT = 4.0, 52.0, 0.1, 1027.0, 0.15, 10.0, 7.8


def forces(buoyancy, pitch, lift=LIFT):
    """Forces of rows with some net buoyancies in N and pitches in rad."""
    full = lambda value: jnp.broadcast_to(jnp.asarray(value, float), np.shape(buoyancy))  # noqa: E731
    return Forces(
        net_buoyancy=full(buoyancy), pitch=full(pitch), density=full(DENSITY), area=full(AREA), parasite=full(PARASITE),
        induced=full(INDUCED), lift=full(lift), thrust=full(0.0), along=full((1.0 + AXIAL) * MASS),
        across=full((1.0 + NORMAL) * MASS),
    )  # fmt: skip


def steady(acting):
    """The steady glides under them."""
    return jax.vmap(steady_of)(acting)


def flown(acting, follows=None):
    """Speed and angle of attack of every row, as arrays."""
    return whole(acting, 0.0, follows)[:2]


def whole(acting, stray, follows=None):
    """Speed, angle of attack, and what a stray pitch adds to both, of every row."""
    return told(acting, stray, follows)[:4]


def told(acting, stray, follows=None):
    """The same and by how much the velocity of every row is open."""
    n = acting.pitch.size
    step, stray = jnp.full(n, STEP), jnp.broadcast_to(jnp.asarray(stray, float), (n,))
    follows = jnp.arange(n) > 0 if follows is None else follows
    return _moved(acting, step, follows, stray)


@jax.jit
def _moved(acting, step, follows, stray):
    return motion(acting, steady(acting), step, follows, stray)


@jax.jit
def slope(acting, push, stray, strayed):
    """What all five answer to a push of the forces and of the stray pitch, as one array; compiled once for all."""

    def all_of(acting, stray):
        return jnp.stack(told(acting, stray))

    return jax.jvp(all_of, (acting, stray), (push, strayed))


def pushed(acting, name):
    """Forces of which one is as large as it is, and all others nothing."""
    nothing = jax.tree.map(jnp.zeros_like, acting)
    return nothing._replace(**{name: getattr(acting, name)})


def turning(n=150, lift=LIFT):
    """A dive that turns into a climb: pitch and buoyancy run from one to the other in half a minute."""
    s = np.clip((np.arange(n) * STEP - 200.0) / 30.0, -1.0, 1.0)
    return forces(2.4 * s, 0.41 * s, lift)


@pytest.fixture(autouse=True)
def _double():
    with jax.enable_x64(True):
        yield


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_steady_glide_stays(way):
    """Started there and driven on alike, speed and angle of attack do not move."""
    acting = forces(np.full(50, 2.4 * way), 0.42 * way)
    glide = steady(acting)
    speed, attack = flown(acting)
    assert speed == pytest.approx(np.asarray(glide.speed_through_water), rel=1e-5)
    assert attack == pytest.approx(np.asarray(glide.angle_of_attack), rel=1e-4)
    assert np.sign(attack[-1]) == way


def test_speed_answers_in_the_time_that_inertia_gives():
    """A small rise of buoyancy is answered in inertia along the hull over density, area, drag coefficient and speed."""
    acting = forces(np.where(np.arange(60) < 20, 2.4, 2.45), 0.42)
    glide = steady(acting)
    speed, _ = flown(acting)
    still, angle = np.asarray(glide.speed_through_water), np.asarray(glide.angle_of_attack)
    tau = (1.0 + AXIAL) * MASS / (DENSITY * AREA * (PARASITE + INDUCED * angle[0] ** 2) * still[0])
    left = (still[-1] - speed[20:]) / (still[-1] - still[0])
    # The rise itself takes one step, so it comes half a step late; a slow glider's larger angle adds to its slowness.
    assert STEP * (left.sum() - 0.5) == pytest.approx(tau, rel=0.25)
    assert abs(left[-1]) < 0.02


@pytest.mark.parametrize(("loss", "tolerance"), [(0.0, 0.003), (0.3, 0.003), (0.43, 0.006)])
def test_an_independent_integration_flies_the_same(loss, tolerance):
    """Through a turn, in the earth's axes by an adaptive method: the same speed and angle once the pump has stopped."""
    lift = LIFT * (1.0 - loss)
    acting = turning(lift=lift)
    speed, attack = flown(acting)
    time = np.arange(acting.pitch.size) * STEP

    def derivative(t, state):
        pitch, up = np.interp(t, time, acting.pitch), np.interp(t, time, acting.net_buoyancy)
        hull = np.array([np.cos(pitch), np.sin(pitch)])
        normal = np.array([-np.sin(pitch), np.cos(pitch)])
        u, v = state @ hull, state @ normal
        pace = np.hypot(u, v) + 1e-9
        angle = np.clip(np.arctan2(v, max(u, 0.02)), -0.6, 0.6)
        k = 0.5 * DENSITY * AREA * pace
        drag = -k * (PARASITE + INDUCED * angle**2) * state
        carried = k * lift * angle * (v * hull - u * normal)
        force = np.array([0.0, up]) + drag + carried
        return (force @ hull) / (MASS * (1.0 + AXIAL)) * hull + (force @ normal) / (MASS * (1.0 + NORMAL)) * normal

    glide = steady(acting)
    path = float(glide.glide_angle[0])
    begin = float(glide.speed_through_water[0]) * np.array([np.cos(path), np.sin(path)])
    found = solve_ivp(derivative, (0.0, time[-1]), begin, t_eval=time, rtol=1e-8, atol=1e-10, max_step=1.0).y.T
    pace = np.hypot(*found.T)
    mean = np.append(pace[0], 0.5 * (pace[1:] + pace[:-1]))
    angle = np.arctan2(found[:, 1], found[:, 0]) - np.asarray(acting.pitch)
    later = time > 290.0
    assert np.abs(speed - mean)[later].max() < tolerance
    assert np.abs(attack - angle)[later].max() < 2.0 * tolerance
    assert np.abs(speed - mean).max() < 0.02


def test_weak_wings_settle_for_minutes():
    """Forty seconds after the pump stopped a glider with all its lift is steady, one that lost 43 % is not for long."""
    far = {}
    for loss in (0.0, 0.43):
        acting = turning(lift=LIFT * (1.0 - loss))
        speed, _ = flown(acting)
        far[loss] = np.abs(speed - np.asarray(steady(acting).speed_through_water))[70:]
    assert far[0.0][0] < 0.01 < 0.05 < far[0.43][0]
    assert far[0.43][-1] < 0.005


@pytest.mark.parametrize("loss", [0.0, 0.4])
@pytest.mark.parametrize("name", ["net_buoyancy", "pitch", "parasite", "lift", "along", "across"])
def test_derivatives_are_those_of_the_motion(loss, name):
    """The linear pass beside the path gives what small changes of a force do."""
    base, none = turning(lift=LIFT * (1.0 - loss)), jnp.zeros(150)
    _, found = slope(base, pushed(base, name), none, none)

    def speeds(share):
        changed = base._replace(**{name: getattr(base, name) * (1.0 + share)})
        return np.asarray(slope(changed, pushed(base, name), none, none)[0][:2])

    found, change = np.asarray(found[:2]), (speeds(1e-6) - speeds(-1e-6)) / 2e-6
    # Where speed and angle are held at their limits in the middle of the turn a change may step over one of them.
    assert found == pytest.approx(change, rel=1e-3, abs=1e-3 * np.abs(change).max())


def test_what_is_not_followed_is_steady():
    """Rows that follow nothing are steady glides, and the rows after them start there."""
    acting = turning()
    n = acting.pitch.size
    follows = (jnp.arange(n) > 0) & (jnp.arange(n) != 80)
    glide = steady(acting)
    speed, attack = flown(acting, follows)
    assert speed[80] == pytest.approx(float(glide.speed_through_water[80]), rel=1e-12)
    assert attack[81:] == pytest.approx(np.asarray(glide.angle_of_attack)[81:], rel=1e-3)


def test_turns_leave_weak_wings_open():
    """A minute after a turn the velocity of a usual glide is known; near the fold it is not until it has settled."""
    usual, weak = (np.asarray(told(turning(200, LIFT * (1.0 - loss)), 0.0)[4]) for loss in (0.0, 0.45))
    turned = slice(50, 54)
    assert usual[turned].min() > 0.01 and weak[turned].min() > 0.02
    assert usual[70:].max() < 1e-3
    assert weak[65:75].min() > 0.02
    assert weak[130:].max() < 1e-3


def test_what_is_begun_is_open_at_first():
    """Where the motion is taken up it is known as well as out of a turn, and a minute later fully."""
    acting = forces(np.full(60, 2.4), 0.42)
    follows = (jnp.arange(60) > 0) & (jnp.arange(60) != 30)
    open_ = np.asarray(told(acting, 0.0, follows)[4])
    assert open_[31] > 0.05 and open_[29] < 1e-3 and open_[46] < 2e-3


def test_what_nothing_drives_is_not_open():
    """Rows that are too far apart to be followed are steady glides, and evidence as ever."""
    acting = turning()
    assert np.abs(np.asarray(told(acting, 0.0, jnp.zeros(150, bool))[4])).max() == 0.0


def test_derivatives_stay_small_where_pushes_pile_up():
    """Just before the fold a change of lift decides when a turn ends: that slope is real, and teaches nothing."""
    base, none = turning(lift=LIFT * (1.0 - 0.46)), jnp.zeros(150)
    push = pushed(base, "lift")

    def flown(share):
        return slope(base._replace(lift=base.lift * (1.0 + share)), push, none, none)

    change = (np.asarray(flown(5e-4)[0][0]) - np.asarray(flown(-5e-4)[0][0])) / 1e-3
    assert np.abs(change).max() > 10.0
    assert np.abs(np.asarray(flown(0.0)[1][0])).max() < 5.0


def nodding(n=150):
    """Pitch that strays by a degree in a period of two minutes, from the second row on."""
    return jnp.asarray(0.017 * np.sin(2.0 * np.pi * np.arange(n) * STEP / 120.0))


@pytest.mark.parametrize("loss", [0.0, 0.43])
def test_a_stray_pitch_is_answered_by_the_motion(loss):
    """Speed and angle of attack with the answer are those of a glider whose pitch strays, however weak its wings."""
    acting = turning(lift=LIFT * (1.0 - loss))
    stray = nodding()
    speed, attack, quicker, steeper = map(np.asarray, whole(acting, stray))
    nodded = acting._replace(pitch=acting.pitch + stray)
    # It starts from the same glide.
    there, angle = map(np.asarray, flown(nodded))
    assert speed + quicker == pytest.approx(there, abs=2e-4)
    assert attack + steeper == pytest.approx(angle, abs=2e-3)
    assert np.abs(quicker).max() > 0.004


def test_weak_wings_answer_more():
    """A glider that lost 43 % of its lift answers a nod by half as much again."""
    size = {
        loss: np.std(np.asarray(whole(turning(lift=LIFT * (1.0 - loss)), nodding())[2])[100:]) for loss in (0.0, 0.43)
    }
    assert size[0.43] > 1.4 * size[0.0]


def test_a_stray_pitch_teaches_nothing_of_forces():
    """What it adds has derivatives by the stray, to first order those of small changes of it, and none by a force."""
    acting, stray = turning(), nodding()
    none = jax.tree.map(jnp.zeros_like, acting)
    _, by_force = slope(acting, pushed(acting, "lift"), stray, jnp.zeros(150))
    assert np.abs(np.asarray(by_force[2:4])).max() == 0.0 < np.abs(np.asarray(by_force[:2])).max()
    _, by_stray = slope(acting, none, stray, stray)
    more, less = (np.asarray(slope(acting, none, stray * x, stray)[0][2:4]) for x in (1.0 + 1e-6, 1.0 - 1e-6))
    change = (more - less) / 2e-6
    assert np.asarray(by_stray[2:4]) == pytest.approx(change, abs=0.05 * np.abs(change).max())
