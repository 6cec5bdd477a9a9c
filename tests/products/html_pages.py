"""Pages of every kind from made-up results, with names that try to run as script."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from glider_jax.config import Mission, SurfaceRule, Yo
from glider_jax.products.hindcast import Case as Surfacing
from glider_jax.products.hindcast import plain_numbers, rows, summarise
from glider_jax.products.html.forecast import Fields, write_report
from glider_jax.products.html.hindcast import write_hindcast
from glider_jax.products.html.planning import write_plan
from glider_jax.products.html.validation import write_validation
from glider_jax.products.planning import Case, Setting
from glider_jax.products.planning_choice import Sensitivity, recommend
from glider_jax.products.regions import regions
from glider_jax.products.summary import summarise as summary_of
from glider_jax.readers.vehicles import read_vehicle
from tests.products.tracks import START, gaussian_track, shelf, shelf_currents

EVIL = "nj<script>window.pwned=1</script></script><img src=x onerror=window.pwned=2>\"'\x1b[31m"


def evil_track(**changes):
    """An ensemble whose mission, vehicle, reasons, inputs, components and notes carry markup."""
    track = gaussian_track(**changes)
    settings = track.settings | {"mission": EVIL, "vehicle": EVIL, "inputs": {EVIL: "ab" * 32}, "terms": [EVIL]}
    components = (EVIL, *track.components[1:])
    return replace(track, settings=settings, notes=(EVIL,), reasons=(EVIL, *track.reasons[1:]), components=components)


def forecast_page(path: Path, track=None, **changes) -> Path:
    """The page of an ensemble over a made-up shelf."""
    floor = shelf()
    track = evil_track(**changes) if track is None else track
    return write_report(track, summary_of(track), path, fields=Fields(floor, shelf_currents(floor)))


def plan_page(path: Path) -> Path:
    """The page of a plan with a refused setting and a battery in words."""
    rng = np.random.default_rng(1)

    def setting(km: float, share: float, **choices) -> Setting:
        n = 40
        good = np.arange(n) < share * n
        return Setting(
            choices=choices, days=np.full(n, 10.0), km=km + rng.normal(size=n), profiles=np.full(n, 10.0 * km),
            wh=np.full(n, 400.0 + km), left=np.full(n, 0.4), contacts=np.full(n, 60.0), finished=good, success=good,
            outcome=np.zeros(n, int), story={},
        )  # fmt: skip

    flown = [
        setting(200.0 + 10 * k, 1.0 - 0.2 * k, pitch=20.0 + 2 * k, battery=name)
        for k in range(3)
        for name in ("alkaline", "lithium")
    ]
    flown.append(Setting(choices={"pitch": 60.0, "battery": "alkaline"}, refused=EVIL))
    chosen = recommend(flown[:6], goal="km", confidence=0.9, seed=0, by="battery")
    mission = Mission(
        EVIL, waypoints=((39.2, -73.5), (39.0, -73.0)), yo=Yo(60.0, 3.0, 0.45, 0.45),
        surface=(SurfaceRule("every", seconds=21600.0),), start_position=(39.4, -74.0),
    )  # fmt: skip
    case = Case(mission, read_vehicle("slocum_g1_shallow"), bathymetry=shelf(), n=40)
    hangs = {
        "alkaline": [Sensitivity(EVIL, "+1 sigma", (3.0, 0.2), (-4.0, 0.5)), Sensitivity("b", "x", (-1, 0), (0, 0))]
    }
    words = {"subtitle": EVIL, "answers": [EVIL], "assumed": [EVIL], "names": lambda s: f"{s.choices}",
             "made": {"seed": 1, "settings": {"name": EVIL}}}  # fmt: skip
    return write_plan(case, flown, chosen, hangs, words, path, goal="km")


def surfacings(count: int = 6) -> list[Surfacing]:
    """Cases of a glider that drifts eastward past the antimeridian, each with regions."""
    rng = np.random.default_rng(4)
    found = []
    for k in range(count):
        lat, lon = 39.0 + 0.02 * k, 179.97 + 0.02 * k
        cloud = rng.normal(size=(400, 2)) * 0.005 + [lat, lon]
        found.append(
            Surfacing(
                recording=EVIL if k % 2 else "ru28", number=k + 1, issued=START + 10800.0 * k,
                surfaced=START + 10800.0 * (k + 1), latitude=lat + 0.003,
                longitude=(lon + 180.001) % 360.0 - 180.0, forecast_latitude=lat,
                forecast_longitude=(lon + 180.0) % 360.0 - 180.0, error=300.0 + k, persistence=900.0,
                dead_reckoning=500.0, moved=3000.0, energy_score=200.0, inside50=k % 2 == 0, inside90=True, area90=2e6,
                time_error=60.0, time_crps=30.0, time_below=0.1 + 0.15 * k, time_persistence=200.0, charge=100.0,
                charge_forecast=110.0, charge_crps=5.0, charge_below=0.4, charge_persistence=12.0, members_up=1.0,
                history=4, gap=False, causes={EVIL: 100.0}, regions=regions(cloud[:, 0], cloud[:, 1]),
            )
        )  # fmt: skip
    return found


def hindcast_page(path: Path) -> Path:
    """The page of a hindcast of two recordings."""
    cases = surfacings()
    names = sorted({c.recording for c in cases})
    content = plain_numbers(
        {
            "recordings": {name: summarise([c for c in cases if c.recording == name]) for name in names},
            "pooled": summarise(cases), "cases": rows(cases), "seed": 0, "members": 400,
        }
    )  # fmt: skip
    return write_hindcast(cases, content, path, settings={"inputs": {EVIL: "cd" * 32}})


def validation_page(path: Path, picture: Path) -> Path:
    """The page of a validation with one figure."""
    row = {
        "name": EVIL, "days": 8.0, "kilojoules": 700.0, "ours_days": [7.5, 8.1, 8.4],
        "ours_kilojoules": [690, 702, 720], "days_difference": 0.0125, "energy_difference": 0.003, "members": 20,
    }  # fmt: skip
    other = row | {"name": "shoebox", "days": 12.0, "kilojoules": 900.0, "ours_days": [None, 12.0, None]}
    dive = {
        "number": 1, "start": START, "displacement": 2000.0, "miss": {"estimated": 300.0}, "late": 60.0,
        "energy": [1e3, 2e3, 3e3], "true_energy": 2e3, "inside": True,
    }  # fmt: skip
    numbers = {"rows": [row, other], "through_water": [row], "flown": [dive]}
    return write_validation(numbers, {"figure": picture}, path, markdown=f"# {EVIL}\n\nwords", settings={"seed": 3})
