"""From recordings or board logs to an energy model in one call; NumPy only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from glider_jax.board.calibration import Calibration
from glider_jax.board.events import Event, GliderRecord, counter_ratio, events_from_glider, glider_record
from glider_jax.board.fits import EnergyModel, Gains, board_gains, fit_energy
from glider_jax.board.motors import board_levels, events_from_board
from glider_jax.board.record import BoardRecord
from glider_jax.board.steady import steady_levels
from glider_jax.errors import FitError
from glider_jax.records import Recording


@dataclass(frozen=True)
class Analysis:
    """Events, the model fitted to them, and the record they were found in; ``counter`` as
    ``counter_ratio`` gives it."""

    model: EnergyModel
    events: tuple[Event, ...]
    glider: GliderRecord | None
    counter: tuple[float, float] = (float("nan"), float("nan"))


def join_records(records: Sequence[GliderRecord]) -> GliderRecord:
    """One record of several of the same vehicle, in the order of their times; channels that one lacks are
    dropped."""
    ordered = sorted(records, key=lambda r: float(r.time[0]))
    if len(ordered) == 1:
        return ordered[0]
    for before, after in zip(ordered[:-1], ordered[1:], strict=True):
        if after.time[0] <= before.time[-1]:
            raise FitError(
                f"{after.name}: begins before {before.name} ends. Fit recordings of different vehicles, or the same "
                "time twice, one by one."
            )
    joined: dict[str, Any] = {}
    for name in ("time", "depth", "voltage", "current", "charge", "volume", "moving"):
        parts = [getattr(r, name) for r in ordered]
        joined[name] = None if any(part is None for part in parts) else np.concatenate(parts)
    segments, last = [], 0
    for record in ordered:
        own = record.segment if record.segment is not None else np.zeros(record.time.size, dtype=np.int64)
        segments.append(own - own.min() + last)
        last = int(segments[-1].max()) + 1
    states = [r.states or {} for r in ordered]
    shared = sorted(set.intersection(*(set(s) for s in states)))
    joined["states"] = {key: np.concatenate([s[key] for s in states]) for key in shared}
    return GliderRecord(segment=np.concatenate(segments), name=", ".join(r.name for r in ordered), **joined)


def analyse_recordings(recordings: Sequence[Recording], gains: Gains | None = None) -> Analysis:
    """Fit an energy model to glider recordings that carry the current of the whole vehicle.

    Raises
    ------
    DataError : a recording lacks what is needed.
    FitError : too few pump strokes.
    """
    record = join_records([glider_record(recording) for recording in recordings])
    events = events_from_glider(record)
    model = fit_energy(events, steady_levels(record), record.name, gains)
    return Analysis(model, tuple(events), record, counter_ratio(record))


def analyse_board(
    record: BoardRecord,
    glider: GliderRecord,
    calibration: Calibration,
    voltage: float | None = None,
    bench: float | None = None,
) -> Analysis:
    """Fit an energy model to board samples, with depth, voltage and volume from the glider's record.

    Parameters
    ----------
    voltage : V, where the glider recorded none.
    bench : relative 1-sigma of the sensors' gains after a bench calibration.
    """
    events = events_from_board(record, glider, calibration, voltage)
    levels, zero = board_levels(record, glider, calibration)
    model = fit_energy(events, levels, record.name, board_gains(zero, bench), brake_separate=True)
    warnings = list(model.warnings)
    lost = sum(not event.complete for event in events)
    if lost:
        warnings.append(f"{lost} events have samples missing and were left out of the fits.")
    hotel = next((level for level in levels if level.phase == "submerged"), None)
    if hotel is not None and zero > 0.1 * hotel.mean:
        warnings.append(
            f"hotel: the zero of the main sensor leaves {zero:.2f} W of {hotel.mean:.2f} W open. Measure its zero "
            "on the bench, or take the steady load from the glider's coulomb counter."
        )
    return Analysis(replace(model, warnings=tuple(warnings)), tuple(events), glider)


def events_table(events: Sequence[Event]) -> list[dict[str, Any]]:
    """Events as plain rows for JSON and CSV; NaN becomes None."""
    rows = []
    for event in events:
        row = asdict(event)
        rows.append({k: (None if isinstance(v, float) and not np.isfinite(v) else v) for k, v in row.items()})
    return rows


def events_csv(events: Sequence[Event]) -> str:
    """Events as CSV; times s since 1970, SI units."""
    rows = events_table(events)
    names = list(rows[0]) if rows else [f.name for f in Event.__dataclass_fields__.values()]
    lines = [",".join(names)]
    lines += [",".join("" if row[n] is None else str(row[n]) for n in names) for row in rows]
    return "\n".join(lines) + "\n"
