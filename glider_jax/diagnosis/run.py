"""Diagnose a recording: gather, search, confirm, look at what is left, and write what was found.

Imports everything the diagnosis is made of; JAX runs in 64-bit precision inside. Layers: readers give records, the
inference fits, this module puts the parts in order and returns the mapping that ``diagnosis.json`` holds.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import jax
import numpy as np

from glider_jax.config import Mission, Vehicle
from glider_jax.diagnosis import flown, locate, regimes
from glider_jax.diagnosis.candidates import Candidate
from glider_jax.diagnosis.confirm import Confirmation, confirm
from glider_jax.diagnosis.flow import name_flow
from glider_jax.diagnosis.misses import explain
from glider_jax.diagnosis.schema import document
from glider_jax.diagnosis.screen import Search
from glider_jax.diagnosis.tune import estimates, tune
from glider_jax.diagnosis.unexplained import Named, Remainder, remainders, stuck
from glider_jax.errors import DataError, did_you_mean
from glider_jax.inference.fit import make_problem
from glider_jax.inference.kinematics import held
from glider_jax.inference.replay import build_replay
from glider_jax.inference.streams import Gathered, gather
from glider_jax.physics.library import TERMS_BY_ID
from glider_jax.records import Array, BathymetryGrid, CurrentGrid, Recording

#: nats that one more name costs beside a shape that needs none, and effects up to which pairs of them are looked at.
COINCIDENCE, MOST_PAIRED = 3.3, 4


@dataclass
class Finding:
    """All that a diagnosis found; ``schema.document`` turns it into plain data.

    ``mean`` and ``covariance`` are of ``active`` columns in prior units; ``before`` and ``after`` the places where the
    residual of calibrations alone, and of the full model, has structure.
    """

    recording: Recording
    vehicle: Vehicle
    gathered: Gathered
    search: Search
    mean: Array
    covariance: Array
    blocks: Confirmation
    last: Confirmation
    before: list[locate.Place]
    after: list[locate.Place]
    remainders: list[Remainder]
    whitened: dict[str, tuple[Array, Array]]
    seconds: float
    settings: dict[str, Any]


def diagnose(
    folder: str | Path | None = None,
    out: str | Path | None = None,
    *,
    recording: Recording | None = None,
    vehicle: Vehicle | None = None,
    mission: Mission | None = None,
    currents: CurrentGrid | None = None,
    bathymetry: BathymetryGrid | None = None,
    only: Sequence[str] = (),
    exclude: Sequence[str] = (),
    streams: Sequence[str] | None = None,
    noise: str = "fitted",
    hold_out: str = "blocks",
    priors: bool = True,
    report: bool = True,
    whole: bool = False,
    misses: Sequence[dict[str, Any]] = (),
    fly: int = 0,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Say what physics a base model left out of a recording.

    Parameters
    ----------
    folder : with ``recording.nc``, ``vehicle.toml`` and, where there are any, ``mission.toml``, ``currents.nc`` and
        ``bathymetry.nc``; records given by name take precedence.
    out : folder for ``diagnosis.json``, ``report.html``, ``vehicle.toml`` and figures; None writes nothing.
    only : accept exactly these effects, without a search. exclude : effects that may not be named.
    streams : use these streams alone (``vertical_speed``). noise : ``fitted`` or ``independent``.
    hold_out : ``blocks`` of dives or ``random`` rows. priors : False lets parameters take any size.
    report : write the report and figures beside the numbers.
    whole : take a recording with a hole of more than half a day as one mission, not as several.
    misses : cases of a hindcast, to be set beside what was named.
    fly : members that fly the mission with the base model and with what was named; 0 flies none.
    progress : is told what is being done.

    Raises
    ------
    DataError : the recording cannot be replayed; an effect or stream named is unknown.
    """
    began = time.perf_counter()
    tell = progress or (lambda text: None)
    for id in (*only, *exclude):
        if id not in TERMS_BY_ID:
            raise DataError(f"effect '{id}': not in the library.{did_you_mean(id, TERMS_BY_ID)}")
    if folder is not None:
        tell("reading")
        recording, vehicle, mission, currents, bathymetry = _read(
            Path(folder), recording, vehicle, mission, currents, bathymetry
        )
    if recording is None or vehicle is None:
        raise DataError("diagnose: expected a recording and a vehicle, or a folder with both. Give them.")
    settings = {
        "only": list(only), "exclude": list(exclude), "streams": list(streams or ()), "noise": noise,
        "hold_out": hold_out, "priors": priors,
    }  # fmt: skip
    parts = [recording] if whole else regimes.split(recording)
    with jax.enable_x64(True):
        findings = [_find(part, vehicle, mission, currents, bathymetry, settings, tell) for part in parts]
        contents = []
        for found in findings:
            found.seconds = time.perf_counter() - began
            contents.append(document(found))
            name_flow(found, contents[-1])
    content = regimes.join(contents, [regimes.levels(one) for one in findings]) if len(parts) > 1 else contents[0]
    if misses:
        content["forecast_misses"] = explain(list(misses), found, content)
    if fly and content["effects"]:
        tell("ensemble before and after")
        after = flown.fitted(vehicle, content["effects"])
        content["ensemble"] = flown.compare(
            found.recording, vehicle, after, mission, currents, bathymetry, members=fly
        )
    content["seconds"] = round(time.perf_counter() - began, 2)
    if out is not None:
        from glider_jax.diagnosis.report import write

        for number, (one, told) in enumerate(zip(findings[:-1], contents[:-1], strict=True), start=1):
            write(Path(out) / f"mission-{number}", one, told, report=report)
        write(Path(out), found, content, report=report)
    return content


