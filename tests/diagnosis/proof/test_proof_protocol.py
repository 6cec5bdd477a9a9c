"""Cases and the sealed run: sizes of effects, hashes, resumption, options and the command."""

from __future__ import annotations

import json
import sys
import textwrap

import numpy as np
import pytest
from typer.testing import CliRunner

from glider_jax.diagnosis.proof import cases, metrics, protocol
from glider_jax.diagnosis.proof.ocean import DAY
from glider_jax.errors import ConfigError


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Missions of a few hours, so that a run takes seconds."""
    monkeypatch.setattr(cases, "DURATION", 0.4 * DAY)
    cases.world_of.cache_clear()
    yield
    cases.world_of.cache_clear()


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """A diagnosis that names one effect on every recording and counts its calls."""
    (tmp_path / "fake_diagnosis.py").write_text(
        textwrap.dedent(
            """
            CALLS = []
            OPTIONS = []
            def diagnose(case, out, only=None, exclude=()):
                assert {p.name for p in case.iterdir()} <= {
                    "recording.nc", "vehicle.toml", "mission.toml", "bathymetry.nc", "currents.nc"}
                assert (case / "recording.nc").exists()
                CALLS.append(case.name)
                OPTIONS.append((only, exclude))
                return {"verdict": "explained", "effects": [{"id": "flight.ballast_offset"}]}
            """
        )
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    yield "fake_diagnosis:diagnose"
    sys.modules.pop("fake_diagnosis", None)


def test_every_effect_of_the_library_has_the_names_of_its_parameters():
    from glider_jax.physics.catalogue import catalogue

    known = {row["id"]: {p["name"] for p in row["parameters"]} for row in catalogue()}
    rng = np.random.default_rng(0)
    for id, draw in (cases.PUBLISHED | cases.FURTHER).items():
        drawn = set(draw(rng, cases.REGIONS[0])) - {"both_gauges"}
        assert id in known, id
        assert drawn <= known[id], id
    assert len(cases.PUBLISHED) == 25
    assert not set(cases.OUTSIDE) & set(known)


@pytest.mark.parametrize(
    "id",
    ["flight.ballast_offset", "navigation.compass_deviation", "energy.dive_only_load", "sensor.current_gain",
     "navigation.surface_windage", "energy.internal_resistance", "sensor.pressure_offset", "out.drag_by_temperature"],
)  # fmt: skip
def test_an_effect_gets_the_strength_it_should(id):
    drawn, reached = cases.draw_effect(id, 9.0, 1, np.random.default_rng(3))
    assert reached == pytest.approx(9.0, rel=0.05)
    twice = {k: v if k.rsplit(".", 1)[1] in cases.UNSCALED else 2 * v for k, v in drawn.items()}
    assert cases.signal_to_noise(cases.world_of(1), twice) == pytest.approx(18.0, rel=0.1)


def test_an_effect_far_from_linear_gets_its_strength_too():
    drawn, reached = cases.draw_effect("flight.lift_loss", 11.3, 1, np.random.default_rng(3), (0.1, cases.LARGEST))
    assert reached == pytest.approx(11.3, rel=0.02) and 0.2 < drawn["flight.lift_loss.loss"] < 0.5


def test_calibrations_absorb_what_their_sigmas_allow():
    world = cases.world_of(1)
    inside = cases.signal_to_noise(world, {"flight.ballast_offset.mass": cases.SIGMA["mass"]})
    assert inside == pytest.approx(1.0, abs=0.25)
    drag = cases.SIGMA["parasite_drag"] / cases.VEHICLES[1].parasite_drag
    assert cases.signal_to_noise(world, {"flight.drag_bias.share": drag}) < 1.1
    # Nor does what no vehicle file can state: the open-circuit voltage of this very pack.
    assert cases.signal_to_noise(world, {"energy.voltage_offset.offset": 0.05}) < 1.1


def test_an_effect_stays_within_what_is_sensible():
    drawn, reached = cases.draw_effect("flight.lift_loss", 500.0, 1, np.random.default_rng(3))
    assert drawn["flight.lift_loss.loss"] == pytest.approx(0.2 * cases.LARGEST) and reached < 500.0
    limits = (cases.SMALLEST, cases.LARGEST)
    drawn, reached = cases.draw_effect("energy.dive_only_load", 0.01, 1, np.random.default_rng(3), limits)
    assert drawn["energy.dive_only_load.power"] == pytest.approx(0.3 * cases.SMALLEST) and reached > 0.01


def test_confusable_pairs_are_as_strong_as_what_tells_them_apart():
    effects = (("flight.ballast_offset", 12.0), ("flight.pitch_offset", 12.0))
    truth = cases.draw_truth(cases.Spec("p", "pair", effects, 1, 5))
    assert truth["unique"].keys() == truth["strengths"].keys()
    assert all(truth["unique"][k] < 0.8 * truth["strengths"][k] for k in truth["unique"])
    far = (("flight.ballast_offset", 12.0), ("energy.surface_load", 12.0))
    truth = cases.draw_truth(cases.Spec("p", "pair", far, 1, 5))
    assert all(truth["unique"][k] > 0.95 * truth["strengths"][k] for k in truth["unique"])


def test_unknown_effects_and_sets_are_refused():
    with pytest.raises(ConfigError, match="Did you mean 'flight.drag_growth'"):
        cases.draw_effect("flight.drag_grow", 5.0, 1, np.random.default_rng(0))
    with pytest.raises(ConfigError, match="leaves no trace in west_florida"):
        cases.draw_effect("energy.cold_friction", 5.0, 0, np.random.default_rng(0))
    with pytest.raises(ConfigError, match="Did you mean 'single'"):
        protocol.draw_specs(4, 1, "singles")


def test_specs_are_drawn_from_the_seed():
    first, again, other = (protocol.draw_specs(60, s) for s in (5, 5, 6))
    assert first == again != other and len(first) == 60
    singles = protocol.draw_specs(50, 2, "single")
    ids = [s.effects[0][0] for s in singles]
    assert sorted(ids) == sorted([*cases.PUBLISHED] * 2)
    sizes = [s.effects[0][1] for s in singles]
    assert min(sizes) >= 2.0 and max(sizes) <= 40.0
    pairs = protocol.draw_specs(20, 2, "pair")
    assert sum(tuple(i for i, _ in s.effects) in cases.CONFUSABLE for s in pairs) >= 10
    assert all(s.region != 0 for s in singles if s.effects[0][0] == "energy.cold_friction")


def test_a_truth_stays_within_the_stated_sigmas_and_has_faint_effects():
    spec = cases.Spec("n1", "null", (), 1, 77)
    truth = cases.draw_truth(spec)
    assert cases.draw_truth(spec) == truth
    for name, sigma in cases.SIGMA.items():
        assert abs(truth["constants"][name] - getattr(cases.VEHICLES[1], name)) <= 2.0001 * sigma
    faint = cases.grouped(truth["faint"])
    assert len(faint) == 8
    world = cases.world_of(1)
    for id, values in faint.items():
        assert cases.signal_to_noise(world, {f"{id}.{k}": v for k, v in values.items()}) < 0.4


def test_a_run_is_sealed_resumed_and_scored(tmp_path, fake):
    out = tmp_path / "run"
    truths = protocol.seal(out, 2, 11, "single")
    sealed = json.loads((out / "sealed.json").read_text())
    assert sealed["seed"] == 11 and len(sealed["truths"]) == 2 and len(sealed["library_sha256"]) == 64
    assert truths[0]["effects"] and not any("effects" in k for k in sealed)
    said = []
    report = protocol.prove(out, 2, 11, "single", diagnosis=fake, said=said.append)
    calls = sys.modules["fake_diagnosis"].CALLS
    # A strong one is asked again with the truth given, for the gain that was to be had.
    strong = [metrics.strength(truth) >= metrics.STRONG for truth in truths]
    assert any(strong)
    asked = [name for k, name in enumerate(("single001", "single002")) for _ in range(1 + strong[k])]
    assert calls == asked
    told = sys.modules["fake_diagnosis"].OPTIONS[asked.index(f"single00{strong.index(True) + 1}") + 1][0]
    assert told == tuple(cases.grouped(truths[strong.index(True)]["effects"]))
    assert report["scores"]["cases"] == 2 and (out / "table.md").read_text().startswith("| set")
    assert not (out / "cases" / "single001").exists()
    (out / "results" / "single002.json").unlink()
    protocol.prove(out, 2, 11, "single", diagnosis=fake, oracle=False, keep=True)
    assert calls[len(asked) :] == ["single002"] and (out / "cases" / "single002" / "vehicle.toml").exists()
    assert "concealed" in said[-1]


def test_the_same_seed_writes_the_same_recording(tmp_path):
    import xarray as xr

    spec = cases.Spec("s", "single", (("flight.drag_growth", 8.0),), 1, 5)
    truth = cases.draw_truth(spec)
    for name in ("a", "b"):
        cases.write_case(tmp_path / name, spec, truth)
    with xr.open_dataset(tmp_path / "a/recording.nc") as a, xr.open_dataset(tmp_path / "b/recording.nc") as b:
        assert a.identical(b)


def test_a_changed_truth_is_found_out(tmp_path, fake):
    out = tmp_path / "run"
    protocol.seal(out, 1, 3, "null")
    path = out / "truths" / "null001.json"
    path.write_text(path.read_text().replace("null001", "null002"))
    with pytest.raises(ConfigError, match="changed after it was sealed"):
        protocol.prove(out, 1, 3, "null", diagnosis=fake)


def test_a_run_with_other_settings_is_not_continued(tmp_path):
    protocol.seal(tmp_path, 1, 3, "null")
    with pytest.raises(ConfigError, match="other settings"):
        protocol.seal(tmp_path, 2, 3, "null")


def test_seeds_are_drawn_when_none_is_given(tmp_path):
    protocol.seal(tmp_path / "a", 1, None, "null")
    protocol.seal(tmp_path / "b", 1, None, "null")
    a, b = (json.loads((tmp_path / n / "sealed.json").read_text()) for n in "ab")
    assert a["seed_drawn"] and a["seed"] != b["seed"] and a["truths_sha256"] != b["truths_sha256"]


def test_ablations_are_handed_on_or_refused(tmp_path, fake):
    diagnose = protocol.load_diagnosis(fake)
    truth = {"effects": {"flight.drag_growth.rate": 1.0}}
    assert protocol.options_of(diagnose, "without-truth", truth) == {"exclude": ("flight.drag_growth",)}
    assert protocol.options_of(diagnose, None, truth) == {}
    with pytest.raises(ConfigError, match="which the diagnosis lacks"):
        protocol.options_of(diagnose, "no-priors", truth)
    with pytest.raises(ConfigError, match="Did you mean 'one-stream'"):
        protocol.options_of(diagnose, "one-streams", truth)
    with pytest.raises(ConfigError, match="no module"):
        protocol.load_diagnosis("glider_jax.nowhere:diagnose")
    with pytest.raises(ConfigError, match="found none"):
        protocol.load_diagnosis("fake_diagnosis:other")


def test_the_command_seals_and_tells(tmp_path, fake):
    import typer

    from glider_jax_cli.prove import prove

    app = typer.Typer()
    app.command()(prove)
    sealed = CliRunner().invoke(
        app, ["--out", str(tmp_path / "r"), "--cases", "1", "--set", "null", "--seed", "4", "--seal-only"]
    )
    assert sealed.exit_code == 0 and "1 truths sealed, SHA-256" in sealed.output
    ran = CliRunner().invoke(
        app,
        [
            "--out",
            str(tmp_path / "r"),
            "--cases",
            "1",
            "--set",
            "null",
            "--seed",
            "4",
            "--diagnosis",
            fake,
            "--json",
        ],
    )
    assert ran.exit_code == 0
    report = json.loads(ran.stdout.strip().splitlines()[-1])
    assert report["scores"]["null"]["false alarm"]["hits"] == 1


def test_sets_advance_alike():
    truths = [{"kind": kind, "name": f"{kind}{i}"} for kind, n in (("null", 3), ("single", 6)) for i in range(n)]
    order = [t["kind"] for t in protocol.interleaved(truths)]
    assert sorted(order) == sorted(t["kind"] for t in truths)
    for stop in (3, 6, 9):
        assert order[:stop].count("null") == stop // 3
