"""Scores of a diagnosis on concealed cases, with 95 % intervals and by strength.

Imports NumPy only. A result pairs a truth (see :func:`glider_jax.diagnosis.proof.cases.draw_truth`) with the mapping
of a ``diagnosis.json``; what is read from the latter is ``verdict``, ``effects`` (each ``id``, ``class`` or
``members``, ``alternatives``, ``parameters``) and ``held_out``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

BANDS = ((0.0, 3.0), (3.0, 6.0), (6.0, 12.0), (12.0, math.inf))
STRONG = 6.0  # signal-to-noise ratio from which the bars hold
UNSCORED = {"both_gauges", "scale", "onset", "period", "decay"}  # shapes, and what is no parameter of a term


def wilson(hits: int, count: int, z: float = 1.959964) -> tuple[float, float]:
    """Wilson's 95 % interval of a share; (0, 1) without cases."""
    if count == 0:
        return 0.0, 1.0
    p = hits / count
    centre = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(p * (1 - p) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    low = 0.0 if hits == 0 else max(centre - half, 0.0)
    high = 1.0 if hits == count else min(centre + half, 1.0)
    return low, high


def share(flags: Iterable[bool]) -> dict[str, float | int | None]:
    """Hits, cases, share and its interval."""
    values = list(flags)
    hits, count = sum(map(bool, values)), len(values)
    low, high = wilson(hits, count)
    return {"hits": hits, "cases": count, "share": hits / count if count else None, "low": low, "high": high}


def median(values: Iterable[float], seed: int = 5) -> dict[str, float | int | None]:
    """Median with a bootstrap 95 % interval and the tenth percentile."""
    x = np.array([v for v in values if np.isfinite(v)], dtype=float)
    if x.size == 0:
        return {"cases": 0, "median": None, "low": None, "high": None, "p10": None}
    rng = np.random.default_rng(seed)
    drawn = np.median(rng.choice(x, (2000, x.size)), axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return {
        "cases": int(x.size),
        "median": float(np.median(x)),
        "low": float(low),
        "high": float(high),
        "p10": float(np.quantile(x, 0.1)),
    }


def _ids(entries: Any) -> list[str]:
    """Ids of a list of ids or of mappings with ``id``."""
    if not isinstance(entries, Sequence) or isinstance(entries, str):
        return []
    return [one["id"] if isinstance(one, Mapping) else str(one) for one in entries]


def named(diagnosis: Mapping) -> list[str]:
    """Effects the diagnosis names, best first."""
    return _ids(diagnosis.get("effects", []))


def candidates(effect: Mapping) -> set[str]:
    """What a named effect stands for: itself, the members of its class and its stated alternatives."""
    group = effect.get("class")
    members = group.get("members", []) if isinstance(group, Mapping) else group
    return {
        effect["id"],
        *_ids(members),
        *_ids(effect.get("members", [])),
        *_ids(effect.get("alternatives", [])),
    }


def wanted(truth: Mapping) -> list[str]:
    """Ids a truth conceals, in no order."""
    return sorted({key.rsplit(".", 1)[0] for key in truth["effects"]})


def strength(truth: Mapping) -> float:
    """Signal-to-noise ratio of the weakest concealed effect; infinite where none has one.

    Of several effects each counts by what the others cannot stand in for.
    """
    values = [
        v for v in truth.get("unique", truth["strengths"]).values() if v is not None and math.isfinite(v)
    ]
    return min(values, default=math.inf)


def intervals(truth: Mapping, diagnosis: Mapping) -> list[bool]:
    """Whether each parameter of a rightly named effect lies in its stated 90 % interval."""
    out = []
    effects = {e["id"]: e for e in diagnosis.get("effects", []) if isinstance(e, Mapping)}
    for key, value in truth["effects"].items():
        id, name = key.rsplit(".", 1)
        if (
            id not in effects
            or name in UNSCORED
            or (id == "navigation.mean_current" and not truth["product"])
        ):
            continue
        found = _parameter(effects[id].get("parameters", {}), name)
        if found is not None:
            out.append(found[0] <= value <= found[1])
    return out


def _parameter(parameters: Any, name: str) -> tuple[float, float] | None:
    """Interval of a parameter from a mapping by name or a list of mappings with ``name``."""
    if isinstance(parameters, Mapping):
        one = parameters.get(name)
    else:
        one = next((p for p in parameters if p.get("name") == name), None)
    if not isinstance(one, Mapping):
        return None
    pair = one.get("interval") or one.get("interval_90") or (one.get("low"), one.get("high"))
    if pair is None or pair[0] is None or pair[1] is None:
        return None
    return float(pair[0]), float(pair[1])


def judge(
    truth: Mapping,
    diagnosis: Mapping,
    seconds: float,
    oracle: Mapping | None = None,
    natural: Collection[str] = (),
) -> dict[str, Any]:
    """One case scored: what was concealed, what was named, and every yes or no of it.

    ``natural`` are names that a recording has without what was concealed in it; they are neither right nor wrong.
    """
    real, found = wanted(truth), [id for id in named(diagnosis) if id not in natural]
    effects = [e for e in diagnosis.get("effects", []) if isinstance(e, Mapping) and e["id"] not in natural]
    stands_for = set().union(*(candidates(e) for e in effects)) if effects else set()
    first = candidates(effects[0]) if effects else set()
    verdict = diagnosis.get("verdict", "")
    flagged = verdict == "unexplained"
    return {
        "name": truth["name"],
        "kind": truth["kind"],
        "region": truth["region"],
        "truth": real,
        "strength": strength(truth) if math.isfinite(strength(truth)) else None,
        "named": found,
        "natural": sorted(set(named(diagnosis)) & set(natural)),
        "verdict": verdict,
        "alarm": bool(found),
        "flagged": flagged,
        # A real recording may hold what nobody can explain without anything put in.
        "detected": bool(found) or (flagged and truth["kind"] != "real"),
        "first_exact": bool(found) and found[0] in real,
        "first_class": bool(first & set(real)),
        "exact_set": sorted(found) == real,
        "all_found": set(real) <= set(found),
        "all_in_class": set(real) <= stands_for,
        "one_found": bool(set(real) & set(found)),
        "silent": bool(found) and not flagged,
        "covered": intervals(truth, diagnosis),
        "gain": gain(diagnosis, oracle),
        "seconds": seconds,
    }


def log_score(diagnosis: Mapping, when: str) -> float | None:
    """Held-out log score summed over streams, ``when`` before or after; None where the diagnosis gives none."""
    held = diagnosis.get("held_out")
    if not isinstance(held, Mapping):
        return None
    streams = held.get("streams", held)
    rows = streams.values() if isinstance(streams, Mapping) else streams
    total, seen = 0.0, False
    for row in rows:
        if not isinstance(row, Mapping):
            continue
        at = row.get(when)
        value = at.get("log_score") if isinstance(at, Mapping) else row.get(f"log_score_{when}")
        if value is not None and math.isfinite(value):
            total, seen = total + float(value), True
    return total if seen else None


def gain(diagnosis: Mapping, oracle: Mapping | None) -> float | None:
    """Share of the oracle's held-out improvement that the diagnosis reached; None where there is nothing to gain.

    Each is compared with its own base, since noise is estimated anew in each.
    """
    if oracle is None:
        return None
    scores = [log_score(one, when) for one in (diagnosis, oracle) for when in ("before", "after")]
    if any(s is None for s in scores) or not scores[3] - scores[2] > 2.0:
        return None
    return (scores[1] - scores[0]) / (scores[3] - scores[2])


def summary(results: Sequence[Mapping]) -> dict[str, Any]:
    """All scores: by set, and for singles and pairs by strength band."""
    by = {
        kind: [r for r in results if r["kind"] == kind] for kind in ("null", "single", "pair", "out", "real")
    }
    out: dict[str, Any] = {"cases": len(results)}
    if by["null"]:
        out["null"] = {
            "false alarm": share(r["alarm"] for r in by["null"]),
            "flagged unexplained": share(r["flagged"] for r in by["null"]),
        }
    for kind in ("single", "pair", "real"):
        if by[kind]:
            bands = {f"{a:g}-{b:g}": [r for r in by[kind] if a <= r["strength"] < b] for a, b in BANDS}
            bands[f">={STRONG:g}"] = [r for r in by[kind] if r["strength"] >= STRONG]
            out[kind] = {name: _shares(rows) for name, rows in bands.items() if rows}
    if by["out"]:
        out["out"] = {
            "flagged unexplained": share(r["flagged"] for r in by["out"]),
            "named and not flagged": share(r["silent"] for r in by["out"]),
            "nothing said": share(not r["detected"] for r in by["out"]),
        }
    strong = [r for r in by["single"] + by["pair"] if r["strength"] >= STRONG]
    out["coverage of 90 % intervals"] = share(c for r in strong for c in r["covered"])
    out["held-out gain over oracle's"] = median(r["gain"] for r in strong if r["gain"] is not None)
    out["minutes a case"] = median(r["seconds"] / 60.0 for r in results)
    return out


def _shares(rows: Sequence[Mapping]) -> dict[str, dict]:
    names = {
        "detected": "detected",
        "first pick right": "first_exact",
        "first pick right by class": "first_class",
        "exact set": "exact_set",
        "all found": "all_found",
        "all found by class": "all_in_class",
    }
    return {text: share(r[key] for r in rows) for text, key in names.items()}


def confusion(results: Sequence[Mapping]) -> dict[str, dict[str, int]]:
    """For singles: how often each id was first named as what; ``nothing`` where nothing was."""
    out: dict[str, dict[str, int]] = {}
    for r in results:
        if r["kind"] == "single":
            row = out.setdefault(r["truth"][0], {})
            first = r["named"][0] if r["named"] else "nothing"
            row[first] = row.get(first, 0) + 1
    return out


def table(scores: Mapping) -> str:
    """Scores as a Markdown table."""
    lines = ["| set | measure | result | 95 % interval |", "| --- | --- | --- | --- |"]

    def walk(path: str, value: Any, add: Callable[[str], None]) -> None:
        if not isinstance(value, Mapping):
            return
        if "hits" in value:
            set_, _, measure = path.rpartition(" / ")
            rate = "-" if value["share"] is None else f"{100 * value['share']:.0f} %"
            interval = f"{100 * value['low']:.0f} to {100 * value['high']:.0f} %"
            add(f"| {set_ or 'all'} | {measure} | {value['hits']}/{value['cases']} = {rate} | {interval} |")
        elif "median" in value:
            if value["median"] is not None:
                text = f"median {value['median']:.2f} (n={value['cases']}, p10 {value['p10']:.2f})"
                add(f"| all | {path} | {text} | {value['low']:.2f} to {value['high']:.2f} |")
        else:
            for key, inner in value.items():
                walk(f"{path} / {key}" if path else key, inner, add)

    walk("", scores, lines.append)
    return "\n".join(lines) + "\n"