def _read(folder, recording, vehicle, mission, currents, bathymetry):
    from glider_jax.readers.bathymetry import read_bathymetry
    from glider_jax.readers.currents import read_currents
    from glider_jax.readers.missions import read_mission
    from glider_jax.readers.recordings import read_recording
    from glider_jax.readers.vehicles import read_vehicle

    def there(name: str) -> Path | None:
        return folder / name if (folder / name).exists() else None

    if recording is None:
        recording = read_recording(there("recording.nc") or folder)
    if vehicle is None:
        vehicle = read_vehicle(there("vehicle.toml"))
    if mission is None and there("mission.toml"):
        mission = read_mission(there("mission.toml"))
    if currents is None and there("currents.nc"):
        currents = read_currents(there("currents.nc"))
    if bathymetry is None and there("bathymetry.nc"):
        bathymetry = read_bathymetry(there("bathymetry.nc"))
    return recording, vehicle, mission, currents, bathymetry


def _find(recording, vehicle, mission, currents, bathymetry, settings, tell) -> Finding:
    gathered = gather(recording, vehicle, mission, currents, bathymetry)
    gathered = _chosen(gathered, settings["streams"])
    if not gathered.streams:
        raise DataError(
            f"{recording.name}: nothing to compare: {'; '.join(gathered.missing)}. A day of dives with depth, pitch, "
            "pumped volume and GPS fixes is the least that can be diagnosed."
        )
    tell(f"{sum(s.n for s in gathered.streams)} measurements in {len(gathered.streams)} streams")
    replay = build_replay(gathered, held(vehicle, recording), 2.0 if settings["priors"] else 100.0)
    search = _Settled(make_problem(gathered, replay), settings, tell)
    search.run()
    tune(search)
    tell("held-out dives")
    blocks = search.held_out()
    if search.reject(blocks.effects):
        tune(search)
        blocks = search.held_out()
    linear, fixed, active = search.linear, search.plain, search.active
    mean, covariance = estimates(search)
    effects = search.columns
    last = confirm(search.problem, linear, fixed, effects, "last")
    tell("what is left")
    alone, _ = linear.solve(fixed)
    before = locate.discoveries(
        locate.places(
            search.problem, linear, linear.residual - linear.columns[:, fixed] @ alone,
            linear.raw - linear.raw_columns[:, fixed] @ alone,
        )
    )  # fmt: skip
    rest, after = remainders(search.problem, linear, active, _replaceable(search))
    still = stuck(search.problem, recording)
    if still is not None:
        rest = [still, *(one for one in rest if one.place.stream != still.place.stream)]
    whole = fixed + [i for columns in effects.values() for i in columns]
    both, _ = linear.solve(whole)
    whitened = {
        name: (
            (linear.raw - linear.raw_columns[:, fixed] @ alone)[linear.stream == i],
            (linear.raw - linear.raw_columns[:, whole] @ both)[linear.stream == i],
        )
        for i, name in enumerate(search.problem.names)
    }
    return Finding(
        recording, vehicle, gathered, search, mean, covariance, blocks, last, before, after, rest, whitened, 0.0,
        settings,
    )  # fmt: skip


