"""Forecasts that missed beside segments that missed: short and far, right and left, and files that are none."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from glider_jax.diagnosis.misses import explain, read_cases
from glider_jax.errors import DataError
from glider_jax.inference.streams import Stream

METRE = 180.0 / np.pi / 6_371_000.0


def found(count: int = 6):
    """A finding whose segments go north at 20 cm/s and fall 5 cm/s short before, 1 cm/s after."""
    time, span = 3600.0 * np.arange(1, count + 1), np.full(count, 3000.0)
    make = lambda value: Stream("", "m s-1", "cm/s", 100.0, value, time, time, time, time, span)  # noqa: E731
    streams = {"displacement east": make(np.zeros(count)), "displacement north": make(np.full(count, 0.2))}
    zero = np.zeros(count)
    whitened = {"displacement east": (zero, zero), "displacement north": (zero - 0.05, zero - 0.01)}
    return SimpleNamespace(
        gathered=SimpleNamespace(stream=streams.get, origin=1e9, product=True),
        recording=SimpleNamespace(name="r"),
        whitened=whitened,
        search=SimpleNamespace(problem=SimpleNamespace(noises=[])),
    )


def cases(count: int = 6, north: float = -300.0):
    """Forecasts that the glider came ``north`` metres beyond, at the ends of the segments."""
    rows = []
    for k in range(count):
        moment = np.datetime64(int(1e9 + 3600 * (k + 1) + 1500), "s")
        rows.append({
            "recording": "r", "surfaced": f"{moment}Z", "latitude": 39.0 + north * METRE, "longitude": -73.0,
            "forecast_latitude": 39.0, "forecast_longitude": -73.0, "time_error": 60.0,
        })  # fmt: skip
    return rows


def test_a_glider_that_comes_short_is_said_to():
    """Signs: south of the forecast on a way north is short; the residuals shrink with what was named."""
    told = explain(cases(), found(), {"effects": []})
    assert told["cases"] == 6 and told["short"] == 1.0
    assert told["along_m"] == pytest.approx(-300.0, abs=1.0) and abs(told["across_m"]) < 1.0
    assert told["before_along_m"] == pytest.approx(-150.0) and told["after_along_m"] == pytest.approx(-30.0)
    assert "300 m short" in told["sentence"] and "6 of them came short" in told["sentence"]
    assert explain(cases(north=200.0), found(), {"effects": []})["along_m"] == pytest.approx(200.0, abs=1.0)


def test_forecasts_of_other_recordings_do_not_count():
    """Another name, another time, too few."""
    other = [{**row, "recording": "s"} for row in cases()]
    assert explain(other, found(), {"effects": []}) is None
    assert explain(cases(2), found(), {"effects": []}) is None


def test_a_file_without_cases_is_explained(tmp_path):
    """The file of another command, and a missing one."""
    path = tmp_path / "hindcast.json"
    with pytest.raises(DataError, match="Give that file"):
        read_cases(path)
    path.write_text(json.dumps({"recordings": {}}), encoding="utf-8")
    with pytest.raises(DataError, match="found no cases"):
        read_cases(path)
    path.write_text(json.dumps({"cases": cases()}), encoding="utf-8")
    assert len(read_cases(path)) == 6
