"""The published figures drawn again from our own board, speeds and simulations; one PNG each, none committed.

Currents of the board come from its emulator and go through the wire format: encoded, decoded, calibrated. Figure
numbers are those of Woithe and others (2010).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from glider_jax.board.analysis import analyse_board, analyse_recordings
from glider_jax.board.calibration import Calibration, nominal
from glider_jax.board.checks import wiggle_test
from glider_jax.board.decoder import decode_bytes
from glider_jax.board.frames import CHANNELS_8, FULL_SCALE, TICK, encode_revision_1
from glider_jax.board.plots import plot_energy, plot_wiggle
from glider_jax.board.record import BoardRecord, collect
from glider_jax.board.simulate import Flight, Plan, simulate
from glider_jax.mission.speeds_fit import read_speeds
from glider_jax.products import cartography as chart
from glider_jax.products.figure_style import save_figure
from glider_jax.products.validation import DAY, Row, ThreeYos
from glider_jax.products.validation import Calibration as Constants
from glider_jax.readers.recordings import read_recording
from glider_jax.records import Array, BathymetryGrid, CurrentGrid
from glider_jax_data import path as bundled_path

_CLIMB = 70.0
_FULL_RANGE = ((4.0, 0.32), (10.0, -0.32), (16.0, 0.32), (22.0, -0.32))


def decoded(counts: Array, channels: tuple[str, ...], name: str) -> BoardRecord:
    """Counts (sample, channel) as they come back after encoding and decoding."""
    batch, report = decode_bytes(encode_revision_1(counts, boot=1), name=name)
    return collect([batch], name, report.as_dict())


def wiggle_counts(channel: str, calibration: Calibration, seed: int = 0) -> Array:
    """(sample, channel) counts of a servo driven through its full range four times, inrush and friction included."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 28.0, TICK)
    current = np.zeros(time.size)
    length = 3.6 if channel == "pitch" else 1.8
    for begin, level in _FULL_RANGE:
        inside = (time >= begin) & (time < begin + length)
        since = time[inside] - begin
        shape = 1.0 + 0.9 * np.exp(-since / 0.12) + 0.12 * np.sin(2 * np.pi * since / 0.45)
        current[inside] = level * shape * (1.6 if channel == "pitch" else 1.0)
    counts = np.empty((time.size, len(CHANNELS_8)), np.uint16)
    for column, name in enumerate(CHANNELS_8):
        own = calibration[name]
        noise = rng.normal(0.0, own.sensor.noise * 1024.0 / 5.0, time.size)
        flowing = current / own.amperes_per_count if name == channel else 0.0
        counts[:, column] = np.clip(np.rint(own.zero + flowing + noise), 0, FULL_SCALE).astype(np.uint16)
    return counts


def figures_3_and_4(out: Path, seed: int = 0) -> list[Path]:
    """Fin and pitch servo during a wiggle."""
    calibration = nominal(CHANNELS_8)
    paths = []
    for number, channel in ((3, "fin"), (4, "pitch")):
        record = decoded(wiggle_counts(channel, calibration, seed + number), CHANNELS_8, f"{channel} wiggle")
        path = out / f"figure-{number:02d}-{channel}-wiggle.png"
        paths.append(plot_wiggle(path, [wiggle_test(record, channel, calibration)]))
    return paths


def _flight(constants: Constants, depths: Sequence[float], seed: int) -> tuple[Flight, BoardRecord, Calibration]:
    stated = nominal(CHANNELS_8)
    brake = constants.vehicle.value("energy.brake")
    # Of the fixed cost only the sum is known; a climb-to-dive stroke below the detection threshold would not show.
    plan = Plan(
        depths=tuple(depths), intercept=constants.fixed - _CLIMB - 2.0 * brake, slope=constants.slope, climb=_CLIMB,
        brake=brake, hotel=constants.hotel, speed=0.166,
    )  # fmt: skip
    flight = simulate(plan, seed, stated)
    return flight, decoded(flight.counts, flight.channels, "emulated board"), stated


def amperes(record: BoardRecord, calibration: Calibration, *channels: str) -> Array:
    """Current above its usual level, A, summed over channels."""
    total = np.zeros(len(record.tick))
    for name in channels:
        counts = record.counts[:, record.column(name)].astype(float)
        total += (counts - np.median(counts)) * calibration[name].amperes_per_count
    return total


