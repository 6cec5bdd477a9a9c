"""Lines of a dialog put together to printouts.

Standard library and records only. A printout begins with the reason, mission, glider and clock and goes on with
positions and sensors, but any line may be missing, doubled or out of order: a new printout begins where a line comes
that the open one has already, or a heading after the positions.
"""

from __future__ import annotations

import bisect
import math
import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from glider_jax.readers.dialog_grammar import (
    NEVER,
    UNSET,
    Token,
    known_age,
    moment,
    number,
    place,
    printable,
    right_unit,
    to_si,
)
from glider_jax.readers.dialog_records import IN_MISSION, NOT_IN_MISSION, DeviceCounts, Dump

#: s; single readings later than this after a printout are not tied to its clock.
LONGEST_REPORT = 7200.0
#: Characters between the first position and a clock line that was printed out of order.
OUT_OF_ORDER = 300
MOST_ERRORS = 20

_KINDS = {"Location": "gps", "TooFar": "too_far", "Invalid": "invalid"}
_PLACES = frozenset({"gps", "dead_reckoned", "too_far", "invalid"})
_NUMBER = re.compile(r"(\S{1,48})-\d{4}-\d{1,3}-\d{1,5}-\d{1,6}", re.ASCII)


@dataclass
class Draft:
    """A printout while its lines come in."""

    start: int
    heard_before: str = ""
    names: list[str] = field(default_factory=list)
    slots: dict[str, Any] = field(default_factory=dict)
    positions: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    sensors: dict[str, tuple[float, str, float]] = field(default_factory=dict)
    defaults: dict[str, tuple[float, str]] = field(default_factory=dict)
    reports: list[tuple[float, str, float, str]] = field(default_factory=list)
    aborts: dict[str, str] = field(default_factory=dict)
    errors: list[str] = field(default_factory=list)
    seen: dict[str, tuple[str | None, ...]] = field(default_factory=dict)

    @property
    def has_body(self) -> bool:
        return bool(self.sensors or self.defaults or _PLACES & self.seen.keys())

    def judge(self, state: str, evidence: str, code: int | None = None) -> None:
        """Set whether a mission is running; the newest evidence stands."""
        self.slots |= {"state": state, "evidence": evidence, "abort_code": code}


