"""The plain data of ``diagnosis.json``; ``docs/diagnosis.md`` says what every entry means.

Imports the physics' declarations. Numbers are SI in ``parameters[].value`` and in the shown unit beside it; nothing is
NaN: what is not known is null.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from glider_jax import __version__
from glider_jax.diagnosis import locate
from glider_jax.diagnosis.candidates import untestable
from glider_jax.diagnosis.confirm import confirmed
from glider_jax.diagnosis.quality import corrupt_legs, regime_changes
from glider_jax.diagnosis.twins import Twin, twins
from glider_jax.physics.library import CONFUSION_CLASSES, TERMS_BY_ID
from glider_jax.physics.term import declared

if TYPE_CHECKING:
    from glider_jax.diagnosis.run import Finding

FORMAT = "glider_jax diagnosis 1"
#: Half width of a 90 % interval in standard deviations, and the signal-to-noise ratio that is surely detected.
NINETY, SURE = 1.6449, 6.0
#: Times its typical size beyond which an effect is not likely: one that shows only there cannot be tested.
LIKELY = 5.0
#: Share of a fitted value by which the steady replay itself may be off; widens every interval.
REPLAY_ACCURACY = 0.015
#: prior units; a calibration further out says that the vehicle file does not fit this glider.
FAR = 4.0


def document(found: Finding) -> dict[str, Any]:
    """Turn a finding into the mapping that ``diagnosis.json`` holds."""
    effects = [_effect(found, k) for k in np.argsort([-x for x in found.search.losses()])] if found.search.picks else []
    unexplained = [_remainder(one) for one in found.remainders]
    named = {one["place"]["stream"] for one in unexplained}
    beaten = {id for one in unexplained for id in one["instead_of"]}
    for effect in effects:
        effect["doubted"] = effect["id"] in beaten
        shared = bool(named & set(effect["streams"]))
        effect["tentative"] = shared or effect["doubted"] or not effect["held_out"]["confirmed"]
    verdict = "unexplained" if unexplained else "explained" if effects else "nothing_missing"
    warnings = _vehicle_warnings(found) + _quality(found)
    return {
        "format": FORMAT,
        "version": __version__,
        "recording": {
            "name": found.recording.name,
            "files": found.recording.source.files,
            "start": float(found.recording.time[0]),
            "days": float((found.recording.time[-1] - found.recording.time[0]) / 86400.0),
            "dives": len(np.unique(found.search.linear.block)),
            "legs": len(found.gathered.ways),
        },
        "vehicle": {"name": found.vehicle.name, "files": found.vehicle.source.files},
        "verdict": verdict,
        "summary": summary_of(verdict, effects, unexplained, warnings),
        "warnings": warnings,
        "effects": effects,
        "unexplained": unexplained,
        "calibration": _calibration(found),
        "localisation": [_place(place) for place in _telling(found.before)],
        "streams": [_stream(found, name) for name in found.search.problem.names],
        "missing": list(found.gathered.missing),
        "notes": [*found.gathered.notes, *_lag(found)],
        "held_out": _held_out(found),
        "not_found": _not_found(found),
        "search": {"path": found.search.path, "candidates": len(found.search.candidates)},
        "settings": found.settings,
        "seconds": round(found.seconds, 2),
    }


def _telling(places: list[locate.Place]) -> list[locate.Place]:
    """Significant places, the one that explains most of each stream first, at most two of a stream."""
    ranked = sorted((p for p in places if p.significant), key=lambda p: -p.share * abs(p.z))
    kept: list[locate.Place] = []
    for place in ranked:
        if sum(p.stream == place.stream for p in kept) < 2:
            kept.append(place)
    return kept[:12]


def number(value: Any) -> float | None:
    """A finite float, or None."""
    value = float(value)
    return value if math.isfinite(value) else None


def _effect(found: Finding, k: int) -> dict[str, Any]:
    search = found.search
    pick = search.picks[k]
    id = pick.candidate.id
    info = TERMS_BY_ID[id].info
    alternatives = search.rivals(k)
    near = {a for a, _ in alternatives}
    groups = [(label, m) for label, m in CONFUSION_CLASSES.items() if id in m]
    unlikely = [one for one in twins(search, found.mean, k) if one.id not in near]
    members = [id, *(a for a, _ in alternatives), *(one.id for one in unlikely)]
    alike = next(((label, m) for label, m in groups if set(members[1:]) & set(m)), None)
    evidence = search.losses()[k]
    touched = sorted({
        search.problem.names[int(s)]
        for i in pick.variant.columns
        for s in np.unique(search.linear.stream[np.abs(search.linear.raw_columns[:, i]) > 1e-9])
    })  # fmt: skip
    gain, share = found.blocks.effects.get(id, (math.nan, math.nan))
    places = [p for p in found.before if p.stream in touched and p.p < 0.05]
    places.sort(key=lambda p: -p.share * abs(p.z))
    return {
        "id": id,
        "title": info.title,
        "plain": info.plain,
        "class": {
            "label": alike[0] if alike else info.title.lower(),
            "members": members,
            "twins": [_twin(one) for one in unlikely],
            "decided_by": info.decided_by,
        },
        "certain": not alternatives,
        "evidence": number(evidence),
        "parameters": _parameters(found, pick, id),
        "shapes": {name.rsplit(".", 1)[1]: number(value) for name, value in pick.variant.shapes.items()},
        "alternatives": [{"id": a, "title": TERMS_BY_ID[a].info.title, "behind": number(b)} for a, b in alternatives],
        "streams": touched,
        "located": locate.sentence(places[0]) if places else "",
        "held_out": {
            "gain": number(gain),
            "folds_gaining": number(share),
            "confirmed": confirmed(gain, share),
        },
        "equation": info.equation,
        "reference": info.reference,
    }


def _twin(one: Twin) -> dict[str, Any]:
    info = declared(TERMS_BY_ID[one.id])[one.parameter]
    return {
        "id": one.id, "title": TERMS_BY_ID[one.id].info.title, "behind": number(one.behind), "name": info.name,
        "value": number(one.value), "unit": info.unit, "times_typical": number(one.times),
        "shown": {"unit": info.shown, "value": number(one.value * info.shown_per_si)},
    }  # fmt: skip


def _parameters(found: Finding, pick: Any, id: str) -> list[dict[str, Any]]:
    search = found.search
    place = {column: n for n, column in enumerate(search.active)}
    entries = []
    for column in pick.variant.columns:
        label = search.linear.labels[column]
        unknown = search.problem.replay.unknowns[label.unknown]
        info = declared(TERMS_BY_ID[unknown.term])[unknown.name.rsplit(".", 1)[1]]
        value = unknown.centre + unknown.scale * found.mean[place[column]]
        sd = unknown.scale * math.sqrt(max(found.covariance[place[column], place[column]], 0.0))
        sd = math.hypot(sd, REPLAY_ACCURACY * value)
        low, high = value - NINETY * sd, value + NINETY * sd
        name = info.name if unknown.term == id else f"{unknown.term}.{info.name}"
        shown = info.shown_per_si
        entries.append({
            "name": name, "value": number(value), "sd": number(sd), "interval_90": [number(low), number(high)],
            "unit": info.unit, "shown": {"unit": info.shown, "value": number(value * shown),
                                         "interval_90": [number(low * shown), number(high * shown)]},
            "text": info.text,
        })  # fmt: skip
    return entries


def _calibration(found: Finding) -> list[dict[str, Any]]:
    search = found.search
    entries = []
    own = [search.linear.labels[column].unknown for column in search.active]
    replay = search.problem.replay
    for place, value, sd, away in zip(own, *replay.stated(own, found.mean, found.covariance), strict=True):
        unknown = replay.unknowns[place]
        if place < 0 or unknown.kind == "candidate":
            continue
        entries.append({
            "name": unknown.name, "kind": unknown.kind, "given": number(unknown.centre), "sigma": unknown.scale,
            "fitted": number(value), "sd": number(sd), "sigmas_away": number(away),
        })  # fmt: skip
    return entries


def _vehicle_warnings(found: Finding) -> list[str]:
    """Say first where the base model fits nowhere, before any effect is named."""
    said = []
    for entry in _calibration(found):
        if entry["kind"] == "calibration" and abs(entry["sigmas_away"] or 0.0) > FAR:
            said.append(
                f"The vehicle file gives {entry['name']} = {entry['given']:g} +- {entry['sigma']:g}; this recording "
                f"asks for {entry['fitted']:g}, {abs(entry['sigmas_away']):.0f} sigma away. Check that the file is "
                "this glider's."
            )
    stream = found.gathered.stream("vertical speed")
    if stream is not None and "vertical speed" in found.whitened:
        left = found.whitened["vertical speed"][0]
        if np.sqrt(np.mean(left**2)) > 0.05:
            said.append(
                f"The base model misses the vertical speed by {100.0 * np.sqrt(np.mean(left**2)):.1f} cm/s rms "
                "even after calibration: a wrong vehicle file is likelier than left-out physics. Check it first."
            )
    return said


def _quality(found: Finding) -> list[str]:
    """Too little data, and casts that were set aside."""
    said = []
    blocks = len(np.unique(found.search.linear.block))
    if blocks < 6:
        said.append(
            f"Only {blocks} dives between surfacings: effects that differ from dive to dive cannot be told from "
            "chance, and held-out checks mean little. Two days, or a dozen segments, are enough for most effects."
        )
    for noise in found.search.problem.noises:
        wild = int((noise.inflation > 4.0).sum())
        if wild > 0.02 * noise.inflation.size + 2:
            said.append(f"{wild} of {noise.inflation.size} values of {noise.names[0]} are far off and count little.")
    said += regime_changes(found.recording)
    if "vertical speed" in found.whitened:
        legs = corrupt_legs(found.gathered, found.whitened["vertical speed"][1])
        if 0 < len(legs) <= 0.1 * len(found.gathered.ways):
            worst = max(legs, key=lambda pair: abs(pair[1]))
            day = (found.gathered.ways[worst[0]].start_time - found.recording.time[0]) / 86400.0
            said.append(
                f"{len(legs)} half yos look corrupt, the worst on day {day:.2f} ({100.0 * worst[1]:+.1f} cm/s); they "
                "count for little."
            )
    return said


def _lag(found: Finding) -> list[str]:
    lag = found.gathered.rows.lag
    if abs(lag) < 0.05:
        return []
    return [f"The thermometer lags the conductivity cell by {lag:.1f} s; corrected, so that dives and climbs agree."]


def spoken(title: str) -> str:
    """A title within a sentence: abbreviations keep their capitals."""
    return title if title[1:2].isupper() or title[1:2].isdigit() else title[0].lower() + title[1:]


def size_in_words(effect: dict[str, Any]) -> str:
    """The size of an effect in brackets: one number with its interval, or a vector's size and direction."""
    shown = {p["name"]: p["shown"] for p in effect["parameters"]}
    if len(shown) == 1:
        one = next(iter(shown.values()))
        low, high = one["interval_90"]
        return f" ({one['value']:.3g} {one['unit']}, 90 % {low:.3g} to {high:.3g})"
    if {"east", "north"} <= set(shown):
        east, north, unit = shown["east"]["value"], shown["north"]["value"], shown["east"]["unit"]
        toward = math.degrees(math.atan2(east, north)) % 360.0
        return f" ({math.hypot(east, north):.3g} {unit} towards {toward:.0f} degrees)"
    if {"east_cosine", "north_sine"} <= set(shown):
        east = math.hypot(shown["east_cosine"]["value"], shown["east_sine"]["value"])
        north = math.hypot(shown["north_cosine"]["value"], shown["north_sine"]["value"])
        return f" (amplitude {east:.3g} {shown['east_sine']['unit']} east, {north:.3g} north)"
    if {"sine", "cosine"} <= set(shown):
        size = math.hypot(shown["sine"]["value"], shown["cosine"]["value"])
        return f" (amplitude {size:.3g} {shown['sine']['unit']})"
    return ""


