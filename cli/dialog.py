"""``glider-forecast dialog``: what a surface dialog or dockserver state holds, each datum with its age. No JAX."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from glider_jax.readers.dialog_records import NextWaypoint, Position, Surfacing
    from glider_jax.readers.live_state import LiveState


def dialog(
    paths: Annotated[list[Path], typer.Argument(help="Dialog logs, mission logs, gliderState.xml.")],
    vehicle: Annotated[str | None, typer.Option(help="Glider, where a log holds several.")] = None,
    now: Annotated[
        str | None,
        typer.Option(help="UTC time to look from, as 2026-03-28T20:45Z; else the newest in the files."),
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="List every surfacing, not only the newest.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """Show what the glider said: position, mission, waypoint, battery, current, sensors, and how old each is."""
    import json

    from glider_jax.readers.dialogs import DialogLog
    from glider_jax.readers.live_state import latest_state

    sources = [_read(path, vehicle) for path in paths]
    live = latest_state(sources, now=_moment(now), vehicle=vehicle)
    surfacings = [s for one in sources if isinstance(one, DialogLog) for s in one.surfacings]
    repairs = [(str(path), r) for path, one in zip(paths, sources, strict=True) for r in one.repairs]
    if as_json:
        content = {
            "latest": _plain(live),
            "surfacings": [_plain(s) for s in surfacings],
            "files": {k: v for one in sources for k, v in one.source.files.items()},
            "repairs": [
                {"file": f, "kind": r.kind, "count": r.count, "detail": r.detail} for f, r in repairs
            ],
        }
        typer.echo(json.dumps(content, allow_nan=False))
        return
    for file, repair in repairs:
        typer.echo(
            f"{file}: {repair.kind}: {repair.count}{f' ({repair.detail})' if repair.detail else ''}", err=True
        )
    for note in live.notes:
        typer.echo(f"note: {note}", err=True)
    if everything:
        for one in surfacings:
            typer.echo(_line(one))
    _show(live)


def _read(path: Path, vehicle: str | None) -> Any:
    """A state file or a dialog log, told apart by content, not by name."""
    from glider_jax.errors import DataError
    from glider_jax.readers.dialogs import read_dialog
    from glider_jax.readers.glider_state import read_glider_state

    try:
        with path.open("rb") as stream:
            start = stream.read(4096)
    except (OSError, ValueError) as error:
        raise DataError(
            f"{path}: expected a dialog log or gliderState.xml, found {error}. Check the path."
        ) from error
    if b"<gliderState" in start:
        return read_glider_state(path, vehicle=vehicle or "")
    return read_dialog(path, vehicle=vehicle)


def _moment(text: str | None) -> float | None:
    from datetime import UTC, datetime

    if text is None:
        return None
    try:
        when = datetime.fromisoformat(text.replace("Z", "+00:00"))
    except ValueError as error:
        raise typer.BadParameter(f"expected a time such as 2026-03-28T20:45Z, found '{text}'") from error
    return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()


def _plain(value: Any) -> Any:
    """Records as JSON: numbers that are not known become null; every ``time`` gets its UTC text beside it."""
    import dataclasses
    import math

    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        out = {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
        if isinstance(out.get("time"), float):
            out["utc"] = _utc(out["time"])
        return out
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _utc(seconds: float) -> str:
    import math
    from datetime import UTC, datetime

    if not math.isfinite(seconds) or not 0.0 <= seconds < 4.2e9:
        return "unknown time"
    return datetime.fromtimestamp(round(seconds), UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _age(seconds: float) -> str:
    """An age as a pilot says it."""
    if not seconds < 3.2e9:
        return "age unknown"
    if seconds < 90.0:
        return f"{seconds:.0f} s old"
    if seconds < 5400.0:
        return f"{seconds / 60.0:.0f} min old"
    return f"{seconds / 3600.0:.1f} h old" if seconds < 172800.0 else f"{seconds / 86400.0:.0f} days old"


def _degree_minutes(value: float, letters: str) -> str:
    thousandths = round(abs(value) * 60_000.0)
    whole, minutes = divmod(thousandths, 60_000)
    return f"{whole}°{minutes / 1000.0:06.3f}′{letters[value < 0]}"


def _place(latitude: float, longitude: float) -> str:
    both = f"{_degree_minutes(latitude, 'NS')} {_degree_minutes(longitude, 'EW')}"
    return f"{both} ({latitude:.5f}, {longitude:.5f})"


def _position(name: str, one: Position | None) -> str:
    if one is None:
        return f"{name}: none"
    return f"{name}: {_place(one.latitude, one.longitude)}, {_age(one.age)}, {_utc(one.time)}"


def _waypoint(one: NextWaypoint | None) -> str:
    import math

    if one is None:
        return "waypoint: none"
    text = f"waypoint: {_place(one.latitude, one.longitude)}"
    if math.isfinite(one.range):
        text += f", {one.range / 1000.0:.2f} km ({one.range / 1852.0:.2f} nm)"
        text += f" at {math.degrees(one.bearing):03.0f}° T from the newest position"
    if math.isfinite(one.printed_range):
        text += f"; printed {one.printed_range:.0f} m"
    if math.isfinite(one.printed_bearing):
        text += f" at {math.degrees(one.printed_bearing):.0f}°"
    return text + (f"; {_age(one.age)}" if math.isfinite(one.age) else "")


def _line(one: Surfacing) -> str:
    where = "no fix" if one.gps is None else _place(one.gps.latitude, one.gps.longitude)
    words = [_utc(one.time), one.vehicle or "?", one.mission_number or one.mission or "-", one.state]
    return "\t".join([*words, one.reason or "-", where, f"{one.dumps} printouts"])


def _show(live: LiveState) -> None:
    """Print the newest evidence for a person."""
    one = live.surfacing
    typer.echo(f"{live.vehicle or 'glider without a name'} as of {_utc(live.now)}")
    if one is not None:
        typer.echo(f"last printout: {_utc(one.time)}, {_age(live.now - one.time)}")
        typer.echo(f"mission: {one.mission or '-'} {one.mission_number}".rstrip())
        resumed = ", dived again" if one.resumed else ""
        typer.echo(f"state: {one.state}{f' ({one.evidence})' if one.evidence else ''}{resumed}")
        if one.reason:
            typer.echo(
                f"surfaced because: {one.reason} [{one.behavior or '?'}, start_when {one.start_when:g}]"
            )
        if one.time_until_diving == one.time_until_diving:
            typer.echo(f"dives in: {one.time_until_diving:.0f} s after the last printout")
    typer.echo(_position(f"GPS fix ({live.gps_source})" if live.gps else "GPS fix", live.gps))
    typer.echo(_position("dead reckoning", live.dead_reckoned))
    typer.echo(_waypoint(live.waypoint))
    _battery(live)
    if live.water_velocity is not None:
        said = {True: "complete", False: "not complete", None: "state not printed"}[live.water_complete]
        water = live.water_velocity
        typer.echo(
            f"water velocity: x {water.x:+.3f}, y {water.y:+.3f} m/s along the glider's axes "
            f"(y to magnetic north), {said}, {_age(water.age)}"
        )
    if live.aborts is not None:
        count = "" if live.aborts.total is None else f"{live.aborts.total} since reset"
        cause = f"last {live.aborts.cause} {_utc(live.aborts.time)}" if live.aborts.cause else ""
        typer.echo(f"aborts: {'; '.join(w for w in (count, cause) if w)}")
    for error in one.errors if one is not None else ():
        typer.echo(f"glider error: {error}")
    typer.echo(f"sensors: {len(live.sensors)}, never set: {len(live.defaults)}")
    for name, datum in live.sensors.items():
        typer.echo(f"  {name}\t{datum.value:.9g} {datum.unit}\t{_age(datum.age)}")


def _battery(live: LiveState) -> None:
    parts = []
    if volts := live.sensors.get("m_battery"):
        parts.append(f"{volts.value:.2f} V ({_age(volts.age)})")
    if used := live.sensors.get("m_coulomb_amphr_total"):
        parts.append(f"{used.value / 3600.0:.3f} Ah used ({_age(used.age)})")
    if share := live.sensors.get("m_lithium_battery_relative_charge"):
        parts.append(f"{100.0 * share.value:.1f} % left ({_age(share.age)})")
    typer.echo(f"battery: {', '.join(parts) or 'not printed'}")