class Stream:
    """Turns tokens into printouts, remembering what the log last said about glider, mission and prompt."""

    def __init__(self, counts: Counter[str]) -> None:
        self.counts = counts
        self.drafts: list[Draft] = []
        self.open = False
        self.heard: list[str] = []
        self.vehicle = ""
        self.mission: dict[str, str] = {}
        self.at_prompt = ""
        self.clock_holds = False

    def read(self, found: list[Token], torn: list[int]) -> list[Dump]:
        """All printouts in the order of the log."""
        for token in found:
            getattr(self, f"_{token.kind}", self._mark)(token)
        starts = [d.start for d in self.drafts]
        hurt = Counter(bisect.bisect(starts, where) - 1 for where in torn)
        return [self._dump(i, draft, hurt[i]) for i, draft in enumerate(self.drafts)]

    def _dump(self, order: int, draft: Draft, hurt: int) -> Dump:
        return Dump(
            order=order,
            positions=draft.positions,
            sensors=draft.sensors,
            defaults=draft.defaults,
            reports=tuple(draft.reports),
            aborts=draft.aborts,
            errors=tuple(dict.fromkeys(draft.errors))[:MOST_ERRORS],
            garbled=hurt,
            vehicle=Counter(draft.names or [draft.heard_before]).most_common(1)[0][0],
            **draft.slots,
        )

    def _last(self) -> Draft | None:
        return self.drafts[-1] if self.drafts else None

    def _draft(self, token: Token, slot: str) -> Draft:
        """The printout this line belongs to: the open one, or a new one if it is past this line already."""
        now = self.drafts[-1] if self.open else None
        if now is not None and slot not in now.seen:
            head = slot in ("because", "mission", "time")
            late_clock = slot == "time" and not now.sensors and token.start - now.start < OUT_OF_ORDER
            if not head or not now.has_body or late_clock:
                now.seen[slot] = token.groups
                return now
        now = Draft(token.start, self.vehicle, self.heard)
        now.slots.update(self.mission)
        if self.at_prompt:
            now.judge(NOT_IN_MISSION, self.at_prompt)
        elif self.mission:
            now.judge(IN_MISSION, "mission log")
        now.seen[slot] = token.groups
        self.heard, self.open, self.clock_holds = [], True, False
        self.drafts.append(now)
        return now

    def _name(self, token: Token) -> None:
        name = printable(token.groups[0] or "")
        now = self._last()
        self.vehicle = name
        if self.open and now is not None and not now.has_body and "time" not in now.seen:
            now.names.append(name)
            return
        self.open = False
        self.heard = [*self.heard[-1:], name]

    _vehicle = _surface = _name

    def _connection(self, token: Token) -> None:
        if token.groups[0] == "found":
            self.open, self.at_prompt, self.heard = False, "", []

    def _because(self, token: Token) -> None:
        now = self._draft(token, "because")
        text, behavior, code = token.groups
        now.slots |= {"reason": printable(text or ""), "behavior": behavior or "", "start_when": number(code)}
        self._running(now, "reason of the surfacing")

    def _running(self, now: Draft | None, evidence: str) -> None:
        self.at_prompt = ""
        if now is not None:
            now.judge(IN_MISSION, evidence)

    def _mission(self, token: Token) -> None:
        now = self._draft(token, "mission")
        name, label, files = token.groups
        now.slots["mission"] = printable(name or "")
        if parts := _NUMBER.fullmatch(label or ""):
            now.slots |= {"mission_number": printable(label or ""), "file_number": files or ""}
            now.names.append(printable(parts[1]))
        self._running(now, "mission name")

    def _log_mission(self, token: Token) -> None:
        self.mission["mission"] = printable(token.groups[0] or "")

    def _log_number(self, token: Token) -> None:
        if _NUMBER.fullmatch(token.groups[0] or ""):
            self.mission["mission_number"] = printable(token.groups[0] or "")

    def _time(self, token: Token) -> None:
        when = moment(token.groups)
        now = self._draft(token, "time")
        if when is None:
            self.counts["garbled line"] += 1
            return
        now.slots |= {"time": when, "mission_time": number(token.groups[7])}
        self.clock_holds = True

    def _dr(self, token: Token) -> None:
        self._position(token, "dead_reckoned")

    def _gps(self, token: Token) -> None:
        self._position(token, _KINDS[token.groups[0] or ""])

    def _position(self, token: Token, kind: str) -> None:
        now = self._last()
        if self.open and now is not None and now.seen.get(kind) == token.groups:
            return
        now = self._draft(token, kind)
        _, latitude, longitude, printed = token.groups
        age = number(printed)
        if abs(number(latitude)) >= UNSET or abs(number(longitude)) >= UNSET or age >= NEVER:
            return
        where = place(latitude or "", longitude or "")
        if where is None or not known_age(age):
            self.counts["impossible value"] += 1
            return
        now.positions[kind] = (*where, age)

    def _sensor(self, token: Token) -> None:
        now = self._last()
        if not self.open or now is None:
            now = self._draft(token, "sensors")
        name, unit, value, age = token.groups[0] or "", token.groups[1] or "", *map(number, token.groups[2:])
        if not math.isfinite(value) or math.isnan(age):
            self.counts["impossible value"] += math.isnan(age)
        elif abs(value) == UNSET or abs(value) >= NEVER:
            now.defaults.pop(name, None)
        elif not right_unit(name, unit) or math.isnan(to_si(value, unit)[0]):
            self.counts["impossible value"] += 1
        elif age >= NEVER:
            now.defaults[name] = (value, printable(unit))
        elif known_age(age):
            now.sensors[name] = (value, printable(unit), age)
        else:
            self.counts["impossible value"] += 1

    def _report(self, token: Token) -> None:
        now = self._last()
        clock, name, value, unit = (
            token.groups[0],
            token.groups[1] or "",
            number(token.groups[2]),
            token.groups[3] or "",
        )
        if (
            now is None
            or not self.clock_holds
            or not math.isfinite(value)
            or abs(value) == UNSET
            or not right_unit(name, unit)
        ):
            return
        later = number(clock) - now.slots.get("mission_time", math.nan)
        if -1.0 <= later <= LONGEST_REPORT:
            now.reports.append((max(0.0, later), name, value, printable(unit)))

    def _waypoint(self, token: Token) -> None:
        now = self._last()
        latitude, longitude, distance, unit, bearing, hours, minutes = token.groups
        where = place(latitude or "", longitude or "")
        if now is None or where is None:
            return
        way = number(distance) * (1000.0 if unit == "km" else 1.0)
        age = number(hours) * 3600.0 + number(minutes) * 60.0
        now.slots["waypoint"] = (*where, way, math.radians(number(bearing)), age)

    def _abort(self, token: Token) -> None:
        if now := self._last():
            now.aborts[token.groups[0] or ""] = token.groups[1] or ""

    def _devices(self, token: Token) -> None:
        if now := self._last():
            n = [int(g or 0) for g in token.groups]
            now.slots["devices"] = DeviceCounts((n[0], n[1], n[2]), (n[3], n[4], n[5]), (n[6], n[7], n[8]))

    def _water(self, token: Token) -> None:
        if now := self._last():
            now.slots["water_complete"] = token.groups[0] is None

    def _postfix(self, token: Token) -> None:
        if now := self._last():
            now.slots["water_complete"] = False

    def _resume_menu(self, token: Token) -> None:
        self._running(self._last(), "menu to resume the mission")

    def _resuming(self, token: Token) -> None:
        now = self._last()
        self._running(now, "mission resumed")
        if now is not None:
            now.slots["resumed"] = True
        self.open = False

    def _diving(self, token: Token) -> None:
        now = self._last()
        self._running(now, "time until diving")
        if now is not None:
            now.slots["time_until_diving"] = number(token.groups[0])

    def _prompt(self, token: Token) -> None:
        system, letter, code = token.groups
        self.at_prompt, self.mission = f"Glider{system} prompt", {}
        if now := self._last():
            known = code is not None and letter == "A"
            now.judge(NOT_IN_MISSION, self.at_prompt, int(code or 0) if known else None)
            if system == "LAB":
                now.slots["lab_mode"] = True

    def _ended(self, token: Token) -> None:
        self.at_prompt, self.mission, self.clock_holds = "end of the mission", {}, False
        if now := self._last():
            now.judge(NOT_IN_MISSION, self.at_prompt)

    def _started(self, token: Token) -> None:
        self.mission, self.open, self.clock_holds = {}, False, False
        self._running(self._last(), "mission started")

    def _lab(self, token: Token) -> None:
        if now := self._last():
            now.slots["lab_mode"] = True

    def _error(self, token: Token) -> None:
        if now := self._last():
            now.errors.append(printable(f"SCI ERROR:{token.groups[0]}"))

    def _mark(self, token: Token) -> None:
        """A line that only shows that the dialog goes on."""
