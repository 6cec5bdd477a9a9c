"""Vehicle files (TOML) -> :class:`glider_jax.config.Vehicle`.

What a file leaves unsaid comes from its preset, or from ``QUANTITIES``, and is listed in ``Vehicle.assumed``. Traps:
``pump_volume`` and ``pump_rate`` of a bare number are cc and cc/s, everything else is SI; ``pump_volume_cc`` or
``{ value, unit }`` say it explicitly. A file's ``devices`` replace those of its preset.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from glider_jax.config import CovarianceBlock, Quantity, Vehicle, check_vehicle
from glider_jax.errors import ConfigError, did_you_mean
from glider_jax.readers.battery_packs import read_battery
from glider_jax.readers.device_catalogue import read_devices
from glider_jax.readers.quantities import QUANTITIES, SECTIONS
from glider_jax.readers.toml_checks import Table, load_toml, number_list
from glider_jax.records import Source
from glider_jax_data import names as bundled_names
from glider_jax_data import path as bundled_path

DEFAULT_PRESET = "slocum_g1_shallow"


def presets() -> tuple[str, ...]:
    """Names of the bundled vehicles."""
    return tuple(Path(n).stem for n in bundled_names() if n.startswith("vehicles/") and n.endswith(".toml"))


def read_vehicle(path: str | Path | None = None) -> Vehicle:
    """Read a vehicle from a TOML file, or a bundled one by its name.

    Parameters
    ----------
    path : file, name of a bundled vehicle (see :func:`presets`), or None for ``DEFAULT_PRESET``.

    Returns
    -------
    Vehicle with every name of ``QUANTITIES``, SI units; ``assumed`` lists what the file did not say.

    Raises
    ------
    DataError : the file cannot be read.
    ConfigError : a key is unknown, or a value is missing, of the wrong kind, out of range or contradictory.
    """
    if path is None:
        path = DEFAULT_PRESET
    if isinstance(path, str) and path in presets():
        path = _preset_path(path)
    return _read(Path(path), presets_allowed=True)


def _preset_path(name: str) -> Path:
    return bundled_path(f"vehicles/{name}.toml")


def _read(path: Path, presets_allowed: bool) -> Vehicle:
    top = load_toml(path)
    sections = {name: top.table(name) for name in ("vehicle", "energy", "perturbation", "battery", "terms", "speeds")}
    vehicle = sections["vehicle"]
    base = _base(vehicle, top, presets_allowed)
    quantities, given, assumed = _quantities(top, sections, base)
    devices = read_devices(top, base.devices if base is not None else ())
    battery, said = read_battery(sections["battery"], sections["energy"], base.battery if base is not None else None)
    assumed += said
    covariances, quantities = _covariances(top, base, given, quantities)
    terms = _terms(sections["terms"], base)
    speeds = _speeds(sections["speeds"], base, path)
    name = path.stem if vehicle is None else vehicle.text("name", path.stem)
    for table in (*sections.values(), top):
        if table is not None and table is not sections["terms"]:
            table.close()
    files = {str(path): Source.digest(path)}
    if base is not None:
        files = {**base.source.files, **files}
    result = Vehicle(
        name=name or path.stem,
        quantities=quantities,
        devices=devices,
        battery=battery,
        covariances=covariances,
        terms=terms,
        speeds=speeds,
        source=Source("vehicle TOML", files),
        assumed=tuple(assumed),
    )
    check_vehicle(result, path.name)
    return result


def _base(vehicle: Table | None, top: Table, allowed: bool) -> Vehicle | None:
    name = vehicle.text("preset") if vehicle is not None else None
    if name is None:
        return None
    if vehicle is not None and (not allowed or name not in presets()):
        raise ConfigError(
            f"{vehicle.where('preset')}: expected one of {', '.join(presets())}, found '{name}'."
            f"{did_you_mean(name, presets())}"
        )
    return _read(_preset_path(name), presets_allowed=False)


def _quantities(
    top: Table, sections: dict[str, Table | None], base: Vehicle | None
) -> tuple[dict[str, Quantity], set[str], list[str]]:
    """All quantities, which of them the file gave, and a sentence for each that it did not."""
    found: dict[str, Quantity] = {}
    given: set[str] = set()
    assumed: list[str] = []
    pump_line = None
    energy = sections["energy"]
    if energy is not None:
        pump_line = energy.table("pump_dive_to_climb")
    for name, spec in QUANTITIES.items():
        group, *rest = name.split(".")
        table, key = sections[SECTIONS[group]], rest[-1]
        if len(rest) == 2:
            table = pump_line
        number = table.quantity(key, spec.unit, spec.file_unit) if table is not None else None
        if number is None:
            if base is not None:
                found[name] = base.quantities[name]
                assumed.append(_assumption(name, found[name], f"preset {base.name}"))
            else:
                found[name] = Quantity(spec.value, spec.sigma, spec.unit, spec.source)
                if spec.value or spec.sigma:
                    assumed.append(_assumption(name, found[name], "default"))
            continue
        assert table is not None
        if not spec.low <= number.value <= spec.high:
            raise ConfigError(
                f"{table.where(key)}: expected {spec.low:g} to {spec.high:g} {spec.unit} ({spec.text}), "
                f"found {number.value:g} {spec.unit}. Check the value and its unit."
            )
        sigma, source = number.sigma, number.source or top.file
        if sigma is None:
            sigma = abs(number.value) * spec.bare_sigma
        if number.sigma is None and group != "perturbation" and key != "reference_volume":
            how = f"1-sigma of {100 * spec.bare_sigma:g} % assumed" if sigma else "taken as exact"
            assumed.append(f"{name}: given without sigma, {how}")
        found[name] = Quantity(number.value, sigma, spec.unit, source)
        given.add(name)
    if pump_line is not None:
        # A source said once for the whole line holds for its parts.
        source = pump_line.text("source")
        for name in given if source else ():
            if name.startswith("energy.pump_dive_to_climb."):
                found[name] = replace(found[name], source=source or "")
        pump_line.close()
    _reference_volume(found, given, assumed)
    return found, given, assumed


def _reference_volume(found: dict[str, Quantity], given: set[str], assumed: list[str]) -> None:
    """Let a pump line given without its volume hold for the full stroke of this vehicle's pump."""
    name = "energy.pump_dive_to_climb.reference_volume"
    if name in given or not any(n.startswith("energy.pump_dive_to_climb.") for n in given):
        return
    stroke = 2.0 * found["flight.pump_volume"].value
    found[name] = Quantity(stroke, 0.0, "m3", "twice the commanded pump volume")
    assumed[:] = [a for a in assumed if not a.startswith(f"{name}:")]
    assumed.append(_assumption(name, found[name], "default"))


