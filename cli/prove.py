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
    set: Annotated[
        str | None, typer.Option(help="Only one set: null, single, pair, out, real, or real-proofs.")
    ] = None,
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
    real: Annotated[
        Path | None, typer.Option(help="Folder of real recordings, for the sets real and real-proofs.")
    ] = None,
    seal_only: Annotated[bool, typer.Option(help="Write the hashes of the truths and stop.")] = False,
    diagnosis: Annotated[str, typer.Option(help="module:function to score.", show_default=False)] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Print the scores as JSON.")] = False,
) -> None:
    """Conceal effects in simulated missions, diagnose them, and score what was named, with 95 % intervals.

    The SHA-256 of every truth is written to OUT/sealed.json before the first diagnosis. The truth is flown by a
    simulator that shares no physics with the diagnosis. The set real-proofs conceals nothing but what a base model of a
    real recording is not told, and sets the diagnosis beside independent numbers; without --real it runs the bundled
    recording alone.
    """
    import json
    import os

    if jobs > 1:
        # Processes that share the cores must not each keep threads of linear algebra spinning on all of them.
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
            os.environ.setdefault(name, "1")
    from glider_jax.diagnosis.proof import protocol
    from glider_jax.diagnosis.proof.metrics import table

    def said(text: str) -> None:
        typer.echo(text, err=True)

    if set == "real-proofs":
        _real_proofs(out, real, as_json, said)
        return
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


def _real_proofs(out: Path, real: Path | None, as_json: bool, said) -> None:
    """Real recordings with an effect concealed; exit code 1 where a line of the table does not hold."""
    import json

    from glider_jax.diagnosis.proof import real_report

    results = real_report.run(out, real, said)
    if as_json:
        typer.echo(json.dumps(results))
    else:
        typer.echo((out / "table.md").read_text(encoding="utf-8"))
    for line in results["left_out"]:
        said(f"left out: {line}")
    said(f"{results['holding']} lines hold, {results['failing']} do not; {sum(results['seconds'].values()):.0f} s")
    if results["failing"]:
        raise typer.Exit(1)