def figure_5(out: Path, constants: Constants, seed: int = 0, style: str = "screen") -> Path:
    """Depth and pump current of a sea trial in water shallower than the commanded depth."""
    flight, record, calibration = _flight(constants, (4.2, 6.0, 8.5, 11.0, 12.0, 12.0), seed)
    time = (record.tick - record.tick[0]) * record.period / 60.0
    figure, (upper, lower) = _figure(2, (8.0, 5.2), sharex=True)
    upper.plot((flight.glider.time - flight.glider.time[0]) / 60.0, flight.glider.depth, color=chart.BLUE, lw=1.0)
    upper.invert_yaxis()
    upper.set_ylabel("depth (m)")
    lower.plot(time, amperes(record, calibration, "pump_a", "pump_b"), color=chart.VERMILLION, lw=0.7)
    lower.set_ylabel("pump current (A)")
    lower.set_xlabel("time (min)")
    upper.set_title("Buoyancy pump and flight profile (emulated board, decoded)", fontsize=10)
    return save_figure(figure, out / "figure-05-depth-and-pump.png", style)


def figure_7(out: Path, constants: Constants, seed: int = 0, style: str = "screen") -> Path:
    """Brake, pump, brake during one turn from dive to climb at about 12 m."""
    _, record, calibration = _flight(constants, (12.0,), seed)
    brake = amperes(record, calibration, "brake")
    pump = amperes(record, calibration, "pump_a", "pump_b")
    time = (record.tick - record.tick[0]) * record.period
    running = np.flatnonzero(np.convolve(brake, np.full(4, 0.25), "same") > 0.06)
    begin = time[running[0]] - 2.0
    shown = (time >= begin) & (time <= begin + 30.0)
    figure, axes = _figure(1, (8.0, 3.8))
    axes.plot(time[shown] - begin, pump[shown], color=chart.BLUE, lw=0.9, label="pump")
    axes.plot(time[shown] - begin, brake[shown], color=chart.ORANGE, lw=1.1, label="brake")
    axes.set_xlabel("time (s)")
    axes.set_ylabel("current (A)")
    axes.set_title("One inflection at 12 m: the brake unlocks, the pump moves, the brake locks", fontsize=10)
    axes.legend(fontsize=8)
    return save_figure(figure, out / "figure-07-inflection.png", style)


def figure_8(out: Path, constants: Constants, recordings: Sequence[Path] = (), seed: int = 0) -> list[Path]:
    """Pump energy against depth with its fit: the emulated board, and each real recording given."""
    flight, record, calibration = _flight(constants, np.linspace(5.0, 95.0, 19), seed)
    # The glider's record counts time as the decoded ticks do: from the first sample.
    glider = flight.glider
    started = type(glider)(**{**glider.__dict__, "time": glider.time - glider.time[0]})
    result = analyse_board(record, started, calibration)
    paths = [plot_energy(out / "figure-08-pump-energy.png", result.model, result.events)]
    for source in recordings:
        own = analyse_recordings([read_recording(source)])
        paths.append(plot_energy(out / f"figure-08-pump-energy-{source.stem}.png", own.model, own.events))
    return paths


def figure_9(out: Path, style: str = "screen") -> Path:
    """Speed distributions at 25 and 26 degrees, over the ground and through the water."""
    figure, axes = _figure(1, (7.5, 4.2))
    colours = {25: chart.ORANGE, 26: chart.BLUE}
    for law in read_speeds(bundled_path("speeds/paper2010.json")):
        degrees = round(np.degrees(law.pitch))
        speed, probability = np.asarray(law.speeds, float), np.asarray(law.probabilities, float)
        edges = np.linspace(0.0, 0.8, 41)
        share = np.diff(np.interp(edges, speed, probability, left=0.0, right=1.0)) * 100.0
        dashes = "-" if law.kind == "over_ground" else ":"
        axes.stairs(
            share, edges, color=colours[degrees], linestyle=dashes, linewidth=1.4,
            label=f"{degrees} degrees, {law.kind.replace('_', ' ')}: mean {law.mean_per_time:.3f} m/s per time, "
            f"{law.mean_per_distance:.3f} per distance",
        )  # fmt: skip
    axes.set_xlabel("speed (m/s)")
    axes.set_ylabel("share of segments (%) per 0.02 m/s")
    axes.set_title("Speeds of dive segments (published totals; shape assumed)", fontsize=10)
    axes.legend(fontsize=7)
    return save_figure(figure, out / "figure-09-speeds.png", style)