def _assumption(name: str, q: Quantity, origin: str) -> str:
    spread = f" +- {q.sigma:.3g}" if q.sigma else ""
    unit = "" if q.unit == "1" else f" {q.unit}"
    return f"{name}: {q.value:.6g}{spread}{unit} from {origin} ({q.source})"


def _covariances(
    top: Table, base: Vehicle | None, given: set[str], quantities: dict[str, Quantity]
) -> tuple[tuple[CovarianceBlock, ...], dict[str, Quantity]]:
    """Covariance blocks; a block's diagonal becomes the sigma of its quantities."""
    blocks: list[CovarianceBlock] = []
    taken: set[str] = set()
    quantities = dict(quantities)
    for table in top.tables("covariance"):
        names = table.texts("names")
        raw = table.raw("matrix")
        rows = [number_list(row) for row in raw] if isinstance(raw, list) else []
        if not names or any(row is None or len(row) != len(names) for row in rows) or len(rows) != len(names):
            raise ConfigError(
                f"{table.where('matrix')}: expected 'names' and a square matrix with a row for each, "
                f"found {len(names or ())} names and {len(rows)} rows. Correct the matrix."
            )
        for name in names:
            if name not in quantities:
                raise ConfigError(f"{table.where('names')}: unknown quantity '{name}'.{did_you_mean(name, quantities)}")
            if name in taken:
                raise ConfigError(f"{table.where('names')}: '{name}' stands twice. Keep it in one block.")
            taken.add(name)
        block = CovarianceBlock(tuple(names), tuple(row for row in rows if row is not None), table.text("source") or "")
        table.close()
        blocks.append(block)
        for i, name in enumerate(names):
            quantities[name] = replace(quantities[name], sigma=max(block.matrix[i][i], 0.0) ** 0.5)
    if base is not None:
        blocks += [b for b in base.covariances if not (set(b.names) & (given | taken))]
    return tuple(blocks), quantities


def _terms(table: Table | None, base: Vehicle | None) -> dict[str, dict[str, Quantity]]:
    """Optional physics by id; the physics layer knows the ids and checks the parameters."""
    terms = {} if base is None else {name: dict(values) for name, values in base.terms.items()}
    for name in () if table is None else table.data:
        assert table is not None
        inner = table.table(name)
        assert inner is not None
        values: dict[str, Quantity] = {}
        for key, raw in inner.data.items():
            entry = Table(raw if isinstance(raw, dict) else {"value": raw}, inner.file, f"{inner.path} {key}")
            value, sigma = entry.number("value"), entry.number("sigma", 0.0, low=0.0)
            if value is None:
                raise ConfigError(f"{entry.where('value')}: expected a number, found none. Add value = ...")
            unit, source = entry.text("unit", "") or "", entry.text("source", inner.file) or inner.file
            values[key] = Quantity(value, sigma or 0.0, unit, source)
            entry.close()
        terms[name] = values
    return terms


def _speeds(table: Table | None, base: Vehicle | None, path: Path) -> dict[str, Any]:
    speeds: dict[str, Any] = {"distribution": "paper2010", "shoebox": 0.34} if base is None else dict(base.speeds)
    if table is None:
        return speeds
    file, name, kind = table.text("file"), table.text("distribution"), table.text("kind")
    shoebox = table.number("shoebox", None, 0.01, 3.0, "m/s")
    if file is not None and name is not None:
        raise ConfigError(f"{table.where()}: 'file' and 'distribution' contradict each other. Keep one of them.")
    if kind not in (None, "over_ground", "through_water"):
        raise table.wrong("kind", "'over_ground' or 'through_water'")
    if file is not None:
        speeds.pop("distribution", None)
        speeds["file"] = str((path.parent / file).resolve())
    if name is not None:
        speeds.pop("file", None)
        speeds["distribution"] = name
    if kind is not None:
        speeds["kind"] = kind
    if shoebox is not None:
        speeds["shoebox"] = shoebox
    return speeds
