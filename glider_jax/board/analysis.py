"""From recordings or board logs to an energy model in one call; NumPy only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from glider_jax.board.calibration import Calibration
from glider_jax.board.counter import COUNTER_SD, CounterCheck, against_counter
from glider_jax.board.events import Event, GliderRecord, counter_ratio, events_from_glider, glider_record
from glider_jax.board.fits import EnergyModel, Gains, board_gains, fit_energy
from glider_jax.board.motors import board_levels, events_from_board
from glider_jax.board.record import BoardRecord
from glider_jax.board.steady import Level, steady_levels
from glider_jax.errors import DataError, FitError
from glider_jax.records import Recording


@dataclass(frozen=True)
class Analysis:
    """Events, the model fitted to them, and the record they were found in.

    ``counter`` compares the glider's current with its own counter, as ``counter_ratio`` gives it; ``check`` compares a
    board with that counter. ``servos`` W is what pitch and fin drew on average in board samples, which ``hotel`` does
    not contain.
    """

    model: EnergyModel
    events: tuple[Event, ...]
    glider: GliderRecord | None
    counter: tuple[float, float] = (float("nan"), float("nan"))
    check: CounterCheck | None = None
    servos: float = float("nan")


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

    Where the glider recorded its coulomb counter, the board is compared with it, and the steady load is taken from the
    one that knows it better: the zero of the board's main sensor is often worth more than the load.

    Parameters
    ----------
    voltage : V, where the glider recorded none.
    bench : relative 1-sigma of the sensors' gains after a bench calibration.
    """
    events = events_from_board(record, glider, calibration, voltage)
    levels, zero = board_levels(record, glider, calibration)
    warnings: list[str] = []
    gains = board_gains(zero, bench)
    check = against_counter(record, glider, calibration)
    if check is not None and not check.agrees:
        warnings.append(
            f"{check.sentence()}: more than twice what gain and zero allow. Check the calibration."
        )
    levels, gains = _steady_load(levels, gains, glider, events, warnings)
    model = fit_energy(events, levels, record.name, gains, brake_separate=True)
    lost = sum(not event.complete for event in events)
    if lost:
        warnings.append(f"{lost} events have samples missing and were left out of the fits.")
    hotel = next((level for level in levels if level.phase == "submerged"), None)
    if hotel is not None and gains.main_zero > 0.1 * hotel.mean:
        warnings.append(
            f"hotel: the zero of the main sensor leaves {zero:.2f} W of {hotel.mean:.2f} W open. Measure its zero "
            "on the bench, or give a recording with the glider's coulomb counter."
        )
    model = replace(model, warnings=(*model.warnings, *warnings))
    return Analysis(model, tuple(events), glider, counter_ratio(glider), check, _servo_power(record, events))


def _steady_load(
    levels: list[Level], gains: Gains, glider: GliderRecord, events: list[Event], warnings: list[str]
) -> tuple[list[Level], Gains]:
    """Steady load from the board or from the glider's counter, whichever knows it better."""
    if glider.current is None:
        return levels, gains
    try:
        counted = steady_levels(glider, motors=events)
    except DataError as error:
        warnings.append(f"steady load: the glider's own current is of no use: {error}")
        return levels, gains
    own = next((level for level in levels if level.phase == "submerged"), None)
    other = next((level for level in counted if level.phase == "submerged"), None)
    if other is None:
        return levels, gains
    if own is not None:
        sd_own = np.sqrt(own.mean_sd**2 + (gains.main * own.mean) ** 2 + gains.main_zero**2)
        sd_other = np.hypot(other.mean_sd, COUNTER_SD * other.mean)
        if abs(own.mean - other.mean) > 3.0 * np.hypot(sd_own, sd_other):
            warnings.append(
                f"steady load: board {own.mean:.2f} +- {sd_own:.2f} W, coulomb counter {other.mean:.2f} +- "
                f"{sd_other:.2f} W; they differ by more than their uncertainty."
            )
        if sd_own <= sd_other:
            return levels, gains
    text = (
        f"{gains.source}; steady load from the glider's coulomb counter, {100 * COUNTER_SD:g} % (judgement)"
    )
    return counted, replace(gains, main=COUNTER_SD, main_zero=0.0, source=text)


def _servo_power(record: BoardRecord, events: list[Event]) -> float:
    """Mean power of pitch and fin over the samples of their channels, W."""
    power = 0.0
    for kind in ("pitch", "fin"):
        own = record.only(kind)
        seconds = len(own.tick) * own.spacing
        power += sum(abs(event.energy) for event in events if event.kind == kind) / max(seconds, own.spacing)
    return power


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
