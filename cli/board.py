"""``glider-forecast board``: the current-measurement board."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from glider_jax.board.capture import Status
    from glider_jax.board.record import BoardRecord

app = typer.Typer(no_args_is_help=True, help="Decode, capture and check the current-measurement board.")

Log = Annotated[Path, typer.Argument(help="Board log, capture folder or decoded record.")]
CalibrationFile = Annotated[
    Path | None, typer.Option("--calibration", help="Calibration of the board, TOML.")
]
Revision = Annotated[
    int | None, typer.Option(min=1, max=2, help="Accept only this revision; else recognised.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Out = Annotated[Path, typer.Option(help="Folder to write to.")]


class ClockSteps(StrEnum):
    """What to do when UTC jumped against the ticks."""

    refuse = "refuse"
    keep = "keep"


@app.callback()
def board() -> None:
    """The current-measurement board: decode, capture, emulate, calibrate and check it."""


def _print(result: dict[str, Any], sentences: list[str], as_json: bool) -> None:
    import json

    if as_json:
        typer.echo(json.dumps(result))
    else:
        for sentence in sentences:
            typer.echo(sentence)


def _calibration(path: Path | None, record: BoardRecord) -> Any:
    from glider_jax.board.calibration import nominal, read_calibration

    return read_calibration(path) if path else nominal(record.channels)


@app.command()
def decode(
    log: Log,
    out: Out = Path("board-record"),
    revision: Revision = None,
    clock_steps: Annotated[
        ClockSteps, typer.Option(help="Refuse or keep a record whose UTC jumped.")
    ] = ClockSteps.refuse,
    as_json: AsJson = False,
) -> None:
    """Decode a log into NumPy files and say what was lost, to the sample.

    Intact samples are written even where the command ends with an error about saturation or the clock.
    """
    from glider_jax.board.clock import read_arrivals
    from glider_jax.board.decoder import read_pieces
    from glider_jax.board.record import write_record

    arrivals = read_arrivals(log)
    record, decoder = write_record(read_pieces(log), out, log.name, revision, arrivals)
    own = ("samples_by_channel", "period_s", "period_assumed")
    result = decoder.report.as_dict() | {key: record.report[key] for key in own}
    result |= {"clock_steps": len(record.clock.steps), "out": str(out)}
    sentences = decoder.report.sentences()
    if record.report["period_assumed"]:
        sentences.append("the setup frame is lost: a tick is taken to be 32 ms")
    _print(result, sentences, as_json)
    for channel in record.channels:
        record.require_usable(channel)
    if clock_steps is ClockSteps.refuse:
        record.clock.require_steady(log.name)


@app.command()
def capture(
    port: Annotated[str, typer.Argument(help="Serial port such as /dev/ttyUSB0, or socket://HOST:PORT.")],
    out: Out = Path("board-capture"),
    baud: Annotated[int, typer.Option(min=300, help="Baud rate of the line.")] = 9600,
    revision: Revision = None,
    calibration: CalibrationFile = None,
    duration_s: Annotated[
        float | None, typer.Option(min=0.0, help="Stop after this long; else at Ctrl-C.")
    ] = None,
    rotate_mb: Annotated[float, typer.Option(min=0.001, help="Complete a file at this size.")] = 64.0,
    rotate_h: Annotated[float, typer.Option(min=0.001, help="Complete a file at this age.")] = 24.0,
    identify_s: Annotated[
        float, typer.Option(min=0.0, help="Give up if bytes come for this long and none is ours; 0 never.")
    ] = 5.0,
    as_json: AsJson = False,
) -> None:
    """Record the board until Ctrl-C; survives unplugging, and loses nothing received even if killed."""
    from glider_jax.board.calibration import nominal, read_calibration
    from glider_jax.board.capture import Capture, Options

    options = Options(
        port=port,
        folder=out,
        baud=baud,
        revision=revision,
        rotate_bytes=max(int(rotate_mb * 1e6), 1),
        rotate_s=3600.0 * rotate_h,
        identify_s=identify_s,
        duration_s=duration_s,
    )
    chosen = read_calibration(calibration) if calibration else nominal()
    status = Capture(options, chosen, _show).run()
    typer.echo("", err=True)
    _print(status.as_dict(), [*status.report.sentences(), f"{status.outages} outages of the port"], as_json)


def _show(status: Status) -> None:
    """One line that is rewritten on a terminal, one line in ten seconds elsewhere."""
    import sys

    follower = status.report.follower
    currents = " ".join(f"{name} {value:+.2f}" for name, value in status.currents.items())
    line = (
        f"{status.elapsed:8.0f} s {'' if status.connected else 'NO PORT '}{status.bytes_per_second:6.0f} B/s "
        f"{status.frames_per_second:5.1f} frames/s, missing {follower.missing} in {follower.gap_count} gaps, "
        f"{status.outages} outages | {currents} A"
    )
    if sys.stderr.isatty():
        print(f"\r\033[K{line}", end="", file=sys.stderr, flush=True)
    elif int(status.elapsed) % 10 == 0:
        print(line, file=sys.stderr, flush=True)


@app.command()
def emulate(
    log: Annotated[Path | None, typer.Argument(help="Log to play; a simulated mission without it.")] = None,
    link: Annotated[Path | None, typer.Option(help="Pseudo-terminal to create, e.g. ./board-port.")] = None,
    tcp_port: Annotated[int | None, typer.Option(help="Serve on this TCP port instead.")] = None,
    baud: Annotated[int, typer.Option(min=300, help="Line rate.")] = 9600,
    fault_rate: Annotated[float, typer.Option(min=0.0, help="Damaged places per byte.")] = 0.0,
    seed: Annotated[int, typer.Option(help="Of the mission and the faults.")] = 0,
) -> None:
    """Play a board over a pseudo-terminal or TCP at the line rate, with faults if asked."""
    import numpy as np

    from glider_jax.board.decoder import read_pieces
    from glider_jax.board.emulator import Emulator, PtyLine, TcpLine
    from glider_jax.board.faults import random_faults
    from glider_jax.board.simulate import Plan, simulate
    from glider_jax.errors import ConfigError

    if (link is None) == (tcp_port is None):
        raise ConfigError(
            "emulate: expected one of --link and --tcp-port. Name where the board shall appear."
        )
    data = b"".join(read_pieces(log)) if log else simulate(Plan(), seed).encode()
    line = PtyLine(link, baud) if link else TcpLine(tcp_port or 0)
    faults = random_faults(len(data), fault_rate, np.random.default_rng(seed))
    typer.echo(f"playing {len(data)} bytes at {baud} baud on {link or tcp_port}; Ctrl-C stops", err=True)
    try:
        Emulator(line, data, baud / 10, faults, seed).run()
    except KeyboardInterrupt:
        line.unplug()


@app.command()
def simulate(
    out: Out = Path("board-simulated"),
    seed: Annotated[int, typer.Option(help="Of all draws.")] = 0,
    yos: Annotated[int, typer.Option(min=1, help="Number of yos.")] = 24,
    deepest_m: Annotated[float, typer.Option(min=5.0, help="Depth of the deepest turn.")] = 95.0,
    channels: Annotated[int, typer.Option(help="8 or 6.")] = 8,
    as_json: AsJson = False,
) -> None:
    """Write the log of a simulated mission whose energy model is known."""
    import json

    import numpy as np

    from glider_jax.board import simulate as simulation
    from glider_jax.errors import ConfigError

    if channels not in (6, 8):
        raise ConfigError(f"simulate: --channels: expected 6 or 8, found {channels}.")
    plan = simulation.Plan(depths=tuple(np.linspace(min(12.0, deepest_m), deepest_m, yos)), channels=channels)
    flight = simulation.simulate(plan, seed)
    out.mkdir(parents=True, exist_ok=True)
    (out / "board.bin").write_bytes(flight.encode())
    (out / "truth.json").write_text(json.dumps(flight.truth, indent=1), encoding="utf-8")
    result = {"log": str(out / "board.bin"), "samples": len(flight.counts), "truth": flight.truth}
    _print(result, [f"wrote {len(flight.counts)} samples to {out / 'board.bin'}"], as_json)


@app.command()
def bench(
    log: Log,
    channel: Annotated[str, typer.Option(help="Channel that carried the current.")] = "brake",
    applied_a: Annotated[float, typer.Option(help="Current applied, by the reference instrument.")] = 1.0,
    duration_s: Annotated[float, typer.Option(min=0.1, help="How long it was applied.")] = 6.0,
    calibration: CalibrationFile = None,
    out: Out = Path("."),
    as_json: AsJson = False,
) -> None:
    """Judge the bench check: a known current on one sensor, within the error budget. Exit code 1 if it
    fails."""
    from glider_jax.board.checks import bench_check
    from glider_jax.board.plots import plot_bench
    from glider_jax.board.record import read_log

    record = read_log(log)
    result = bench_check(record, channel, _calibration(calibration, record), applied_a, duration_s)
    plot = plot_bench(out / f"bench-{channel}.png", result)
    numbers = {
        "channel": channel,
        "passed": result.passed,
        "mean_a": result.mean,
        "applied_a": applied_a,
        "budget_a": result.budget,
        "duration_s": result.duration,
        "noise_a": result.noise,
        "reasons": list(result.reasons),
        "plot": str(plot),
    }
    text = f"{channel}: {result.mean:.4f} A of {applied_a:g} A, budget {result.budget:.4f} A, {result.duration:.2f} s"
    _print(numbers, [f"{'pass' if result.passed else 'FAIL'}: {text}", *result.reasons], as_json)
    if not result.passed:
        raise typer.Exit(1)


@app.command()
def wiggle(
    log: Log,
    channels: Annotated[
        list[str] | None, typer.Option("--channel", help="Servo; fin and pitch by default.")
    ] = None,
    bursts: Annotated[int, typer.Option(min=1, help="Least movements in each direction.")] = 2,
    calibration: CalibrationFile = None,
    out: Out = Path("."),
    as_json: AsJson = False,
) -> None:
    """Judge the wiggle test: servos through their range, currents of both signs. Exit code 1 if it fails."""
    from glider_jax.board.checks import wiggle_test
    from glider_jax.board.plots import plot_wiggle
    from glider_jax.board.record import read_log

    record = read_log(log)
    chosen = _calibration(calibration, record)
    results = [wiggle_test(record, name, chosen, bursts) for name in channels or ["fin", "pitch"]]
    plot = plot_wiggle(out / "wiggle.png", results)
    passed = all(result.passed for result in results)
    numbers = [
        {
            "channel": r.channel,
            "passed": r.passed,
            "positive": r.positive,
            "negative": r.negative,
            "highest_a": r.highest,
            "lowest_a": r.lowest,
            "reasons": list(r.reasons),
        }
        for r in results
    ]
    lines = []
    for r in results:
        lines.append(f"{'pass' if r.passed else 'FAIL'}: {r.channel} {r.positive} up, {r.negative} down")
        lines += list(r.reasons)
    _print({"passed": passed, "servos": numbers, "plot": str(plot)}, lines, as_json)
    if not passed:
        raise typer.Exit(1)


@app.command()
def zero(
    log: Log,
    out: Annotated[Path, typer.Option(help="Calibration file to write.")] = Path("calibration.toml"),
    begin_s: Annotated[float, typer.Option(min=0.0, help="Start of the time with everything off.")] = 0.0,
    end_s: Annotated[float, typer.Option(help="End of it, from the start of the log.")] = 60.0,
    calibration: CalibrationFile = None,
    as_json: AsJson = False,
) -> None:
    """Measure the zero of every channel from a time when nothing ran, and write a calibration."""
    from dataclasses import replace

    from glider_jax.board.calibration import write_calibration, zero_when_off
    from glider_jax.board.record import read_log

    record = read_log(log)
    chosen = _calibration(calibration, record)
    start = record.tick[0]
    result = {}
    for name in record.channels:
        record.require_usable(name)
        own = record.only(name)
        time = (own.tick - start) * own.period
        rows = (time >= begin_s) & (time < end_s) & (own.epoch == record.epoch[0])
        level, sd = zero_when_off(own.counts[rows, own.column(name)], f"{log.name}: channel {name}")
        chosen = chosen.with_zero(name, level, sd)
        result[name] = {"zero_counts": level, "sd_counts": sd, "sd_a": sd * chosen[name].amperes_per_count}
    write_calibration(replace(chosen, source=f"zeros from {log.name}"), out)
    lines = [
        f"{n}: {v['zero_counts']:.2f} +- {v['sd_counts']:.2f} counts ({v['sd_a']:.4f} A)"
        for n, v in result.items()
    ]
    _print({"zeros": result, "out": str(out)}, [*lines, f"wrote {out}"], as_json)


@app.command()
def plot(
    log: Log,
    channels: Annotated[list[str] | None, typer.Option("--channel", help="All by default.")] = None,
    calibration: CalibrationFile = None,
    out: Out = Path("."),
) -> None:
    """Draw the current of each channel against time."""
    from glider_jax.board.plots import plot_board
    from glider_jax.board.record import read_log

    record = read_log(log)
    chosen = _calibration(calibration, record)
    path = plot_board(out / "currents.png", record, chosen, channels=tuple(channels or record.channels))
    typer.echo(f"wrote {path}")


@app.command()
def power(
    board_name: Annotated[
        str, typer.Option("--board", help="measurement_board_8 or measurement_board_6.")
    ] = "measurement_board_8",
    computer: Annotated[
        str, typer.Option(help="Science computer, by software and clock.")
    ] = "science_computer_deployed",
    toml: Annotated[bool, typer.Option("--toml", help="Print the devices line for a vehicle file.")] = False,
    as_json: AsJson = False,
) -> None:
    """What the instrument itself draws, and the CTD interval that the computer's clock allows."""
    from glider_jax.board.power import BOARDS, COMPUTERS, ctd_interval, device_toml, instrument_power

    extra, interval = instrument_power(board_name, computer), ctd_interval(computer)
    if toml:
        typer.echo(device_toml(board_name, computer))
        return
    loads = {**BOARDS, **COMPUTERS}
    result = {
        "extra_power_w": extra,
        "ctd_interval_s": interval,
        "loads": {
            name: {"power_w": load.power, "text": load.text, "source": load.source}
            for name, load in loads.items()
        },
    }
    lines = [f"{name:33s} {load.power:5.2f} W  {load.text}" for name, load in loads.items()]
    lines.append(
        f"{board_name} with {computer}: {extra:.2f} W above a stock glider, CTD every {interval:g} s at best"
    )
    _print(result, lines, as_json)


@app.command()
def ports(as_json: AsJson = False) -> None:
    """List the serial ports of this machine."""
    from serial.tools import list_ports

    found = [{"device": p.device, "text": p.description} for p in list_ports.comports()]
    lines = [f"{p['device']}  {p['text']}" for p in found] or ["no serial port found"]
    _print({"ports": found}, lines, as_json)
