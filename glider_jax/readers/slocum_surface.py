"""Slocum ``surface`` behaviours -> rules of when to come up, and how long the glider stays.

Standard library only. ``start_when`` codes are those of the firmware; a code without counterpart is listed, not
dropped.
"""

from __future__ import annotations

from datetime import UTC, datetime

from glider_jax.config import SurfaceRule, Yo
from glider_jax.readers.slocum_files import Behavior

#: s from breaking the surface to the first good fix
TYPICAL_FIX = 60.0
#: s to dial, send and receive before the wait for the pilot begins
TYPICAL_CALL = 180.0
_USED = {
    "args_from_file", "start_when", "when_secs", "when_wpt_dist", "when_num_inflections", "end_action",
    "gps_wait_time", "keystroke_wait_time", "gps_postfix_wait_time", "c_use_pitch", "c_pitch_value",
    "when_utc_timestamp", "c_use_bpump", "c_bpump_value",
}  # fmt: skip
#: arguments that change neither path nor energy as simulated
_HARMLESS = {"report_all", "printout_cycle_time", "strobe_on", "c_stop_when_air_pump", "sensor_input_wait_time"}
_CODES = {
    1: "yo_done", 2: "yo_done", 3: "mission_done", 4: "yo_done", 6: "after", 7: "waypoint_distance", 8: "waypoint",
    9: "every", 10: "every", 11: "science", 12: "no_comms", 13: "utc", 16: "inflections",
}  # fmt: skip
#: which rule's stay stands for the mission: the one that acts most often
_PREFERENCE = ("every", "after", "yo_done", "inflections", "waypoint", "no_comms", "utc", "mission_done")


def surface_rules(
    behaviors: list[Behavior], yo: Yo, unsupported: list[str], notes: list[str]
) -> tuple[tuple[SurfaceRule, ...], float]:
    """Rules in the order of the file, and the stay at the surface in s.

    Parameters
    ----------
    behaviors : the ``surface`` behaviours with their arguments.
    yo : the yo of the mission, whose number of half cycles says whether it can end.
    unsupported, notes : lists that gain a sentence for each thing left out or assumed.

    Notes
    -----
    The stay is estimated: a typical minute to the first fix (less if ``gps_wait_time`` is less), the wait after the
    fix, three minutes of dialling and sending, and the whole ``keystroke_wait_time`` that the glider waits for a
    pilot. With waits of 300 s this is 600 s; comet stayed 753 s once in 2019, other gliders 420 to 690 s.
    """
    rules: list[SurfaceRule] = []
    stays: list[tuple[str, float]] = []
    for behavior in behaviors:
        rule = _rule(behavior, yo, unsupported, notes)
        rest = [n for n in behavior.arguments if n not in _USED and n not in _HARMLESS]
        rest = [n for n in rest if not (n.startswith("when_utc_") and rule is not None and rule.kind == "utc")]
        if rest:
            unsupported.append(f"surface ({behavior.where}): {', '.join(sorted(rest))}")
        if rule is not None:
            rules.append(rule)
            stays.append((rule.kind, surface_stay(behavior)))
    if not any(rule.kind == "mission_done" for rule in rules) and rules:
        rules.append(SurfaceRule("mission_done", ends_mission=True, name="end of mission"))
        notes.append("surface: no behavior for the end of the mission, it ends at the last waypoint")
    stay = _chosen_stay(stays)
    if stays:
        others = sorted({s for _, s in stays if s != stay})
        more = f"; other rules would give {', '.join(f'{s:g}' for s in others)} s" if others else ""
        notes.append(f"surface_stay: {stay:g} s estimated from the waits for GPS and for the pilot{more}")
    return tuple(rules), stay


def _chosen_stay(stays: list[tuple[str, float]]) -> float:
    """Stay of the rule that acts most often."""
    for kind in _PREFERENCE:
        for name, stay in stays:
            if name == kind:
                return stay
    return stays[0][1] if stays else 900.0


def surface_stay(behavior: Behavior) -> float:
    """Estimated time at the surface of one behaviour, s."""
    fix = min(TYPICAL_FIX, max(behavior.number("gps_wait_time", 300.0), 0.0))
    postfix = min(max(behavior.number("gps_postfix_wait_time", 60.0), 0.0), 600.0)
    pilot = min(max(behavior.number("keystroke_wait_time", 300.0), 0.0), 900.0)
    return fix + postfix + TYPICAL_CALL + pilot


def _rule(behavior: Behavior, yo: Yo, unsupported: list[str], notes: list[str]) -> SurfaceRule | None:
    code, where = behavior.code("start_when", 12), behavior.where
    if code == 5:
        notes.append(f"surface ({where}): start_when 5, never")
        return None
    kind = _CODES.get(code)
    if kind is None:
        unsupported.append(f"surface ({where}): start_when {code}")
        return None
    if kind == "yo_done" and yo.half_cycles is None:
        # A yo without end leaves the stack idle only when the waypoints are through.
        kind = "mission_done"
    seconds = behavior.number("when_secs", 1200.0)
    time = None
    if kind == "utc":
        time = _utc(behavior)
        if time is None:
            unsupported.append(f"surface ({where}): start_when 13 without a full date")
            return None
        if seconds < 0.0:
            notes.append(f"surface ({where}): when_secs {seconds:g}, any time after: taken as once")
        seconds = max(seconds, 0.0)
    elif kind in ("every", "after", "no_comms"):
        if seconds < 120.0:
            notes.append(f"surface ({where}): when_secs {seconds:g} raised to 120, the firmware's least")
            seconds = 120.0
    else:
        seconds = 0.0
    action = behavior.code("end_action", 1)
    if action == 3:
        unsupported.append(f"surface ({where}): end_action 3, drifting at the surface")
    count = behavior.code("when_num_inflections", -1) if kind == "inflections" else 0
    if kind == "inflections" and count < 1:
        notes.append(f"surface ({where}): when_num_inflections {count}, never")
        return None
    return SurfaceRule(
        kind=kind,
        seconds=seconds,
        time=time,
        count=count,
        distance=behavior.number("when_wpt_dist", 10.0) if kind == "waypoint_distance" else 0.0,
        when_yo_ends=code == 10,
        ends_mission=kind == "mission_done" or action in (0, 5),
        climb_pitch=_climb_pitch(behavior, notes),
        name=where,
    )


def _climb_pitch(behavior: Behavior, notes: list[str]) -> float | None:
    """Magnitude of the pitch of the ascent, None for the yo's own."""
    if behavior.code("c_use_pitch", 3) not in (2, 3):
        notes.append(f"surface ({behavior.where}): c_use_pitch commands no angle, the yo's is flown")
        return None
    return abs(behavior.number("c_pitch_value", 0.4538))


def _utc(behavior: Behavior) -> float | None:
    """Seconds since 1970 of ``when_utc_timestamp``, which is yymmddhhmm; None where it is no date."""
    value = behavior.number("when_utc_timestamp", -1.0)
    if not 1e8 <= value < 1e10 or value != int(value):
        return None
    text = f"{int(value):010d}"
    year, month, day, hour, minute = (int(text[i : i + 2]) for i in range(0, 10, 2))
    try:
        return datetime(2000 + year, month, day, hour, minute, tzinfo=UTC).timestamp()
    except ValueError:
        return None
