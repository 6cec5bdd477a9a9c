"""A/D counts to amperes with 1-sigma uncertainty; NumPy only.

The Hall sensors and the converter share one supply, so zero and sensitivity are ratiometric: the counts do
not depend
on the supply voltage. Noise and quantisation average out over many samples; zero error, its drift with
temperature and
gain error do not. The two parts are therefore kept apart everywhere: ``random`` and ``systematic``.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from glider_jax.board.frames import CHANNELS_8, FULL_SCALE
from glider_jax.errors import ConfigError, DataError, did_you_mean

SUPPLY = 5.0
STEPS = 1024
REFERENCE_TEMPERATURE = 25.0


@dataclass(frozen=True)
class Sensor:
    """A Hall current sensor on a 5 V supply.

    ``rated`` A, ``sensitivity`` V A-1, ``gain_sd`` relative 1-sigma, ``noise`` V rms per sample,
    ``zero_sd`` V before a
    zero is measured, ``drift_sd`` V K-1 of the zero.
    """

    name: str
    rated: float
    sensitivity: float
    gain_sd: float
    noise: float
    zero_sd: float
    drift_sd: float
    source: str


SENSORS = {
    "hall_20A": Sensor(
        "hall_20A",
        20.0,
        0.100,
        0.015,
        0.0018,
        0.015,
        0.00034,
        "Allegro ACS712ELC-20A data sheet, 11 mV p-p noise",
    ),
    "hall_5A": Sensor(
        "hall_5A",
        5.0,
        0.185,
        0.015,
        0.0035,
        0.015,
        0.00026,
        "Allegro ACS712ELC-05B data sheet, 21 mV p-p noise",
    ),
    "hall_3A": Sensor(
        "hall_3A",
        3.0,
        0.667,
        0.015,
        0.0035,
        0.015,
        0.0003,
        "judgement: part unpublished, 3 A spans 2 V about the zero",
    ),
}
_FITTED = {
    "main": "hall_20A",
    "external": "hall_20A",
    "emergency": "hall_20A",
    "pump_a": "hall_5A",
    "pump_b": "hall_5A",
    "brake": "hall_3A",
    "pitch": "hall_3A",
    "fin": "hall_3A",
}


@dataclass(frozen=True)
class Channel:
    """Calibration of one channel.

    ``zero`` counts at no current and ``zero_sd``; ``gain_factor`` multiplies the nominal amperes per
    count, ``gain_sd`` is
    its relative 1-sigma; ``drift`` counts K-1 of the zero from ``temperature`` (degC) and ``drift_sd``.
    """

    sensor: Sensor
    zero: float = STEPS / 2
    zero_sd: float = 0.0
    gain_factor: float = 1.0
    gain_sd: float = 0.015
    drift: float = 0.0
    drift_sd: float = 0.0
    temperature: float = REFERENCE_TEMPERATURE

    @property
    def amperes_per_count(self) -> float:
        """Size of one count, A."""
        return self.gain_factor * SUPPLY / STEPS / self.sensor.sensitivity

    @property
    def noise(self) -> float:
        """1-sigma of one sample from sensor noise and quantisation, A."""
        counts = np.hypot(self.sensor.noise * STEPS / SUPPLY, 1.0 / np.sqrt(12.0))
        return float(counts * self.amperes_per_count)


@dataclass(frozen=True)
class Amperes:
    """Current with its uncertainty: ``value`` A, ``random`` A per sample, ``systematic`` A shared by all
    samples.

    ``value`` and ``systematic`` have the shape of the counts; NaN where a sample sat on a rail of the
    converter.
    """

    value: NDArray[np.float64]
    random: float
    systematic: NDArray[np.float64]

    @property
    def sigma(self) -> NDArray[np.float64]:
        """Total 1-sigma of one sample, A."""
        return np.hypot(self.random, self.systematic)


@dataclass(frozen=True)
class Calibration:
    """Calibration of a whole board, by channel name; ``source`` says where it is from."""

    channels: dict[str, Channel] = field(default_factory=dict)
    source: str = "data sheets"

    def __getitem__(self, name: str) -> Channel:
        if name not in self.channels:
            raise ConfigError(
                f"calibration: no channel '{name}'.{did_you_mean(name, self.channels)} "
                f"Known: {', '.join(self.channels)}."
            )
        return self.channels[name]

    def amperes(self, name: str, counts: ArrayLike, temperature: float | None = None) -> Amperes:
        """Convert counts of one channel.

        Parameters
        ----------
        name : channel.
        counts : A/D counts of any shape.
        temperature : degC of the board, if known; otherwise the drift is left in the uncertainty, over 10 K.
        """
        channel = self[name]
        raw = np.asarray(counts, dtype=np.float64)
        warmer = 0.0 if temperature is None else temperature - channel.temperature
        scale = channel.amperes_per_count
        value = (raw - channel.zero - channel.drift * warmer) * scale
        value = np.where((raw <= 0) | (raw >= FULL_SCALE), np.nan, value)
        drift = channel.drift_sd * (10.0 if temperature is None else abs(warmer))
        offset = np.hypot(channel.zero_sd, drift) * scale
        return Amperes(value, channel.noise, np.hypot(offset, channel.gain_sd * np.abs(value)))

    def with_zero(self, name: str, zero: float, zero_sd: float) -> Calibration:
        """The same calibration with a measured zero for one channel."""
        channel = replace(self[name], zero=zero, zero_sd=zero_sd)
        return replace(self, channels={**self.channels, name: channel})


def nominal(channels: tuple[str, ...] = CHANNELS_8) -> Calibration:
    """Calibration from the data sheets alone: zero at half supply, nominal gain, their full uncertainty."""
    table = {}
    for name in channels:
        sensor = SENSORS[_FITTED[name]]
        per_volt = STEPS / SUPPLY
        table[name] = Channel(
            sensor,
            zero_sd=sensor.zero_sd * per_volt,
            gain_sd=sensor.gain_sd,
            drift_sd=sensor.drift_sd * per_volt,
        )
    return Calibration(table)


def zero_when_off(counts: NDArray[np.integer], name: str = "channel") -> tuple[float, float]:
    """Zero of a channel from samples taken while it carried no current.

    Parameters
    ----------
    counts : (sample,) at least 16; a few disturbed samples do no harm.

    Returns
    -------
    Zero in counts and its 1-sigma: the scatter of the mean, plus the bias that quantisation leaves where
    the noise is
    too small to dither the converter.

    Raises
    ------
    DataError : too few samples, or the samples do not scatter about one level.
    """
    values = np.asarray(counts, dtype=np.float64)
    if values.size < 16:
        raise DataError(f"{name}: expected at least 16 samples with the channel off, found {values.size}.")
    middle = np.median(values)
    spread = max(1.4826 * np.median(np.abs(values - middle)), 1.0)
    kept = values[np.abs(values - middle) <= 5.0 * spread]
    if kept.size < 0.9 * values.size:
        raise DataError(
            f"{name}: expected one level while the channel is off, found {values.size - kept.size} of {values.size} "
            "samples away from it. Choose a window in which nothing runs."
        )
    noise = float(kept.std())
    return float(kept.mean()), float(np.hypot(max(noise, 0.3) / np.sqrt(kept.size), undithered(noise)))


def undithered(scatter: float) -> float:
    """1-sigma of the bias that rounding to whole counts leaves in a mean, counts.

    Parameters
    ----------
    scatter : counts, of single samples as read; what quantisation itself adds to it does not dither.
    """
    dither = max(scatter**2 - 1.0 / 12.0, 0.0)
    return float(np.exp(-2.0 * np.pi**2 * dither) / np.pi / np.sqrt(2.0))


def fit_drift(
    temperature: NDArray[np.float64], zero: NDArray[np.float64], zero_sd: NDArray[np.float64]
) -> tuple[float, float, float, float]:
    """Line of zeros against board temperature.

    Parameters
    ----------
    temperature : (window,) degC. zero, zero_sd : (window,) counts, from :func:`zero_when_off`.

    Returns
    -------
    Zero at the reference temperature and its 1-sigma, drift in counts K-1 and its 1-sigma.

    Raises
    ------
    DataError : fewer than two temperatures, or less than 1 K between them.
    """
    if temperature.size < 2 or np.ptp(temperature) < 1.0:
        raise DataError(
            "temperature drift: expected zeros at temperatures at least 1 K apart. Measure warm and cold."
        )
    design = (
        np.stack([np.ones_like(temperature), temperature - REFERENCE_TEMPERATURE], axis=1) / zero_sd[:, None]
    )
    covariance = np.linalg.inv(design.T @ design)
    fitted = covariance @ design.T @ (zero / zero_sd)
    return float(fitted[0]), float(covariance[0, 0] ** 0.5), float(fitted[1]), float(covariance[1, 1] ** 0.5)


_KEYS = ("zero", "zero_sd", "gain_factor", "gain_sd", "drift", "drift_sd", "temperature")


def write_calibration(calibration: Calibration, path: str | Path) -> None:
    """Write a calibration as TOML; numbers in counts, counts per kelvin and degC."""
    lines = [f'source = "{calibration.source}"', ""]
    for name, channel in calibration.channels.items():
        lines += [f"[channels.{name}]", f'sensor = "{channel.sensor.name}"']
        lines += [f"{key} = {float(getattr(channel, key))!r}" for key in _KEYS] + [""]
    Path(path).write_text("\n".join(lines), encoding="utf-8")


def read_calibration(path: str | Path) -> Calibration:
    """Read a calibration file.

    Raises
    ------
    ConfigError : the file is absent or not TOML, a sensor, channel or key is unknown, or a number is not one.
    """
    where = Path(path)
    try:
        data = tomllib.loads(where.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{where}: expected a calibration file, found nothing. Check the path.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{where}: expected TOML, found {error}.") from None
    table = {}
    for name, entry in data.get("channels", {}).items():
        if name not in _FITTED:
            raise ConfigError(f"{where}: unknown channel '{name}'.{did_you_mean(name, _FITTED)}")
        sensor = entry.get("sensor", _FITTED[name])
        if sensor not in SENSORS:
            raise ConfigError(
                f"{where}: channel {name}: unknown sensor '{sensor}'.{did_you_mean(sensor, SENSORS)}"
            )
        numbers = {}
        for key, value in entry.items():
            if key == "sensor":
                continue
            if key not in _KEYS:
                raise ConfigError(f"{where}: channel {name}: unknown key '{key}'.{did_you_mean(key, _KEYS)}")
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ConfigError(f"{where}: channel {name}: {key}: expected a number, found {value!r}.")
            numbers[key] = float(value)
        table[name] = Channel(SENSORS[sensor], **numbers)
    if not table:
        raise ConfigError(f"{where}: expected tables [channels.NAME], found none.")
    return Calibration(table, str(data.get("source", where.name)))
