"""``glider-forecast doctor``: what is installed, what is wrong with it, and what to do."""

from __future__ import annotations

import sys
from typing import Annotated

import typer


def doctor(json_: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False) -> None:
    """Check the installation: packages, devices, compilation cache, extras and bundled files.

    Exit code 1 says that something is wrong; each such line says what to do.

    Example:

    glider-forecast doctor
    """
    from glider_jax.products.installation import check_installation
    from glider_jax_cli.session import cache_folder, compiled_cache

    try:
        compiled_cache()
    except (ImportError, RuntimeError, AttributeError) as error:
        # Told by the checks; here it must not keep the others from running.
        print(f"note: {error}", file=sys.stderr)
    found = []
    for check in check_installation(cache_folder()):
        found.append(check)
        if json_:
            continue
        mark = {True: "ok", False: "WRONG", None: "-"}[check.ok]
        print(f"{mark:6}{check.name}: {check.found}", flush=True)
        if check.ok is False:
            print(f"{'':6}{check.todo}", flush=True)
    wrong = [check for check in found if check.ok is False]
    if json_:
        import json
        from dataclasses import asdict

        print(json.dumps({"ok": not wrong, "checks": [asdict(check) for check in found]}, allow_nan=False))
    else:
        print(f"{len(wrong)} of {len(found)} checks found something wrong" if wrong else "all is well")
    if wrong:
        raise typer.Exit(1)