def _replaceable(search: Search) -> list[Named]:
    """Accepted effects by themselves, in pairs and all together, with the evidence for each.

    Several names for what one shape explains are that many coincidences: each beyond the first costs prior odds.
    """
    picks = search.picks
    sizes = {1, 2, len(picks)} if len(picks) <= MOST_PAIRED else {1, len(picks)}
    found = []
    for group in (g for size in sorted(sizes - {0}) for g in combinations(picks, size)):
        columns = tuple(i for pick in group for i in pick.variant.columns)
        gain = search.linear.score(search.active) - search.linear.score([i for i in search.active if i not in columns])
        odds = sum(pick.candidate.log_odds + pick.looked for pick in group) - COINCIDENCE * (len(group) - 1)
        found.append(Named(tuple(pick.candidate.id for pick in group), columns, gain + odds))
    return found


def _chosen(gathered: Gathered, streams: Sequence[str]) -> Gathered:
    if not streams:
        return gathered
    wanted = {name.replace("_", " ") for name in streams}
    known = [s.name for s in gathered.streams]
    for name in wanted:
        if name not in known:
            raise DataError(f"stream '{name}': the recording has {', '.join(known)}.{did_you_mean(name, known)}")
    return replace(gathered, streams=tuple(s for s in gathered.streams if s.name in wanted))


class _Settled(Search):
    """A search under the settings of a run: effects fixed or barred, noise independent."""

    def __init__(self, problem, settings, progress):
        super().__init__(problem, progress, independent=settings["noise"] == "independent")
        self.only, self.exclude = settings["only"], frozenset(settings["exclude"])
        self.hold_out = settings["hold_out"]

    def allowed(self, candidate: Candidate) -> bool:
        """Whether the search may name a candidate."""
        return candidate.id not in self.exclude

    def reject(self, held_out: dict[str, tuple[float, float]]) -> bool:
        """Take back effects that held-out dives speak against, where there are dives enough to say so."""
        if self.only or np.unique(self.linear.block).size < 8:
            return False
        bad = [p for p in self.picks if held_out.get(p.candidate.id, (1.0, 1.0))[0] <= 0.0]
        if not bad:
            return False
        self.path += [f"took back {p.candidate.id}: held-out dives fit worse with it" for p in bad]
        self.picks = [p for p in self.picks if p not in bad]
        self.relinearise()
        # What they stood for may have another name, which has to hold on those dives too.
        self.go_on()
        return True

    @property
    def columns(self) -> dict[str, list[int]]:
        """Columns of the accepted effects by their ids."""
        return {pick.candidate.id: list(pick.variant.columns) for pick in self.picks}

    def held_out(self) -> Confirmation:
        """What dives that were left out of the fit say of the accepted effects."""
        return confirm(self.problem, self.linear, self.plain, self.columns, self.hold_out)

    def refine(self) -> None:
        """Go on until nothing changes, and name of effects that the linear problem cannot compare the better ones."""
        super().refine()
        for _ in range(len(self.picks)):
            if not self._prefer():
                return
            super().refine()

    def _prefer(self) -> bool:
        """Put an effect that is ahead where each fit comes to rest in the place of an accepted one; whether any was.

        No lead is asked for: the search is over, and nothing can run in circles.
        """
        for k, pick in enumerate(self.picks):
            ahead = [one for one in self.at_rest(k) if one[1] < 0.0 and not self._back(one[0].candidate.id)]
            if ahead:
                other, behind = min(ahead, key=lambda one: one[1])
                self.path.append(f"preferred {other.candidate.id} to {pick.candidate.id} ({-behind:.1f} nats)")
                self.picks = [*self.picks[:k], other, *self.picks[k + 1 :]]
                return True
        return False

    def run(self) -> None:
        """Search, or accept exactly what was asked for."""
        if not self.only:
            super().run()
            return
        if any(id in self.only for id, _ in self.looks.shaped.values()):
            self.looks.prepare()
        self.relinearise(harden=2)
        self.relinearise()
        for id in self.only:
            candidate = next((c for c in self.candidates if c.id == id), None)
            if candidate is not None:
                active = self.active
                self.picks.append(self.pick(candidate, active, self.linear.score(active)))
        self.relinearise()
        self.relinearise(learn_noise=False)


__all__ = ["Finding", "diagnose"]