def summary_of(verdict: str, effects: list, unexplained: list, warnings: list) -> str:
    if verdict == "nothing_missing":
        first = "The base model explains this recording within its stated uncertainties; nothing is missing."
    else:
        parts = []
        for effect in effects:
            value = size_in_words(effect)
            also = (
                f", or {', or '.join(spoken(a['title']) for a in effect['alternatives'])}"
                if effect["alternatives"]
                else ""
            )
            hedge = "perhaps " if effect.get("tentative") else ""
            if effect.get("doubted"):
                hedge = "something that looks like "
            parts.append(f"{hedge}{spoken(effect['title'])}{value}{also}")
        first = (
            f"Left out of the base model: {'; '.join(parts)}." if parts else "No known effect explains the mismatch."
        )
    if unexplained:
        where = "; ".join(one["sentence"] for one in unexplained)
        first += f" Structure without a name remains: {where}"
    return (" ".join(warnings[:1]) + " " + first).strip()


def _place(place: locate.Place) -> dict[str, Any]:
    return {
        "stream": place.stream, "covariate": place.covariate, "phase": place.phase, "p": number(place.p),
        "z": number(place.z), "low": number(place.low), "high": number(place.high), "unit": place.unit,
        "size": number(place.size), "size_unit": place.size_unit, "share": number(place.share),
        "sentence": locate.sentence(place),
    }  # fmt: skip


