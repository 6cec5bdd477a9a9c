"""One run over the real recordings: cases that can be read, a table, results as JSON, and figures.

Imports Matplotlib when figures are drawn. Cases whose recording is not there are named as left out.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax import __version__
from glider_jax.diagnosis.proof import real_cases
from glider_jax.diagnosis.proof.real_cases import Proof, Row


def run(out: Path, folder: Path | None = None, tell: Callable[[str], None] = lambda text: None) -> dict[str, Any]:
    """Prove on real recordings: write ``table.md``, ``results.json`` and figures below ``out``, return the results.

    Parameters
    ----------
    folder : with ``comet2019``, ``ru28_2017`` and ``osu684_2025``; None runs comet 2016 alone, which is bundled.
    """
    out.mkdir(parents=True, exist_ok=True)
    proofs: dict[str, Proof] = {}
    left_out = []
    plans: list[tuple[str, Callable[[], Proof]]] = [("comet2016", lambda: real_cases.comet2016(out, tell))]
    if folder is None:
        left_out = ["comet2019", "currents", "fin: give the folder of the recordings with --real"]
    else:
        plans.append(("comet2019", lambda: real_cases.comet2019(folder, out, tell)))
        plans.append(("currents", lambda: real_cases.currents(folder, out, tell)))
    for name, plan in plans:
        began = time.perf_counter()
        proofs[name] = plan()
        proofs[name].seconds = time.perf_counter() - began
    rows = [
        replace(row, holds=None if row.holds is None else bool(row.holds)) for p in proofs.values() for row in p.rows
    ]
    results = {
        "version": __version__, "rows": [asdict(row) for row in rows], "left_out": left_out,
        "seconds": {name: round(proof.seconds, 1) for name, proof in proofs.items()},
        "holding": sum(row.holds is True for row in rows), "failing": sum(row.holds is False for row in rows),
    }  # fmt: skip
    (out / "table.md").write_text(table(rows), encoding="utf-8")
    (out / "results.json").write_text(json.dumps(results, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    figures(out, proofs)
    return results


def table(rows: list[Row]) -> str:
    """The rows as a Markdown table."""
    marks = {True: "yes", False: "no", None: ""}
    lines = ["| case | what | the tool | known otherwise | holds |", "| --- | --- | --- | --- | --- |"]
    lines += [f"| {r.case} | {r.what} | {r.tool} | {r.known} | {marks[r.holds]} |" for r in rows]
    return "\n".join(lines) + "\n"


def figures(out: Path, proofs: dict[str, Proof]) -> None:
    """Held-out errors of comet 2016, loads of comet 2019, and later segments met with and without the flow."""
    from matplotlib.figure import Figure

    if "comet2016" in proofs:
        figure = Figure(figsize=(6.0, 2.6), layout="constrained")
        axis = figure.subplots()
        streams = proofs["comet2016"].contents["both"]["held_out"]["streams"]
        names = [n for n in ("vertical speed", "speed through water") if n in streams]
        _pairs(axis, names, [(streams[n]["before"]["rms"], streams[n]["after"]["rms"]) for n in names])
        axis.set_xlabel("held-out rms, cm/s")
        axis.set_title("Comet 2016: without and with the pitch scale", fontsize=9)
        figure.savefig(out / "comet2016.png", dpi=130)
    levels = proofs["comet2019"].drawn.get("levels", []) if "comet2019" in proofs else []
    if levels:
        figure = Figure(figsize=(6.0, 2.4), layout="constrained")
        axis = figure.subplots()
        for k, way in enumerate(("dives", "climbs")):
            heights = [level.get(f"hotel power, {way}", {"value": np.nan})["value"] for level in levels]
            axis.bar(np.arange(len(levels)) + 0.4 * k - 0.2, heights, 0.36, label=f"on {way}")
        axis.set_xticks(range(len(levels)), [f"mission {k + 1}" for k in range(len(levels))])
        axis.set_ylabel("W without pump")
        axis.legend(fontsize=8)
        figure.savefig(out / "comet2019.png", dpi=130)
    flows = proofs["currents"].drawn if "currents" in proofs else {}
    if flows:
        figure = Figure(figsize=(6.5, 1.1 + 0.34 * sum(len(f["later"]) for f in flows.values())), layout="constrained")
        axis = figure.subplots()
        labels, pairs = [], []
        for name, flow in flows.items():
            for row in flow["later"]:
                labels.append(f"{name}: {row['predicted']} after {row['fitted']}")
                pairs.append((row["before_m"], row["after_m"]))
        _pairs(axis, labels, pairs)
        axis.set_xlabel("median miss of later segments, m")
        axis.set_title("Currents kept from the tool: without and with the flow it found", fontsize=9)
        figure.savefig(out / "currents.png", dpi=130)


def _pairs(axis: Any, labels: list[str], pairs: list[tuple[float, float]]) -> None:
    """Before and after on one line each, the label at the left."""
    for k, (before, after) in enumerate(pairs):
        axis.plot([before, after], [k, k], color="0.7", lw=2, zorder=1)
        axis.plot(before, k, "o", color="#7570b3", zorder=2, label="before" if k == 0 else None)
        axis.plot(after, k, "o", color="#1b9e77", zorder=3, label="after" if k == 0 else None)
    axis.set_yticks(range(len(labels)), labels, fontsize=8)
    axis.set_ylim(len(labels) - 0.4, -0.6)
    axis.set_xlim(left=0.0)
    axis.legend(fontsize=8)
