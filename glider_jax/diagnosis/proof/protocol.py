"""The sealed run: truths hashed before anything is diagnosed, cases resumed where a run stopped, scores at the end.

Imports the proof's own modules; the diagnosis is named as ``module:function`` and called in worker processes with a
folder of files and a folder to write to, never with a truth. Order of a run: hash of the library's source, seed,
truths and their SHA-256 in ``sealed.json``, cases, diagnoses, hashes checked again, scores.
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
import json
import os
import secrets
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import glider_jax
from glider_jax.diagnosis.proof import cases as cases_
from glider_jax.diagnosis.proof import spikes
from glider_jax.diagnosis.proof.cases import CONFUSABLE, FURTHER, OUTSIDE, PUBLISHED, REGIONS, UNSEEN, Spec
from glider_jax.diagnosis.proof.metrics import STRONG, confusion, judge, strength, summary, table
from glider_jax.errors import ConfigError, did_you_mean

DIAGNOSIS = "glider_jax.diagnosis.run:diagnose"
SETS = ("null", "single", "pair", "out", "real")
SHARES = {"null": 0.25, "single": 0.45, "pair": 0.15, "out": 0.15}
WEAKEST, STRONGEST, SPIKED = 2.0, 40.0, 4.0
# Options a diagnosis may offer; an ablation it does not offer is refused, not ignored.
ABLATIONS: dict[str, dict[str, Any]] = {
    "independent-noise": {"noise": "independent"},
    "random-hold-out": {"hold_out": "random"},
    "one-stream": {"streams": ("vertical_speed",)},
    "no-priors": {"priors": False},
    "without-truth": {"exclude": ()},
}


def library_hash() -> str:
    """SHA-256 over the package's source: the version of the library that a run scores."""
    root = Path(glider_jax.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def draw_specs(count: int, seed: int, kind: str | None = None, further: bool = False) -> list[Spec]:
    """Draw what the cases of a run are, from the seed alone.

    Parameters
    ----------
    count : cases altogether; without ``kind`` parted among the sets as ``SHARES``.
    further : conceal effects of the library beyond the published list too.
    """
    if kind is not None and kind not in SETS:
        raise ConfigError(
            f"prove: unknown set '{kind}'.{did_you_mean(kind, SETS)} The sets are {', '.join(SETS)}."
        )
    rng = np.random.default_rng([seed, 3])
    counts = {kind: count} if kind else {k: round(count * s) for k, s in SHARES.items()}
    if kind is None:
        counts["single"] += count - sum(counts.values())
    known = list(PUBLISHED) + (list(FURTHER) if further else [])
    specs = []
    for name, size in counts.items():
        # Every effect comes once before any comes twice.
        order = [str(i) for _ in range(size // len(known) + 1) for i in rng.permutation(known)]
        outside = [str(i) for _ in range(size // len(OUTSIDE) + 1) for i in rng.permutation(list(OUTSIDE))]
        for i in range(size):
            if name == "null":
                ids: tuple[str, ...] = ()
            elif name == "single":
                ids = (order[i],)
            elif name == "pair":
                ids = CONFUSABLE[rng.integers(len(CONFUSABLE))] if i % 2 == 0 else _strangers(rng, known)
            else:
                ids = (outside[i],)
            allowed = [r for r in range(len(REGIONS)) if not set(ids) & set(UNSEEN.get(r, ()))]
            size_of = np.exp(rng.uniform(np.log(WEAKEST), np.log(STRONGEST), len(ids)))
            if name == "out":
                size_of = np.exp(rng.uniform(np.log(8.0), np.log(STRONGEST), len(ids)))
            effects = tuple((id, float(s)) for id, s in zip(ids, size_of, strict=True))
            region = int(rng.choice(allowed))
            specs.append(Spec(f"{name}{i + 1:03d}", name, effects, region, int(rng.integers(2**31))))
    return specs


def draw_spikes(count: int, seed: int, naturals: Mapping[str, Mapping]) -> list[dict]:
    """Truths of effects put into real recordings, each that can be seen once before any comes twice.

    Parameters
    ----------
    naturals : diagnosis of each untouched recording. An effect is put in where it would reach a ratio of 6 at a size
        that is still likely, and drawn log-uniform between ``SPIKED`` and that size, at most ``STRONGEST``.
    """
    rng = np.random.default_rng([seed, 5])
    known = []
    for recording, natural in naturals.items():
        for id in spikes.SIZES:
            unit = spikes.ratio(id, natural)
            if unit is not None and unit * spikes.LARGEST >= STRONG:
                known.append((recording, id, unit))
    if not known:
        raise ConfigError("prove: none of the real recordings shows any of the effects that can be put in.")
    order = [known[i] for _ in range(count // len(known) + 1) for i in rng.permutation(len(known))][:count]
    out = []
    for i, (recording, id, unit) in enumerate(order):
        low, high = np.log(SPIKED), np.log(min(STRONGEST, spikes.LARGEST * unit))
        wanted = float(np.exp(rng.uniform(low, high)))
        sign = 1.0 if id.startswith("energy.") else float(rng.choice([1.0, -1.0]))
        name = f"real{i + 1:03d}"
        out.append(spikes.truth_of(recording, id, sign * wanted / unit, name, wanted) | {"spec": None})
    return out


def _strangers(rng: np.random.Generator, known: Sequence[str]) -> tuple[str, str]:
    """Two effects of different parts of the physics."""
    while True:
        a, b = (str(i) for i in rng.choice(known, 2, replace=False))
        if a.split(".")[0] != b.split(".")[0]:
            return a, b


def seal(
    out: Path,
    count: int,
    seed: int | None,
    kind: str | None,
    further: bool = False,
    naturals: Callable[[], Mapping[str, Mapping]] | None = None,
) -> list[dict]:
    """Draw the truths of a run and publish their hashes; a run begun before is taken up as it was.

    ``naturals`` diagnoses the untouched real recordings, for the set ``real``.

    Returns the truths. ``sealed.json`` holds hashes only; the truths lie in ``truths/``, which no diagnosis is given.

    Raises
    ------
    ConfigError : the folder holds a run with other settings, or a truth was changed after it was sealed.
    """
    path = out / "sealed.json"
    asked = {"cases": count, "set": kind or "all", "further": further}
    if path.exists():
        sealed = json.loads(path.read_text(encoding="utf-8"))
        if {k: sealed[k] for k in asked} != asked or (seed is not None and seed != sealed["seed"]):
            raise ConfigError(
                f"{path}: expected the run asked for, found one with other settings. Choose another --out."
            )
        return [_open(out, name, digest) for name, digest in sealed["truths"].items()]
    library = library_hash()
    chosen = secrets.randbelow(2**31) if seed is None else seed
    if kind == "real":
        if naturals is None:
            raise ConfigError("prove: the set 'real' needs --real, the folder of the real recordings.")
        drawn = draw_spikes(count, chosen, naturals())
    else:
        specs = draw_specs(count, chosen, kind, further)
        drawn = [cases_.draw_truth(spec) | {"spec": asdict(spec)} for spec in specs]
    (out / "truths").mkdir(parents=True, exist_ok=True)
    truths, hashes = [], {}
    for truth in drawn:
        name = truth["name"]
        text = cases_.dump(truth)
        (out / "truths" / f"{name}.json").write_text(text, encoding="utf-8")
        hashes[name] = hashlib.sha256(text.encode()).hexdigest()
        truths.append(json.loads(text))
    together = hashlib.sha256("".join(hashes.values()).encode()).hexdigest()
    sealed = asked | {
        "version": glider_jax.__version__,
        "library_sha256": library,
        "seed": chosen,
        "seed_drawn": seed is None,
        "truths_sha256": together,
        "truths": hashes,
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    path.write_text(json.dumps(sealed, indent=1), encoding="utf-8")
    return truths


def _open(out: Path, name: str, digest: str) -> dict:
    text = (out / "truths" / f"{name}.json").read_text(encoding="utf-8")
    found = hashlib.sha256(text.encode()).hexdigest()
    if found != digest:
        raise ConfigError(
            f"{out / 'truths' / name}.json: expected the sealed SHA-256 {digest[:12]}…, found {found[:12]}…. "
            "The truth was changed after it was sealed: begin another run."
        )
    return json.loads(text)


def load_diagnosis(name: str) -> Callable[..., Mapping]:
    """Find the function that diagnoses, named ``module:function``."""
    module, _, function = name.partition(":")
    try:
        found = getattr(importlib.import_module(module), function or "diagnose", None)
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"prove: expected a diagnosis at '{name}', found no module '{error.name}'."
        ) from error
    if found is None:
        raise ConfigError(f"prove: expected a function '{function}' in '{module}', found none.")
    return found


def options_of(diagnose: Callable, ablation: str | None, truth: Mapping) -> dict[str, Any]:
    """Keyword arguments of an ablation; refuses those the diagnosis does not offer."""
    if ablation is None:
        return {}
    if ablation not in ABLATIONS:
        raise ConfigError(f"prove: unknown ablation '{ablation}'.{did_you_mean(ablation, ABLATIONS)}")
    options = dict(ABLATIONS[ablation])
    if "exclude" in options:
        known = set(cases_.grouped(truth["effects"])) - set(OUTSIDE)
        options["exclude"] = tuple(sorted(known))
    missing = [name for name in options if not accepts(diagnose, name)]
    if missing:
        raise ConfigError(
            f"prove: ablation '{ablation}' needs the option '{missing[0]}', which the diagnosis lacks."
        )
    return options


def accepts(function: Callable, name: str) -> bool:
    """Whether a function takes a keyword argument."""
    parameters = inspect.signature(function).parameters
    return name in parameters or any(p.kind is p.VAR_KEYWORD for p in parameters.values())


def interleaved(truths: Sequence[Mapping]) -> list[Mapping]:
    """Truths in an order in which every set advances alike, so that a run that was stopped is a fair part of it."""
    sizes = {kind: sum(t["kind"] == kind for t in truths) for kind in SETS}
    seen = dict.fromkeys(SETS, 0)
    placed = []
    for truth in truths:
        placed.append(((seen[truth["kind"]] + 0.5) / sizes[truth["kind"]], truth))
        seen[truth["kind"]] += 1
    return [truth for _, truth in sorted(placed, key=lambda pair: pair[0])]


def run_case(out: Path, truth: Mapping, settings: Mapping[str, Any]) -> dict:
    """Write one case, diagnose it and score it; called in a worker. The result is written to ``results/``.

    ``settings``: ``diagnosis``, ``ablation``, ``oracle``, ``keep`` and ``real`` of :func:`prove`.
    """
    diagnose = load_diagnosis(settings["diagnosis"])
    name = truth["name"]
    folder = out / "cases" / name
    if not (folder / "recording.nc").exists():
        if truth["kind"] == "real":
            spikes.write_spiked(folder, settings["real"], truth)
        else:
            spec = truth["spec"]
            effects = tuple((id, strength) for id, strength in spec["effects"])
            cases_.write_case(
                folder, Spec(spec["name"], spec["kind"], effects, spec["region"], spec["seed"]), truth
            )
    plain = {"report": False} if accepts(diagnose, "report") else {}  # figures take time and are not scored
    options = plain | options_of(diagnose, settings["ablation"], truth)
    began = time.perf_counter()
    found = diagnose(folder, out / "diagnosed" / name, **options)
    seconds = time.perf_counter() - began
    best = None
    ids = tuple(sorted(cases_.grouped(truth["effects"])))
    wanted = settings["oracle"] and ids and truth["kind"] in ("single", "pair") and strength(truth) >= STRONG
    if wanted and accepts(diagnose, "only"):
        best = diagnose(folder, out / "diagnosed" / f"{name}_oracle", only=ids, **plain)
    before = spikes.stands_for(natural(out, truth["region"], settings)) if truth["kind"] == "real" else ()
    result = judge(truth, found, seconds, best, before)
    _write(out / "results" / f"{name}.json", result)
    if not settings["keep"]:
        shutil.rmtree(folder)
    return result


def natural(out: Path, recording: str, settings: Mapping[str, Any]) -> dict:
    """Diagnosis of a real recording without anything put in, made once per run; ``settings`` as :func:`run_case`."""
    kept = out / "natural" / f"{recording}.json"
    if not kept.exists():
        diagnose = load_diagnosis(settings["diagnosis"])
        folder = out / "cases" / f"natural_{recording}"
        spikes.write_plain(folder, settings["real"], recording)
        plain = {"report": False} if accepts(diagnose, "report") else {}
        _write(kept, diagnose(folder, out / "diagnosed" / f"natural_{recording}", **plain))
        shutil.rmtree(folder)
    return json.loads(kept.read_text(encoding="utf-8"))


def _bound(shares: Any, jobs: int) -> None:
    """Keep a worker to its share of the cores: threads of several that meet on all of them wait for each other."""
    k = shares.get()
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, cores[k % len(cores) :: jobs] or cores)


def _write(path: Path, value: Mapping) -> None:
    """Write JSON in one move, so that an interrupted run leaves no half file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(value, indent=1), encoding="utf-8")
    part.replace(path)


def prove(
    out: Path,
    count: int = 40,
    seed: int | None = None,
    kind: str | None = None,
    jobs: int = 1,
    diagnosis: str = DIAGNOSIS,
    ablation: str | None = None,
    oracle: bool = True,
    further: bool = False,
    keep: bool = False,
    real: Path | None = None,
    said: Callable[[str], None] = lambda text: None,
) -> dict[str, Any]:
    """Seal, diagnose and score a run; the scores, also written to ``scores.json`` and ``table.md``.

    Parameters
    ----------
    diagnosis : ``module:function`` called as ``function(case_folder, out_folder)``; returns a diagnosis mapping.
    ablation : one of ``ABLATIONS``, None for the diagnosis as it is.
    oracle : diagnose again with the true ids given, where the diagnosis takes ``only``, for the relative gain.
    keep : leave the cases' files.
    real : folder of real recordings, for the set ``real``.
    said : told of every case that is done.
    """
    load_diagnosis(diagnosis)
    out.mkdir(parents=True, exist_ok=True)
    settings = {"diagnosis": diagnosis, "ablation": ablation, "oracle": oracle, "keep": keep, "real": real}
    naturals = None if real is None else lambda: {one: natural(out, one, settings) for one in spikes.available(real)}
    truths = seal(out, count, seed, kind, further, naturals)
    left = [t for t in interleaved(truths) if not (out / "results" / f"{t['name']}.json").exists()]
    said(f"{len(truths)} truths sealed in {out / 'sealed.json'}, {len(left)} cases to diagnose")
    failures: dict[str, str] = {}
    done = len(truths) - len(left)

    def note(name: str, result: Mapping | None, error: BaseException | None) -> None:
        nonlocal done
        done += 1
        if error is not None:
            failures[name] = f"{type(error).__name__}: {error}"
            said(f"{done}/{len(truths)} {name}: failed, {failures[name]}")
        else:
            truth = ", ".join(result["truth"]) or "nothing"
            said(
                f"{done}/{len(truths)} {name}: concealed {truth}; named {', '.join(result['named']) or 'nothing'}"
            )

    if jobs <= 1:
        for truth in left:
            note(truth["name"], run_case(out, truth, settings), None)
    else:
        context = get_context("spawn")
        shares = context.SimpleQueue()
        for k in range(jobs):
            shares.put(k)
        with ProcessPoolExecutor(jobs, context, _bound, (shares, jobs)) as pool:
            tasks = {pool.submit(run_case, out, t, settings): t["name"] for t in left}
            for task in as_completed(tasks):
                error = task.exception()
                note(tasks[task], None if error else task.result(), error)
    results = []
    for truth in truths:
        path = out / "results" / f"{truth['name']}.json"
        if path.exists():
            _open(out, truth["name"], json.loads((out / "sealed.json").read_text())["truths"][truth["name"]])
            results.append(json.loads(path.read_text(encoding="utf-8")))
    scores = summary(results)
    sealed = json.loads((out / "sealed.json").read_text(encoding="utf-8"))
    run = {k: sealed[k] for k in ("version", "library_sha256", "seed", "truths_sha256", "written")}
    report = {"run": run | {"ablation": ablation}, "scores": scores, "confusion": confusion(results)}
    report["failures"] = failures
    (out / "scores.json").write_text(json.dumps(report, indent=1), encoding="utf-8")
    (out / "table.md").write_text(table(scores), encoding="utf-8")
    return report