def _remainder(one: Any) -> dict[str, Any]:
    return {
        "place": _place(one.place), "sentence": locate.sentence(one.place), "rms": number(one.rms), "unit": one.unit,
        "held_out_gain": number(one.gain), "evidence": number(one.evidence), "instead_of": list(one.instead),
        "curve": {"unit": one.axis_unit, "at": [number(v) for v in one.axis], "value": [number(v) for v in one.curve],
                  "sd": [number(v) for v in one.sd]},
    }  # fmt: skip


def _stream(found: Finding, name: str) -> dict[str, Any]:
    stream = found.gathered.stream(name)
    noise = next(n for n in found.search.problem.noises if name in n.names)
    factor = stream.shown_per_unit
    before, after = found.whitened[name]
    sizes = {
        law.name: number(math.exp(size) * (1.0 if law.name.endswith("time") else factor))
        for law, size in zip(noise.laws, noise.sizes, strict=True)
    }
    return {
        "name": name, "unit": stream.shown, "n": stream.n, "rms_before": number(factor * np.sqrt(np.mean(before**2))),
        "rms_after": number(factor * np.sqrt(np.mean(after**2))), "noise": sizes,
        "onset": _onset(stream, before),
    }  # fmt: skip


def _onset(stream: Any, before: Any) -> dict[str, Any] | None:
    """Day on which the level of a residual changes most, where it surely does."""
    day, z = locate.onset(stream, before / max(float(np.std(before)), 1e-30))
    return {"day": number(day), "z": number(z)} if z > 6.0 else None


