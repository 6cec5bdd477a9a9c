"""Speed distributions: fitted from recordings, written to and read from JSON. NumPy only, no JAX.

A distribution says how fast a glider went in a dive segment (submerge to resurface) at one pitch, as quantiles:
``speeds`` at ``probabilities``, linear between. There are two kinds. ``over_ground`` is the distance between the fixes
around a dive over the time between them, so currents are in its spread; ``through_water`` is the length of the way
through the water by dead reckoning over the time under water. Never add currents to the first kind.

Segments weigh by their duration. The mean of draws that each last the same time is then total distance over total
time, which is what a glider that surfaces by the clock does; draws that each last the same distance (a yo between
given depths) have the lower harmonic mean.

File format, version 1::

    {"format": "glider_jax speed distribution", "version": 1, "distributions": [
      {"pitch_deg": 26.0, "kind": "over_ground", "speeds": [m/s, ascending], "probabilities": [0 ... 1, ascending],
       "segments": N, "distance_m": total, "duration_s": total, "source": "...",
       "speeds_sd": [m/s, 1-sigma of sampling, or null], "mean_per_time": m/s, "mean_per_distance": m/s,
       "assumption": "..."}]}

``speeds_sd``, the means and ``assumption`` may be absent.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.errors import ConfigError, DataError, did_you_mean
from glider_jax.readers.segments import Segment, dive_segments
from glider_jax.records import Array, Recording

FORMAT = "glider_jax speed distribution"
VERSION = 1
KINDS = ("over_ground", "through_water")
#: 65 nodes, closer together at both ends where quantiles bend most.
PROBABILITIES = (1.0 - np.cos(np.linspace(0.0, np.pi, 65))) / 2.0
#: s; shorter segments are tests at the start of a mission.
SHORTEST_SEGMENT = 600.0
_RESAMPLES = 400


@dataclass(frozen=True)
class SpeedDistribution:
    """How fast a glider goes at one pitch.

    Parameters
    ----------
    pitch : rad, magnitude.
    kind : ``over_ground`` or ``through_water``.
    speeds : (node,) m s-1, ascending, at ``probabilities`` (node,) from 0 to 1, linear between.
    speeds_sd : (node,) m s-1, 1-sigma of sampling from so few segments, or None.
    segments, distance, duration : how many, how far in m and how long in s they were together.
    source, assumption : where the numbers come from, and what was assumed.
    """

    pitch: float
    kind: str
    speeds: Array
    probabilities: Array
    segments: int
    distance: float
    duration: float
    source: str = ""
    assumption: str = ""
    speeds_sd: Array | None = None

    @property
    def mean_per_time(self) -> float:
        """Mean speed, m s-1, of draws that each last the same time."""
        middle = 0.5 * (self.speeds[1:] + self.speeds[:-1])
        return float(np.sum(np.diff(self.probabilities) * middle))

    @property
    def mean_per_distance(self) -> float:
        """Mean speed, m s-1, of draws that each last the same distance."""
        low, high = self.speeds[:-1], self.speeds[1:]
        step = high - low
        close = step < 1e-9 * high
        with np.errstate(divide="ignore", invalid="ignore"):
            slowness = np.where(close, 2.0 / (low + high), np.log(high / low) / np.where(close, 1.0, step))
        return float(1.0 / np.sum(np.diff(self.probabilities) * slowness))

    def quantile(self, probability: Array) -> Array:
        """Speeds, m s-1, at probabilities between 0 and 1."""
        return np.interp(probability, self.probabilities, self.speeds)


@dataclass(frozen=True)
class SegmentSpeed:
    """What one dive segment adds: pitch in rad, speeds in m s-1 (NaN where unknown), distances in m, times in s."""

    recording: str
    start: float
    pitch: float
    over_ground: float
    through_water: float
    distance: float
    path_length: float
    duration: float
    under_water: float


@dataclass(frozen=True)
class Selection:
    """Segments that can be used, and how many could not, by reason."""

    segments: tuple[SegmentSpeed, ...]
    excluded: dict[str, int] = field(default_factory=dict)


def select_segments(recordings: Iterable[Recording], *, shortest: float = SHORTEST_SEGMENT) -> Selection:
    """Dive segments from which a speed can be taken.

    Left out, and counted: segments with a gap in the recording, with a surfacing that got no fix, shorter than
    ``shortest`` seconds, or without a pitch.
    """
    used: list[SegmentSpeed] = []
    excluded: dict[str, int] = {}
    for recording in recordings:
        for segment in dive_segments(recording):
            reason = _unusable(segment, shortest)
            if reason:
                excluded[reason] = excluded.get(reason, 0) + 1
            else:
                used.append(_speed(recording.name, segment))
    return Selection(tuple(used), excluded)


def _pitch(segment: Segment) -> float:
    """Mean magnitude of the pitches of dives and climbs, rad."""
    both = np.abs([segment.dive_pitch, segment.climb_pitch])
    both = both[np.isfinite(both)]
    return float(both.mean()) if both.size else np.nan


def _unusable(segment: Segment, shortest: float) -> str:
    if segment.gap:
        return "a gap in the recording"
    if segment.dives > 1:
        return "a surfacing without a fix"
    if segment.duration < shortest:
        return f"shorter than {shortest:g} s"
    return "" if np.isfinite(_pitch(segment)) else "no pitch recorded"


def _speed(name: str, segment: Segment) -> SegmentSpeed:
    lapse = segment.end_time - segment.start_time
    return SegmentSpeed(
        recording=name,
        start=segment.start_time,
        pitch=_pitch(segment),
        over_ground=segment.distance / lapse,
        through_water=segment.path_length / segment.duration,
        distance=segment.distance,
        path_length=segment.path_length,
        duration=lapse,
        under_water=segment.duration,
    )


def fit_speeds(
    recordings: Iterable[Recording] | Selection, *, shortest: float = SHORTEST_SEGMENT, seed: int = 0
) -> tuple[SpeedDistribution, ...]:
    """Speed distributions of recordings, one per nearest degree of pitch and kind.

    Parameters
    ----------
    recordings : recordings, or a selection of their segments already made.
    shortest : s, segments under water for less are left out.
    seed : of the resampling that gives the sampling uncertainty.

    Raises
    ------
    DataError : no segment can be used.
    """
    chosen = recordings if isinstance(recordings, Selection) else select_segments(recordings, shortest=shortest)
    if not chosen.segments:
        why = ", ".join(f"{n} with {reason}" for reason, n in chosen.excluded.items()) or "no dive between two fixes"
        raise DataError(
            f"recordings: expected dive segments with fixes on both sides, found none that can be used ({why}). "
            "Give recordings with GPS fixes, depth and pitch."
        )
    degrees = np.array([round(np.degrees(s.pitch)) for s in chosen.segments])
    random = np.random.default_rng(seed)
    fitted = []
    for pitch in np.unique(degrees):
        mine = [s for s, d in zip(chosen.segments, degrees, strict=True) if d == pitch]
        names = ", ".join(dict.fromkeys(s.recording for s in mine))
        for kind in KINDS:
            ground = kind == "over_ground"
            rows = [
                (s.over_ground, s.duration, s.distance) if ground else (s.through_water, s.under_water, s.path_length)
                for s in mine
            ]
            values = np.array([r for r in rows if np.isfinite(r[0]) and r[0] > 0.0])
            if values.size:
                fitted.append(_distribution(float(pitch), kind, values, f"fitted from {names}", random))
    if not fitted:
        raise DataError(
            "recordings: expected dive segments with a displacement, found none that moved. "
            "Give recordings whose GPS fixes differ."
        )
    return tuple(fitted)


def _distribution(
    pitch_deg: float, kind: str, values: Array, source: str, random: np.random.Generator
) -> SpeedDistribution:
    """One distribution from rows of (speed, duration, distance)."""
    speeds, durations, distances = values.T
    mean = float(np.sum(distances) / np.sum(durations))
    table = weighted_quantiles(speeds, durations, mean)
    spread = None
    if speeds.size > 1:
        draws = random.integers(0, speeds.size, (_RESAMPLES, speeds.size))
        again = [weighted_quantiles(speeds[d], durations[d]) for d in draws]
        spread = np.std(again, axis=0)
    return SpeedDistribution(
        pitch=float(np.radians(pitch_deg)),
        kind=kind,
        speeds=table,
        probabilities=PROBABILITIES,
        segments=int(speeds.size),
        distance=float(np.sum(distances)),
        duration=float(np.sum(durations)),
        source=source,
        assumption="Segments weigh by duration and are taken as independent for speeds_sd.",
        speeds_sd=spread,
    )


def weighted_quantiles(speeds: Array, weights: Array, mean: float | None = None) -> Array:
    """Quantiles at ``PROBABILITIES`` of weighted values, linear between the middles of their shares.

    With ``mean`` the table is scaled so that its own mean is that; the scale stays within a few per cent of 1.
    """
    order = np.argsort(speeds)
    share = weights[order] / np.sum(weights)
    table = np.interp(PROBABILITIES, np.cumsum(share) - 0.5 * share, speeds[order])
    if mean is None:
        return table
    own = float(np.sum(np.diff(PROBABILITIES) * 0.5 * (table[1:] + table[:-1])))
    return table * (mean / own)


def nearest(distributions: Sequence[SpeedDistribution], pitch: float, kind: str) -> SpeedDistribution:
    """The distribution of a kind whose pitch (rad, sign ignored) is nearest.

    Raises
    ------
    ConfigError : the kind is unknown, or none of that kind is there.
    """
    if kind not in KINDS:
        raise ConfigError(f"speeds: expected the kind {' or '.join(KINDS)}, found '{kind}'.{did_you_mean(kind, KINDS)}")
    mine = [d for d in distributions if d.kind == kind]
    if not mine:
        raise ConfigError(f"speeds: expected a distribution of kind {kind}, found none. Choose the other kind.")
    return min(mine, key=lambda d: abs(d.pitch - abs(pitch)))


def write_speeds(path: Path | str, distributions: Sequence[SpeedDistribution]) -> Path:
    """Write distributions to a JSON file, whole or not at all."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(to_json(distributions), indent=1, allow_nan=False) + "\n"
    handle, partial = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        os.replace(partial, path)
    except OSError as problem:
        Path(partial).unlink(missing_ok=True)
        raise DataError(
            f"{path}: expected a place to write to, found that it cannot be written ({problem})."
        ) from problem
    return path


