"""``glider-forecast energy``: energy models from recordings and board logs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from glider_jax.board.analysis import Analysis
    from glider_jax.board.calibration import Calibration
    from glider_jax.board.record import BoardRecord

app = typer.Typer(no_args_is_help=True, help="Energy models from recordings and board logs.")

Recordings = Annotated[
    list[Path], typer.Argument(help="Recordings: each a file, or a folder of Slocum binaries.")
]
Board = Annotated[
    Path | None,
    typer.Option("--board", help="Board log, capture folder or decoded record of the same flight."),
]
CalibrationFile = Annotated[
    Path | None, typer.Option("--calibration", help="Calibration of the board, TOML.")
]
Cache = Annotated[Path | None, typer.Option("--cache", help="Folder of Slocum sensor lists (.cac).")]


class ClockSteps(StrEnum):
    """What to do when the board's UTC jumped against its ticks."""

    refuse = "refuse"
    keep = "keep"


Steps = Annotated[
    ClockSteps, typer.Option("--clock-steps", help="Refuse or keep a board log whose UTC jumped.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]


@app.callback()
def energy() -> None:
    """Energy models: what pump, brake and everything else cost, with uncertainty."""


def _analyse(
    recordings: list[Path],
    board: Path | None,
    calibration: Path | None,
    cache: Path | None,
    voltage: float | None,
    steps: ClockSteps,
) -> tuple[Analysis, dict[str, str], tuple[BoardRecord, Calibration] | None]:
    from glider_jax.board.analysis import analyse_board, analyse_recordings, join_records
    from glider_jax.board.calibration import nominal, read_calibration
    from glider_jax.board.events import glider_record
    from glider_jax.board.record import read_log
    from glider_jax.readers.recordings import read_recording
    from glider_jax.records import Source

    read = [read_recording([path], cache=cache) for path in recordings]
    for one in read:
        for repair in one.repairs:
            typer.echo(f"{one.name}: {repair.count} {repair.kind}", err=True)
    files = {Path(path).name: digest for one in read for path, digest in one.source.files.items()}
    if board is None:
        return analyse_recordings(read), files, None
    record = read_log(board)
    if board.is_file():
        files[board.name] = Source.digest(board)
    if steps is ClockSteps.refuse:
        record.clock.require_steady(record.name)
    chosen = read_calibration(calibration) if calibration else nominal(record.channels)
    glider = join_records([glider_record(one, need_current=False) for one in read])
    return analyse_board(record, glider, chosen, voltage), files, (record, chosen)


@app.command()
def fit(
    recordings: Recordings,
    out: Annotated[
        Path,
        typer.Option(help="Vehicle fragment to write (NAME.toml), or a folder for vehicle.toml and plots."),
    ] = Path("vehicle.toml"),
    board: Board = None,
    calibration: CalibrationFile = None,
    cache: Cache = None,
    voltage_v: Annotated[
        float | None, typer.Option(min=1.0, help="Battery voltage where none was recorded.")
    ] = None,
    clock_steps: Steps = ClockSteps.refuse,
    name: Annotated[str | None, typer.Option(help="Name of the vehicle in the fragment.")] = None,
    plots: Annotated[bool, typer.Option(help="Draw currents and energy beside the fragment.")] = True,
    as_json: AsJson = False,
) -> None:
    """Fit pump, brake and steady load, and write them as a vehicle fragment that ensemble takes as it is.

    Uses the vehicle's own current and coulomb counter, or with --board the samples of a measurement board.
    """
    import json

    from glider_jax.board.fits import UNITS
    from glider_jax.board.fragment import model_dict, vehicle_toml, write_atomically

    result, files, measured = _analyse(recordings, board, calibration, cache, voltage_v, clock_steps)
    model = result.model
    target = out if out.suffix == ".toml" else out / "vehicle.toml"
    write_atomically(target, vehicle_toml(model, files, name))
    written = [target]
    if plots:
        from glider_jax.board.plots import plot_board, plot_currents, plot_energy

        written.append(plot_energy(target.with_name(f"{target.stem}-energy.png"), model, result.events))
        path = target.with_name(f"{target.stem}-currents.png")
        glider = result.glider
        if measured is not None:
            written.append(plot_board(path, *measured, glider))
        elif glider is not None and glider.current is not None:
            written.append(plot_currents(path, glider.time, {"vehicle": glider.current}, glider, model.name))
    for sentence in model.warnings:
        typer.echo(f"warning: {sentence}", err=True)
    if as_json:
        extra = {
            "current_over_counter_less_one": _finite(result.counter[0]),
            "board_against_counter": result.check.as_dict() if result.check else None,
            "servos_w": _finite(result.servos),
            "files": [str(path) for path in written],
        }
        typer.echo(json.dumps(model_dict(model) | extra))
        return
    for key, e in model.estimates.items():
        typer.echo(f"{key:42s} {e.value:10.3f} +- {e.interval():.3f} {UNITS[key]:6s} (95 %)  {e.source}")
    for level in model.levels:
        phase = f"{level.phase}, {level.state.replace('+', ' and ')}" if level.state else level.phase
        typer.echo(
            f"steady load {phase:40s} {level.mean:6.2f} +- {level.mean_sd:.2f} W, usually {level.median:.2f} W, "
            f"floor {level.floor:.2f} W, {level.seconds / 3600.0:.1f} h"
        )
    if model.pump is not None:
        forms = [f for f in (model.pump, model.other) if f is not None]
        text = ", ".join(f"{f.form} {f.held_out:.1f} J" for f in forms)
        typer.echo(f"held-out error of a stroke: {text}; scatter {model.pump.scatter:.1f} J")
    if _finite(result.counter[0]) is not None:
        ratio = f"{100 * result.counter[0]:+.2f} +- {100 * result.counter[1]:.2f} %"
        typer.echo(f"integrated current against the coulomb counter: {ratio}")
    if result.check is not None:
        typer.echo(result.check.sentence())
    if _finite(result.servos) is not None:
        typer.echo(f"pitch and fin servos: {result.servos:.3f} W on average, not in the hotel load")
    for path in written:
        typer.echo(f"wrote {path}", err=True)


def _finite(value: float) -> float | None:
    return value if value == value else None


@app.command()
def events(
    recordings: Recordings,
    out: Annotated[Path | None, typer.Option(help="Folder for events.csv.")] = None,
    board: Board = None,
    calibration: CalibrationFile = None,
    cache: Cache = None,
    voltage_v: Annotated[
        float | None, typer.Option(min=1.0, help="Battery voltage where none was recorded.")
    ] = None,
    clock_steps: Steps = ClockSteps.refuse,
    as_json: AsJson = False,
) -> None:
    """List pump strokes, brake and servo events with their energies."""
    import json

    from glider_jax.board.analysis import events_csv, events_table
    from glider_jax.board.fragment import write_atomically
    from glider_jax.board.logfile import utc_name

    result, _, _ = _analyse(recordings, board, calibration, cache, voltage_v, clock_steps)
    if out is not None:
        write_atomically(out / "events.csv", events_csv(result.events))
        typer.echo(f"wrote {out / 'events.csv'}", err=True)
    if as_json:
        typer.echo(json.dumps({"events": events_table(result.events)}))
        return
    for e in result.events:
        typer.echo(
            f"{utc_name(e.time)} {e.kind:12s} {e.direction:14s} {e.depth:7.1f} m {e.duration:6.1f} s "
            f"{e.peak:6.2f} A {e.energy:9.1f} +- {e.energy_sd:.1f} J"
        )