def _held_out(found: Finding) -> dict[str, Any]:
    def scores(one: Any) -> dict[str, Any]:
        return {
            s.stream: {
                "unit": s.unit, "n": s.n, "floor": number(s.floor),
                "before": {"rms": number(s.rms_before), "log_score": number(s.log_before)},
                "after": {"rms": number(s.rms_after), "log_score": number(s.log_after)},
            }
            for s in one.streams
        }  # fmt: skip

    blocks, last = found.blocks, found.last
    return {
        "streams": scores(blocks),
        "gain": number(blocks.gain), "z": number(blocks.z), "folds_gaining": number(blocks.share),
        "last_fifth": {"streams": scores(last), "gain": number(last.gain)},
        "figures": _figures(found),
    }  # fmt: skip


def _figures(found: Finding) -> dict[str, Any]:
    """Numbers a pilot asks for: surfacing error per segment and energy per day, before and after."""
    said: dict[str, Any] = {}
    pairs = [found.whitened.get(f"displacement {way}") for way in ("east", "north")]
    moved = found.gathered.stream("displacement east")
    if moved is not None and all(p is not None for p in pairs):
        for k, when in enumerate(("before", "after")):
            miss = np.hypot(pairs[0][k], pairs[1][k]) * moved.span
            said.setdefault("surfacing_error_m", {})[when] = number(np.median(miss))
    names = ("hotel power, dives", "hotel power, climbs", "surface power")
    days = (found.recording.time[-1] - found.recording.time[0]) / 86400.0
    for k, when in enumerate(("before", "after")):
        total = 0.0
        for name in ("pump out energy", "pump in energy"):
            if name in found.whitened:
                total += float(found.whitened[name][k].sum())
        for name in names:
            if name in found.whitened:
                stream = found.gathered.stream(name)
                total += float((found.whitened[name][k] * stream.span).sum())
        if any(name in found.whitened for name in (*names, "pump out energy")):
            said.setdefault("energy_error_j_per_day", {})[when] = number(total / max(days, 1e-9))
    return said


def _not_found(found: Finding) -> list[dict[str, Any]]:
    """Smallest size of every effect not named that would surely have been seen."""
    search = found.search
    taken = {pick.candidate.id for pick in search.picks}
    active = search.active
    base = search.linear.score(active)
    inner = np.linalg.inv(search.linear.gram[np.ix_(active, active)] + np.eye(len(active)))
    entries = []
    for candidate in search.candidates:
        if candidate.id in taken:
            continue
        gain, variant = search._gain(candidate, active, base)
        parameters = []
        for column in variant.columns:
            unknown = search.problem.replay.unknowns[search.linear.labels[column].unknown]
            cross = search.linear.gram[active, column]
            unique = search.linear.gram[column, column] - cross @ inner @ cross
            info = declared(TERMS_BY_ID[unknown.term])[unknown.name.rsplit(".", 1)[1]]
            size = SURE / math.sqrt(unique) * unknown.scale if unique > 1e-6 else math.inf
            parameters.append({
                "name": info.name, "minimum": number(size), "unit": info.unit,
                "shown": {"unit": info.shown, "minimum": number(size * info.shown_per_si)},
                "typical": info.prior.sd,
            })  # fmt: skip
        testable = any(p["minimum"] is not None and p["minimum"] < LIKELY * p["typical"] for p in parameters)
        entries.append({
            "id": candidate.id, "title": TERMS_BY_ID[candidate.id].info.title, "evidence": number(gain),
            "verdict": "not_supported" if testable else "not_testable", "minimum_detectable": parameters,
            "decided_by": TERMS_BY_ID[candidate.id].info.decided_by,
        })  # fmt: skip
    for id in untestable(found.gathered):
        info = TERMS_BY_ID[id].info
        entries.append({
            "id": id, "title": info.title, "evidence": None, "verdict": "not_testable", "minimum_detectable": [],
            "decided_by": info.decided_by,
        })  # fmt: skip
    return sorted(entries, key=lambda entry: -(entry["evidence"] or 0.0))