def to_json(distributions: Sequence[SpeedDistribution]) -> dict[str, Any]:
    """The content of a file, with units in its names."""
    listed = []
    for one in distributions:
        listed.append(
            {
                "pitch_deg": round(float(np.degrees(one.pitch)), 6),
                "kind": one.kind,
                "speeds": [float(v) for v in one.speeds],
                "probabilities": [float(p) for p in one.probabilities],
                "segments": one.segments,
                "distance_m": one.distance,
                "duration_s": one.duration,
                "mean_per_time": one.mean_per_time,
                "mean_per_distance": one.mean_per_distance,
                "speeds_sd": None if one.speeds_sd is None else [float(v) for v in one.speeds_sd],
                "source": one.source,
                "assumption": one.assumption,
            }
        )
    return {"format": FORMAT, "version": VERSION, "distributions": listed}


def bundled_speeds(name: str = "paper2010") -> tuple[SpeedDistribution, ...]:
    """Distributions that come with the package, by name.

    Raises
    ------
    ConfigError : there are none of that name.
    """
    folder = resources.files("glider_jax_data").joinpath("speeds")
    names = sorted(entry.name.removesuffix(".json") for entry in folder.iterdir() if entry.name.endswith(".json"))
    if name not in names:
        raise ConfigError(
            f"speeds: expected one of the bundled distributions {', '.join(names)}, found '{name}'."
            f"{did_you_mean(name, names)} Or name a file."
        )
    with resources.as_file(folder.joinpath(f"{name}.json")) as path:
        return read_speeds(path)


