"""``glider-forecast scores``: how good the frozen forecasts were, once their surfacings have come."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def scores(
    out: Annotated[Path, typer.Argument(help="Folder that 'next' wrote its forecasts to.")] = Path("next"),
    recording: Annotated[
        list[Path] | None, typer.Option(help="Recording that holds the surfacings; may be repeated.")
    ] = None,
    dialog: Annotated[
        list[Path] | None,
        typer.Option(help="Dialog log or gliderState.xml that holds them; may be repeated."),
    ] = None,
    cache: Annotated[Path | None, typer.Option(help="Folder of Slocum sensor lists (.cac).")] = None,
    glider: Annotated[
        str | None, typer.Option(help="Name of the glider, where dialogs hold several.")
    ] = None,
    variation_deg: Annotated[float | None, typer.Option(help="Magnetic variation, west positive.")] = None,
    json_: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """Score frozen forecasts against what came, and against persistence.

    Example: glider-forecast scores next --recording from-glider
    """
    import json
    import math

    from glider_jax.products import frozen
    from glider_jax.products.hindcast import plain_numbers
    from glider_jax.products.live_inputs import Options, gather

    forecasts, told = frozen.load(out)
    for text in told:
        print(text, file=sys.stderr)
    turn = None if variation_deg is None else math.radians(variation_deg)
    evidence = gather(
        Options(
            dialogs=tuple(dialog or ()),
            recordings=tuple(recording or ()),
            cache=cache,
            glider=glider,
            variation=turn,
            now=math.nan,
        )  # fmt: skip
    )
    rows = frozen.score_all(forecasts, evidence.situation.segments)
    table = plain_numbers(frozen.table(rows))
    if json_:
        print(json.dumps(plain_numbers({"forecasts": rows, "table": table}), allow_nan=False))
        return
    print("issued\terror_km\tpersistence_km\tinside50\tinside90\ttime_error_min")
    for row in rows:
        if row["waiting"]:
            print(f"{row['issued']}\tthe surfacing has not come, or is not in the files")
            continue
        past = "-" if row["persistence_km"] is None else f"{row['persistence_km']:.2f}"
        print(
            f"{row['issued']}\t{row['error_km']:.2f}\t{past}\t{row['inside50']}\t{row['inside90']}\t"
            f"{row['time_error_min']:+.1f}"
        )
    if table["scored"]:
        error, past = table["error_km"], table["persistence_km"]
        inside = table["region90"]
        print(f"\n{table['scored']} scored, {table['waiting']} waiting")
        print(f"error: median {error['median']:.2f} km, 90 % {error['p90']:.2f} km")
        if past["median"] is not None:
            print(f"persistence: median {past['median']:.2f} km, 90 % {past['p90']:.2f} km")
        low, high = inside["interval"]
        print(
            f"inside the 90 % region: {100 * inside['share']:.0f} % ({100 * low:.0f} to {100 * high:.0f} %)"
        )
