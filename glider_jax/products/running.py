"""Flying an ensemble chunk by chunk into its netCDF file and its summary, so that it can be stopped and taken up.

Above ``job.STREAM_ABOVE`` members nothing is held but one chunk, what the summary counts, and a checkpoint every few
seconds. An interrupt (Ctrl-C, SIGTERM) leaves ``forecast.partial.nc`` and ``summary.partial.json``, which say so.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from glider_jax.errors import DataError
from glider_jax.mission.forecast import CHUNK, Run, fly_chunks, join
from glider_jax.mission.programs import surroundings
from glider_jax.products.atomic import write_text
from glider_jax.products.checkpoint import Checkpoint, undivided
from glider_jax.products.job import STREAM_ABOVE
from glider_jax.products.netcdf import NetcdfWriter
from glider_jax.products.summary import SummaryAccumulator
from glider_jax.records import Track

if TYPE_CHECKING:
    from glider_jax.products.job import Options

#: s between checkpoints.
EVERY = 10.0
PARTIAL = "summary.partial.json"


def fly_products(
    run: Run, options: Options, out: Path | None, polygons, progress: Callable[[int], None] | None, *, resume: bool
) -> tuple[Track | None, dict[str, Any], dict[str, Path]]:
    """Fly the members and write the netCDF file; see :func:`~glider_jax.products.job.run_ensemble`.

    Returns
    -------
    A track to draw from (all members, or the first chunk), the summary, and the file by its kind. Where this process
    only helps another, the track is None and the summary empty.
    """
    n, stream = options.n, options.n > STREAM_ABOVE
    wanted = out is not None and "nc" in options.outputs
    point = Checkpoint(out, _question(run, options, wanted)) if out is not None and stream else None
    state = _resumed(point, out, n) if resume else None
    if point is not None and state is None:
        point.remove()
    summary, done, kept = SummaryAccumulator(polygons=polygons, reserve=options.reserve), 0, []
    writer = NetcdfWriter(out / "forecast.nc", members=n) if wanted else None
    if state is not None:
        summary, done, kept = state["summary"], state["done"], [state["first"]]
        if writer is not None:
            writer.take_up(state["writer"], kept[0])
    saved = time.monotonic()

    def save() -> None:
        written = None if writer is None else writer.state()
        point.save(summary=summary, done=done, first=kept[0], writer=written)

    try:
        for track in fly_chunks(n - done, run, first=done, chunk=CHUNK) if done < n else ():
            with undivided():
                summary.add(track)
                if writer is not None and stream:
                    writer.append(track)
                if not stream or not kept:
                    kept.append(track)
                done += track.n
                if point is not None and time.monotonic() - saved > EVERY:
                    save()
                    saved = time.monotonic()
            if progress is not None:
                progress(done)
        if not kept:
            return None, {}, {}
        whole = kept[0] if stream else join(kept)
        if writer is not None and not stream:
            writer.append(whole)
        files = {} if writer is None else {"nc": writer.close(complete=True)}
    except BaseException as error:
        with undivided():
            _leave(error, out, writer, summary, kept, done, stream, save if point is not None else None)
        raise
    if point is not None:
        point.remove()
    if out is not None:
        (out / PARTIAL).unlink(missing_ok=True)
    return whole, summary.result(), files


def _leave(error, out, writer, summary, kept, done, stream, save) -> None:
    """Keep what was flown before an interrupt; after any other error leave nothing unfinished."""
    interrupted = isinstance(error, KeyboardInterrupt | SystemExit)
    if not (interrupted and done):
        if writer is not None:
            writer.discard()
        return
    if save is not None:
        save()
    if writer is not None:
        if not stream:
            writer.append(replace(join(kept), complete=False))
        writer.close(complete=False)
    if out is not None:
        summary.complete = False
        text = json.dumps(summary.result(), indent=1, allow_nan=False) + "\n"
        write_text(out / PARTIAL, text)


def _resumed(point: Checkpoint | None, out: Path | None, n: int) -> dict[str, Any] | None:
    if point is None:
        if out is None:
            raise DataError("--resume: expected a folder of products, found none. Give --out.")
        # So few members are flown in seconds; no checkpoint is kept of them.
        return None
    state = point.load()
    if state is None:
        raise DataError(
            f"{point.path}: expected the checkpoint of an interrupted forecast, found none. Leave out --resume."
        )
    if state["done"] > n or state["done"] % CHUNK:
        raise DataError(f"{point.path}: expected whole chunks of at most {n} members, found {state['done']}.")
    return state


def _question(run: Run, options: Options, written: bool) -> str:
    """Everything that decides what a forecast is, as text."""
    return repr((sorted(run.settings.items()), options.n, str(options.polygons), written, CHUNK, surroundings()))