def read_speeds(path: Path | str) -> tuple[SpeedDistribution, ...]:
    """Read and check a file of speed distributions.

    Raises
    ------
    DataError : the file is not there, is no such file, or a distribution in it is not one.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise DataError(
            f"{path}: expected a speed distribution, found no readable file ({problem.strerror})."
        ) from problem
    except ValueError as problem:
        raise DataError(
            f"{path}: expected JSON, found something else ({problem}). Write it with speeds fit."
        ) from problem
    if not isinstance(content, dict) or content.get("format") != FORMAT or content.get("version") != VERSION:
        found = (
            f"{content.get('format')!r} version {content.get('version')!r}" if isinstance(content, dict) else "a list"
        )
        raise DataError(f"{path}: expected '{FORMAT}' version {VERSION}, found {found}. Write it with speeds fit.")
    listed = content.get("distributions")
    if not isinstance(listed, list) or not listed:
        raise DataError(f"{path}: expected a list 'distributions' with at least one entry, found {listed!r}.")
    return tuple(_checked(f"{path}: distribution {i}", entry) for i, entry in enumerate(listed))


def _checked(where: str, entry: Any) -> SpeedDistribution:
    """One distribution of a file, with every number looked at."""
    needed = ("pitch_deg", "kind", "speeds", "probabilities", "segments", "distance_m", "duration_s")
    if not isinstance(entry, dict):
        raise DataError(f"{where}: expected an object, found {type(entry).__name__}.")
    for name in needed:
        if name not in entry:
            raise DataError(f"{where}: expected '{name}', found none.{did_you_mean(name, map(str, entry))}")
    if entry["kind"] not in KINDS:
        near = did_you_mean(str(entry["kind"]), KINDS)
        raise DataError(f"{where}: expected the kind {' or '.join(KINDS)}, found '{entry['kind']}'.{near}")
    speeds = _numbers(where, "speeds", entry["speeds"])
    probabilities = _numbers(where, "probabilities", entry["probabilities"])
    if speeds.size != probabilities.size or speeds.size < 2:
        raise DataError(
            f"{where}: expected as many speeds as probabilities, at least 2, found {speeds.size} "
            f"and {probabilities.size}."
        )
    if np.any(np.diff(probabilities) <= 0.0) or probabilities[0] != 0.0 or probabilities[-1] != 1.0:
        raise DataError(f"{where}: expected probabilities that ascend from 0 to 1, found {_ends(probabilities)}.")
    if np.any(np.diff(speeds) < 0.0) or speeds[0] <= 0.0 or speeds[-1] > 5.0:
        raise DataError(f"{where}: expected ascending speeds above 0 and below 5 m/s, found {_ends(speeds)}.")
    totals = ("pitch_deg", "segments", "distance_m", "duration_s")
    single = _numbers(where, ", ".join(totals), [entry[name] for name in totals])
    if not 0.0 < single[0] < 90.0 or np.any(single[1:] < 0.0):
        raise DataError(f"{where}: expected a pitch between 0 and 90 degrees and totals of 0 or more, found {single}.")
    spread = entry.get("speeds_sd")
    return SpeedDistribution(
        pitch=float(np.radians(single[0])),
        kind=str(entry["kind"]),
        speeds=speeds,
        probabilities=probabilities,
        segments=int(single[1]),
        distance=float(single[2]),
        duration=float(single[3]),
        source=str(entry.get("source", "")),
        assumption=str(entry.get("assumption", "")),
        speeds_sd=None if spread is None else _numbers(where, "speeds_sd", spread),
    )


def _numbers(where: str, name: str, values: Any) -> Array:
    """A list of finite numbers as an array."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    if array.ndim != 1 or not np.all(np.isfinite(array)):
        raise DataError(f"{where}: expected finite numbers in '{name}', found {str(values)[:60]}.")
    return array


def _ends(values: Array) -> str:
    return f"{values[0]:g} to {values[-1]:g}, {int(np.sum(np.diff(values) < 0))} steps back"
