"""Surface dialogs of Slocum gliders: terminal logs, network logs and mission logs (``.mlg``) to typed surfacings.

Standard library and records only, so that the command starts at once. Logs are torn: lines may be garbled, cut,
repeated or replayed out of order, and any byte may stand in them. What cannot be read is left out and counted; nothing
but :class:`DataError` is raised, and only for a file that cannot be opened. A log without a printout of the dialog
gives no surfacings.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from glider_jax.errors import DataError
from glider_jax.readers.dialog_grammar import clean, garbled, tokens
from glider_jax.readers.dialog_merge import (
    MOST_GLIDERS,
    SAME_START,
    mended_clocks,
    similar,
    surfacings_of,
    without_copies,
)
from glider_jax.readers.dialog_records import Dump, Surfacing
from glider_jax.readers.dialog_stream import Stream
from glider_jax.records import Repair, Source

LARGEST_FILE = 512 * 1024 * 1024

_DETAILS = {
    "control characters": "taken out before reading",
    "garbled line": "begins a datum of the dialog but does not complete it",
    "impossible value": "a position, number or age that cannot be",
    "replayed printout": "same glider and clock as an earlier one; gaps were filled from it",
    "other glider": "printouts of another glider than the one asked for",
    "garbled name": "one character off the name of the glider in the same mission",
    "mended clock": "contradicts both neighbours, set from the mission time",
}


@dataclass(frozen=True)
class DialogLog:
    """A dialog log: its surfacings in time order, and what was mended or left out on the way.

    ``dumps`` are the printouts as read, in the order of the log; ``vehicles`` every name among the surfacings.
    ``repairs`` counts everything mended or left out, ``reading_repairs`` the part of it that concerns single lines.
    ``asked`` is the glider whose surfacings were asked for.
    """

    surfacings: tuple[Surfacing, ...]
    vehicles: tuple[str, ...]
    repairs: tuple[Repair, ...]
    source: Source
    dumps: tuple[Dump, ...]
    reading_repairs: tuple[Repair, ...] = ()
    asked: str | None = None

    @property
    def latest(self) -> Surfacing | None:
        """The newest surfacing, or None."""
        return self.surfacings[-1] if self.surfacings else None

    def until(self, moment: float) -> DialogLog:
        """The log as it stood at ``moment``: nothing the glider printed at a later clock is used.

        Words without a clock of their own (prompts, menus) stay with the clock printed before them.
        """
        later = min((d.order for d in self.dumps if d.dated and d.time > moment), default=len(self.dumps))
        kept = tuple(
            replace(d, reports=tuple(r for r in d.reports if d.time + r[0] <= moment))
            for d in self.dumps
            if (d.time <= moment if d.dated else d.order < later)
        )
        return _log(kept, self.asked, self.reading_repairs, self.source)


def read_dialog(source: str | bytes | os.PathLike[str], *, vehicle: str | None = None) -> DialogLog:
    """Read what a glider said at the surface.

    Parameters
    ----------
    source : a path (``pathlib.Path``) to a log, or its text or bytes. A ``str`` is always text and never opened, so
        that no text of a glider can name a file.
    vehicle : keep the printouts of this glider only, and those that name none.

    Returns
    -------
    Surfacings in time order; repeated printouts of one surfacing are merged, replayed ones counted once.

    Raises
    ------
    DataError : the file cannot be read.
    """
    raw, origin = _content(source)
    text, noise = clean(raw)
    found = tokens(text)
    torn = garbled(text, found)
    counts = Counter({"control characters": noise, "garbled line": len(torn)})
    dumps = Stream(counts).read(found, torn)
    return _log(tuple(dumps), vehicle, _repairs(counts), origin)


def joined_logs(logs: Sequence[DialogLog], *, vehicle: str | None = None) -> DialogLog:
    """Several logs of one glider as one: what two of them recorded (terminal and mission log, say) counts once."""
    dumps: list[Dump] = []
    for log in logs:
        dumps += [replace(d, order=len(dumps) + i) for i, d in enumerate(log.dumps)]
    files = {path: digest for log in logs for path, digest in log.source.files.items()}
    reading = tuple(r for log in logs for r in log.reading_repairs)
    return _log(tuple(dumps), vehicle, reading, Source("Slocum surface dialog", files))


def _repairs(counts: Counter[str]) -> tuple[Repair, ...]:
    return tuple(Repair(kind, n, _DETAILS[kind]) for kind, n in counts.items() if n)


def _content(source: str | bytes | os.PathLike[str]) -> tuple[str, Source]:
    if isinstance(source, str):
        return source, Source("Slocum surface dialog")
    if isinstance(source, (bytes, bytearray, memoryview)):
        return bytes(source).decode("latin-1"), Source("Slocum surface dialog")
    path = Path(source)
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise DataError(f"{path}: expected a dialog log below 512 MiB, found more. Split it.")
        raw = path.read_bytes()
        digest = Source.digest(path)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: expected a dialog log, found {error}. Check the path.") from error
    return raw.decode("latin-1"), Source("Slocum surface dialog", {str(path): digest})


def _log(
    dumps: tuple[Dump, ...], vehicle: str | None, reading: tuple[Repair, ...], source: Source
) -> DialogLog:
    """A log of printouts as read: clocks mended, copies joined, names settled, surfacings told apart."""
    counts: Counter[str] = Counter()
    mended, counts["mended clock"] = mended_clocks(list(dumps))
    single, counts["replayed printout"] = without_copies(mended)
    named = _named(single, counts)
    kept = named if vehicle is None else _of_vehicle(named, vehicle, counts)
    surfacings, merged = surfacings_of(kept)
    vehicles = tuple(dict.fromkeys(d.vehicle for d in kept if d.vehicle))
    return DialogLog(
        surfacings, vehicles, reading + _repairs(counts) + merged, source, dumps, reading, vehicle
    )


def _named(dumps: list[Dump], counts: Counter[str]) -> list[Dump]:
    """Printouts whose name was lost or garbled get the name of the glider whose mission start they share.

    Names of a fleet often differ by one character, so a name is taken for garbled only where it stands alone and
    another glider of nearly this name began its mission at the same time.
    """
    totals = Counter(d.vehicle for d in dumps if d.vehicle)
    kin = [d for d in dumps if totals[d.vehicle] > 1] if 1 < len(totals) <= MOST_GLIDERS else []
    out = []
    for dump in dumps:
        name = dump.vehicle
        if not name and len(totals) == 1:
            name = next(iter(totals))
        elif name and totals[name] == 1:
            name = next((d.vehicle for d in kin if similar(d.vehicle, name) and _same(d, dump)), name)
            counts["garbled name"] += name != dump.vehicle
        out.append(dump if name == dump.vehicle else replace(dump, vehicle=name))
    return out


def _same(one: Dump, other: Dump) -> bool:
    return abs((one.time - one.mission_time) - (other.time - other.mission_time)) <= SAME_START


def _of_vehicle(dumps: Iterable[Dump], vehicle: str, counts: Counter[str]) -> list[Dump]:
    kept = []
    for dump in dumps:
        if dump.vehicle and dump.vehicle.casefold() != vehicle.casefold():
            counts["other glider"] += 1
        else:
            kept.append(replace(dump, vehicle=vehicle))
    return kept