def figure_10(out: Path, yos: ThreeYos, style: str = "screen") -> Path:
    """Three yos between 2 and 25 m."""
    figure, axes = _figure(1, (9.0, 4.4))
    minutes = yos.time / 60.0
    for k in range(1, yos.depth.shape[0]):
        axes.plot(
            minutes, yos.depth[k], color=chart.SKY, lw=0.5, alpha=0.5, label="SimDist, 40 members" if k == 1 else None
        )
    middle = 1 + int(np.argmin(np.abs(yos.distribution[: yos.depth.shape[0] - 1] - np.mean(yos.distribution))))
    axes.plot(minutes, yos.depth[middle], color=chart.BLUE, lw=1.6, label="SimDist, near the mean duration")
    axes.plot(minutes, yos.depth[0], color=chart.VERMILLION, lw=1.6, ls=(0, (6, 2)), label="SimShoebox")
    for limit in (2.0, 25.0):
        axes.axhline(limit, color="grey", lw=0.7, ls="--")
    axes.set_xlim(0.0, float(np.quantile(yos.distribution, 0.9)) / 60.0)
    axes.set_ylim(30.0, 0.0)
    axes.set_xlabel("time (min)")
    axes.set_ylabel("depth (m)")
    axes.set_title(
        f"Three yos: SimShoebox {yos.shoebox:.0f} s, SimDist on average {yos.later:.0f} s longer, "
        f"overshoot {yos.overshoot:.1f} m", fontsize=10,
    )  # fmt: skip
    axes.legend(fontsize=8, loc="lower right")
    return save_figure(figure, out / "figure-10-three-yos.png", style)


def figure_11(
    out: Path, rows: Sequence[Row], bathymetry: BathymetryGrid, currents: CurrentGrid, style: str = "screen"
) -> Path:
    """Maps of the three SimDist runs: baseline, seafloor, seafloor and currents."""
    shown = [row for row in rows if row.paper.model == "distribution"]
    figure, axes = _figure(len(shown), (14.0, 4.6), columns=True)
    every = (
        np.concatenate([r.track.latitude[:8].ravel() for r in shown]),
        np.concatenate([r.track.longitude[:8].ravel() for r in shown]),
    )
    for panel, row in zip(axes, shown, strict=True):
        limits = chart.limits_around(*every, ratio=1.25, margin=0.1)
        chart.prepare(panel, limits)
        if row.paper.seafloor:
            chart.draw_bathymetry(panel, bathymetry, limits)
        track = row.track
        if row.paper.currents:
            chart.draw_currents(panel, currents, limits, float(track.time[0]), float(track.time[0]) + row.days[1] * DAY)
        for k in range(min(8, track.n)):
            panel.plot(track.longitude[k], track.latitude[k], color=chart.VERMILLION, lw=0.7, alpha=0.7, zorder=4)
        panel.plot(track.waypoints[:, 1], track.waypoints[:, 0], "k^", ms=5, zorder=5)
        panel.set_title(
            f"{row.paper.name}\n{row.days[1]:.2f} d, {row.kilojoules[1]:.0f} kJ "
            f"(published {row.paper.days:g} d, {row.paper.kilojoules:.0f} kJ)", fontsize=9, pad=18,
        )  # fmt: skip
        chart.draw_scale_bar(panel, limits)
    return save_figure(figure, out / "figure-11-maps.png", style)


def figure_rows(out: Path, rows: Sequence[Row], style: str = "screen") -> Path:
    """Days and energy of the six rows, published and ours with 5 to 95 %."""
    figure, axes = _figure(2, (11.0, 4.2), columns=True)
    place = np.arange(len(rows))[::-1]
    for panel, ours, theirs, label in (
        (axes[0], [r.days for r in rows], [r.paper.days for r in rows], "days"),
        (axes[1], [r.kilojoules for r in rows], [r.paper.kilojoules for r in rows], "kJ"),
    ):
        low, middle, high = np.array(ours, float).T
        high = np.where(np.isfinite(high), high, middle)
        panel.errorbar(
            middle, place, xerr=[middle - low, high - middle], fmt="o", color=chart.BLUE, capsize=3, label="ours"
        )
        panel.plot(theirs, place, "D", color=chart.VERMILLION, mfc="none", ms=9, label="published")
        panel.set_xlabel(label)
        panel.set_yticks(place, [r.paper.name for r in rows] if panel is axes[0] else [""] * len(rows), fontsize=8)
    axes[0].legend(fontsize=8)
    return save_figure(figure, out / "table-rows.png", style)


def _figure(panels: int, size: tuple[float, float], *, sharex: bool = False, columns: bool = False):
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    shape = (1, panels) if columns else (panels, 1)
    axes = figure.subplots(*shape, sharex=sharex, squeeze=False).ravel()
    for panel in axes:
        panel.grid(True, color="#dddddd", linewidth=0.6)
        panel.set_axisbelow(True)
    return figure, axes if panels > 1 else axes[0]

