"""What may have been left out: the library's terms as columns, shapes on small grids, and how plausible each is.

Imports NumPy, the physics' declarations and the inference. A newcomer would get wrong: a period, an onset or a depth
scale is not fitted while its amplitude is zero; it is averaged over a grid with its prior, which is what a fair look
elsewhere costs.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from glider_jax.inference.fit import Column, Problem, heaving, inadequacy
from glider_jax.inference.streams import Gathered
from glider_jax.inference.unknowns import groups_of
from glider_jax.physics.library import TERMS_BY_ID
from glider_jax.physics.term import LogNormal, declared
from glider_jax.records import Array

#: Effects that pilots meet: prior odds of all others are lower by ``RARE`` nats (judgement).
USUAL = frozenset(
    """flight.hull_compressibility flight.thermal_expansion flight.drag_growth flight.ballast_offset flight.mass_growth
    flight.vertical_water_velocity flight.pitch_offset flight.pitch_gain flight.drag_bias flight.lift_loss
    navigation.mean_current navigation.current_shear navigation.tidal_current navigation.inertial_oscillation
    navigation.surface_windage navigation.compass_deviation navigation.magnetic_declination
    energy.pump_pressure_nonlinearity energy.dive_only_load energy.hotel_growth energy.surface_load
    energy.brake_pressure energy.internal_resistance energy.cold_friction sensor.current_offset sensor.current_gain
    sensor.pressure_offset""".split()
)
RARE = 2.0
#: Terms that are one thing where no product gave the currents: a flow that nobody knew.
UNKNOWN_FLOW = (
    "navigation.mean_current", "navigation.tidal_current", "navigation.tide_k1", "navigation.inertial_oscillation",
)  # fmt: skip
FLOW_PARTS = (*UNKNOWN_FLOW, "navigation.tide_s2", "navigation.current_shear", "navigation.product_gain")
#: What a replay cannot lack: it flies in the density that the glider recorded, not in a stated profile.
STATED = "flight.density_contrast"
#: Shapes at which columns are looked at, in standard deviations of the logarithm.
SPREAD = (-1.2, 1.2)
ONSETS = 12
#: Number of the first variant that is looked at away from zero.
FAR = 400
#: How large an effect may be is known to an order of magnitude: prior sds of its amplitudes, all equally likely.
WIDTHS = (1.0, 0.25, 0.0625)


@dataclass(frozen=True)
class Variant:
    """One setting of a term's shape parameters: its columns, log prior weight, and the shapes.

    ``width`` is the prior sd of its amplitudes in units of their scales. A variant looked at away from zero takes
    column ``shift`` off the residual, begins a fit at ``start`` (values by unknown), and counts where its amplitude in
    prior units comes out in ``cell``.
    """

    columns: tuple[int, ...]
    log_weight: float
    shapes: dict[str, float] = field(default_factory=dict)
    width: float = 1.0
    shift: int = -1
    start: dict[int, float] = field(default_factory=dict)
    cell: tuple[float, float] = (-np.inf, np.inf)


@dataclass(frozen=True)
class Candidate:
    """A term that may have been left out, as alternatives of its shape."""

    id: str
    variants: tuple[Variant, ...]
    log_odds: float


class Looks:
    """Columns beside the unknowns' own: shapes on a grid, periods, onsets, and what the glide model may be wrong by."""

    def __init__(self, problem: Problem):
        self.problem = problem
        self.replay = problem.replay
        self.duration = float(problem.gathered.rows.time[-1] - problem.gathered.rows.time[0])
        self.grids: list[tuple[float, dict[str, float], dict[str, Array]]] = []
        self.far: list[tuple[int, float, dict[str, Array]]] = []
        self.periods = self._periods()
        self.onsets = self.duration * (np.arange(ONSETS) + 0.5) / ONSETS
        self.shaped = self._shaped()

    def _shaped(self) -> dict[str, tuple[str, LogNormal]]:
        found = {}
        for id, kind in TERMS_BY_ID.items():
            for name, info in declared(kind).items():
                if info.role == "shape" and name not in ("period", "onset"):
                    found[f"{id}.{name}"] = (id, info.prior)
        known = set(self.replay.shape_names)
        return {name: value for name, value in found.items() if name in known}

    def _periods(self) -> Array:
        """Periods of heaving water, half a resolution apart in frequency, between 1.5 h and the record's length."""
        top, bottom = 1.0 / 5400.0, 1.0 / self.duration
        step = 0.5 / self.duration
        return 1.0 / np.arange(bottom, max(top, bottom + step), step)[:160]

    def prepare(self) -> None:
        """Columns of the shaped terms at the ends of their grids; two Jacobians for all of them together."""
        self.grids = []
        for z in SPREAD:
            shapes = {
                name: prior.median * float(np.exp(z * np.log(prior.factor))) for name, (_, prior) in self.shaped.items()
            }
            _, columns, _ = self.replay.slopes(self.problem.values, {**shapes, **self.problem.shapes}, self._bent())
            self.grids.append((z, shapes, columns))
        self._look_far()

    def _look_far(self) -> None:
        """Effects far from linear at values beside zero: their slope there, and what they do beyond that slope."""
        self.far = []
        base = self.replay.slopes(self.problem.values, self.problem.shapes, [0])[0]
        for i, unknown in enumerate(self.replay.unknowns):
            if unknown.kind != "candidate":
                continue
            for value in declared(TERMS_BY_ID[unknown.term])[unknown.name.rsplit(".", 1)[1]].looks:
                values = self.problem.values.copy()
                values[i] = value
                there, slope, _ = self.replay.slopes(values, self.problem.shapes, [i])
                z = (value - unknown.centre) / unknown.scale
                both = {
                    name: np.stack([column[:, 0], there[name] - base[name] - z * column[:, 0]], axis=1)
                    for name, column in slope.items()
                }
                self.far.append((i, value, both))

    def _bent(self) -> list[int]:
        """Unknowns whose terms have shapes on a grid."""
        ids = {id for id, _ in self.shaped.values()}
        return [i for i, u in enumerate(self.replay.unknowns) if u.term in ids and u.kind == "candidate"]

    def __call__(self, own: dict[str, Array]) -> list[tuple[list[Column], dict[str, Array]]]:
        found: list[tuple[list[Column], dict[str, Array]]] = []
        wrong = inadequacy(self.problem.gathered)
        for name, block in wrong.items():
            found.append(([Column(-1, "inadequacy", "inadequacy") for _ in range(block.shape[1])], {name: block}))
        places = {u.name: i for i, u in enumerate(self.replay.unknowns)}
        for number, (_, _, columns) in enumerate(self.grids, start=1):
            bent = [(i, self.replay.unknowns[i]) for i in self._bent()]
            labels = [Column(i, unknown.name, unknown.term, number) for i, unknown in bent]
            found.append((labels, {name: np.nan_to_num(c) for name, c in columns.items()}))
        for number, (i, _, both) in enumerate(self.far):
            unknown = self.replay.unknowns[i]
            labels = [Column(i, unknown.name, unknown.term, FAR + number), Column(-1, unknown.name, "shift", number)]
            found.append((labels, {name: np.nan_to_num(c) for name, c in both.items()}))
        found += self._heaving(places)
        found += self._steps(own, places)
        return found

    def _heaving(self, places: dict[str, int]) -> list:
        id = "flight.vertical_water_velocity"
        if f"{id}.cosine" not in places or self.problem.gathered.stream("vertical speed") is None:
            return []
        scale = self.replay.unknowns[places[f"{id}.cosine"]].scale
        block = heaving(self.problem.gathered, tuple(self.periods), scale)
        labels = []
        for k in range(self.periods.size):
            labels += [Column(places[f"{id}.{part}"], f"{id}.{part}", id, 100 + k) for part in ("cosine", "sine")]
        return [(labels, {"vertical speed": block})]

    def _steps(self, own: dict[str, Array], places: dict[str, int]) -> list:
        """Ingress and loss of a wing at a grid of times: steady columns switched on by a sigmoid."""
        found = []
        plans = (
            ("flight.water_ingress", "mass", "flight.ballast_offset.mass", 1.0, 7200.0),
            ("flight.wing_loss", "loss", "flight.lift_loss.loss", 1.0, 600.0),
            ("flight.wing_loss", "mass", "flight.ballast_offset.mass", -1.0, 600.0),
        )
        for id, part, steady, sign, width in plans:
            name = f"{id}.{part}"
            if name not in places or steady not in places:
                continue
            ratio = sign * self.replay.unknowns[places[name]].scale / self.replay.unknowns[places[steady]].scale
            blocks: dict[str, Array] = {}
            for stream in self.problem.gathered.streams:
                if stream.name not in own:
                    continue
                late = np.clip((stream.time[:, None] - self.onsets) / width, -60.0, 60.0)
                after = 1.0 / (1.0 + np.exp(-late))
                blocks[stream.name] = ratio * np.nan_to_num(own[stream.name][:, [places[steady]]]) * after
            found.append(([Column(places[name], name, id, 300 + k) for k in range(ONSETS)], blocks))
        return found

    def candidates(self, labels: tuple[Column, ...]) -> list[Candidate]:
        """Every term with its variants, as indices into the columns of a linearised problem."""
        by: dict[str, dict[int, list[int]]] = {}
        for index, column in enumerate(labels):
            unknown = self.replay.unknowns[column.unknown] if column.unknown >= 0 else None
            if unknown is not None and unknown.kind == "candidate":
                by.setdefault(column.term, {}).setdefault(column.variant, []).append(index)
        self.shifts = {c.variant: i for i, c in enumerate(labels) if c.term == "shift"}
        flow = not self.problem.gathered.product
        found = []
        for id, variants in by.items():
            if id == STATED or (flow and id in FLOW_PARTS):
                continue
            odds = 0.0 if id in USUAL else -RARE
            alternatives = self._variants(id, variants)
            if alternatives:
                found.append(Candidate(id, widened(alternatives), odds))
        if flow:
            together = tuple(i for id in UNKNOWN_FLOW if id in by for i in by[id][0])
            if together:
                found.append(Candidate("navigation.mean_current", widened((Variant(together, 0.0),)), 0.0))
        return found

    def _variants(self, id: str, variants: dict[int, list[int]]) -> tuple[Variant, ...]:
        if id == "flight.vertical_water_velocity":
            prior = declared(TERMS_BY_ID[id])["period"].prior
            weight = -0.5 * (np.log(self.periods / prior.median) / np.log(prior.factor)) ** 2
            weight = weight + np.log(np.abs(np.gradient(np.log(self.periods)))) if self.periods.size > 1 else weight
            weight = weight - np.logaddexp.reduce(weight)
            name = f"{id}.period"
            return tuple(
                Variant(tuple(variants[100 + k]), float(weight[k]), {name: float(self.periods[k])})
                for k in range(self.periods.size)
                if 100 + k in variants
            )
        if any(v >= FAR for v in variants):
            return self._from_afar(id, variants)
        steps = [v for v in variants if v >= 300]
        if steps:
            return tuple(
                Variant(tuple(variants[v]), -float(np.log(len(steps))), {f"{id}.onset": float(self.onsets[v - 300])})
                for v in steps
            )
        weights = [0.5, *(0.25 for _ in self.grids)]
        found = []
        for number, columns in sorted(variants.items()):
            if number == 0 and len(variants) == 1:
                return (Variant(tuple(columns), 0.0),)
            shapes = {} if number == 0 else {
                n: v for n, v in self.grids[number - 1][1].items() if self.shaped[n][0] == id
            }  # fmt: skip
            found.append(Variant(tuple(columns), float(np.log(weights[number])), shapes))
        return tuple(found)

    def _from_afar(self, id: str, variants: dict[int, list[int]]) -> tuple[Variant, ...]:
        """A term at zero and at other values of its amplitude, each for what comes out nearest to it."""
        far = [v for v in variants if v >= FAR]
        i = self.far[far[0] - FAR][0]
        unknown = self.replay.unknowns[i]
        at = sorted([(unknown.centre, 0), *((self.far[v - FAR][1], v) for v in far)])
        z = [(value - unknown.centre) / unknown.scale for value, _ in at]
        edges = [-np.inf, *(0.5 * (a + b) for a, b in zip(z[:-1], z[1:], strict=True)), np.inf]
        found = []
        for n, (value, v) in enumerate(at):
            shift, start = (self.shifts[v - FAR], {i: value}) if v >= FAR else (-1, {})
            cell = (edges[n], edges[n + 1])
            found.append(Variant(tuple(variants[v]), 0.0, shift=shift, start=start, cell=cell))
        return tuple(found)


def untestable(gathered: Gathered) -> list[str]:
    """Ids that no recording, or not this one, can speak of: a stated profile, and the glide of unknown buoyancy."""
    glide = [id for id, kind in TERMS_BY_ID.items() if groups_of(kind.info.channels) == {"flight"} and id != STATED]
    return [STATED, *([] if gathered.buoyancy_known else glide)]


def widened(variants: tuple[Variant, ...]) -> tuple[Variant, ...]:
    """Variants with each width of their prior."""
    weight = -float(np.log(len(WIDTHS)))
    return tuple(
        replace(one, log_weight=one.log_weight + weight, width=one.width * width)
        for one in variants
        for width in WIDTHS
    )
