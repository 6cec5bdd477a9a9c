"""``glider-forecast prove``: the diagnosis scored on cases whose truth is sealed beforehand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def prove(
    out: Annotated[Path, typer.Option(help="Folder of the run; an unfinished run there is taken up again.")],
    cases: Annotated[int, typer.Option(min=1, help="Cases altogether.")] = 40,
    seed: Annotated[
        int | None, typer.Option(help="Seed of the truths; left out, it is drawn and told.")
    ] = None,
    set: Annotated[str | None, typer.Option(help="Only one set: null, single, pair, out or real.")] = None,
    jobs: Annotated[int, typer.Option(min=1, help="Cases diagnosed at the same time.")] = 1,
    further: Annotated[bool, typer.Option(help="Conceal effects beyond the published list too.")] = False,
    ablation: Annotated[
        str | None,
        typer.Option(help="independent-noise, random-hold-out, one-stream, no-priors or without-truth."),
    ] = None,
    oracle: Annotated[
        bool, typer.Option(help="Diagnose again with the truth given, for the relative gain.")
    ] = True,
    keep: Annotated[bool, typer.Option(help="Leave the files of the cases.")] = False,
    real: Annotated[Path | None, typer.Option(help="Folder of real recordings, for the set real.")] = None,
    seal_only: Annotated[bool, typer.Option(help="Write the hashes of the truths and stop.")] = False,
    diagnosis: Annotated[str, typer.Option(help="module:function to score.", show_default=False)] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print the scores as JSON.")] = False,
) -> None:
    """Conceal effects in simulated missions, diagnose them, and score what was named, with 95 % intervals.

    The SHA-256 of every truth is written to OUT/sealed.json before the first diagnosis. The truth is flown by a
    simulator that shares no physics with the diagnosis.
    """
    import json

    from glider_jax.diagnosis.proof import protocol
    from glider_jax.diagnosis.proof.metrics import table

    def said(text: str) -> None:
        typer.echo(text, err=True)

    if seal_only:
        protocol.seal(out, cases, seed, set, further, real)
        sealed = json.loads((out / "sealed.json").read_text(encoding="utf-8"))
        typer.echo(f"{len(sealed['truths'])} truths sealed, SHA-256 {sealed['truths_sha256']}")
        return
    report = protocol.prove(
        out,
        cases,
        seed,
        set,
        jobs,
        diagnosis or protocol.DIAGNOSIS,
        ablation,
        oracle,
        further,
        keep,
        real,
        said,
    )
    if as_json:
        typer.echo(json.dumps(report))
        return
    typer.echo(table(report["scores"]))
    run = report["run"]
    typer.echo(f"version {run['version']}, seed {run['seed']}, truths {run['truths_sha256'][:16]}…", err=True)
    for name, reason in report["failures"].items():
        typer.echo(f"{name} failed: {reason}", err=True)
    if report["failures"]:
        raise typer.Exit(1)
