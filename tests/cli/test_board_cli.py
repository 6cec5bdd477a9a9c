"""The commands ``board`` and ``energy``: results, files, and one clear sentence with exit code 1 for bad
input."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

from glider_jax.board import frames
from glider_jax.board.emulator import Emulator, PtyLine
from glider_jax.board.fits import SLOPE


def counts(ticks=600, seed=0):
    return np.random.default_rng(seed).integers(1, 1023, (ticks, 8)).astype(np.uint16)


def bench_log(path, amperes=1.0):
    rng = np.random.default_rng(0)
    values = 512.0 + rng.normal(0, 0.6, (940, 8))
    values[310:498, 3] += amperes * 0.185 * 1024 / 5
    for begin, sign in ((200, 1), (300, -1), (400, 1), (500, -1)):
        values[begin : begin + 40, 6:] += sign * 50
    path.write_bytes(frames.encode_revision_1(np.rint(values).astype(np.uint16)))
    return path


def test_decode_writes_what_is_intact_and_says_what_is_lost(run, tmp_path):
    raw = frames.encode_revision_1(counts())
    log = tmp_path / "board.bin"
    log.write_bytes(raw[: 22 * 100 + 5] + raw[22 * 140 :])
    code, out, err = run("board", "decode", log, "--out", tmp_path / "r", "--json")
    assert code == 0, err
    report = json.loads(out)
    assert report["samples"] == 560 and report["frames_missing"] == 40 and report["gaps"] == 1
    assert report["first_gaps"] == [{"epoch": 0, "after": 99, "missing": 40}]
    kept = np.delete(counts(), np.arange(100, 140), axis=0)
    np.testing.assert_array_equal(np.load(tmp_path / "r" / "counts.npy"), kept)
    code, out, _ = run("board", "decode", log, "--out", tmp_path / "r")
    assert code == 0 and "40 frames are missing in 1 gaps" in out


class TestBadInput:
    def test_noise(self, run, tmp_path):
        (tmp_path / "x.bin").write_bytes(np.random.default_rng(0).bytes(9000))
        code, _, err = run("board", "decode", "x.bin")
        assert (
            code == 1 and "x.bin: expected frames of the measurement board" in err and "Traceback" not in err
        )

    def test_foreign_log(self, run, tmp_path):
        (tmp_path / "x.bin").write_text("dbd_label: DBD\n" * 50)
        assert run("board", "decode", "x.bin")[0] == 1

    def test_absent_log(self, run):
        code, _, err = run("board", "decode", "none.bin")
        assert code == 1 and "found nothing" in err

    def test_wrong_revision(self, run, tmp_path):
        (tmp_path / "x.bin").write_bytes(frames.encode_revision_1(counts(20)))
        code, _, err = run("board", "decode", "x.bin", "--revision", 2)
        assert code == 1 and "of another revision" in err
        assert run("board", "decode", "x.bin", "--revision", 7)[0] == 2

    def test_saturated_channel(self, run, tmp_path):
        values = counts()
        values[:, 4] = 1023
        (tmp_path / "x.bin").write_bytes(frames.encode_revision_1(values))
        code, _, err = run("board", "decode", "x.bin", "--out", "r")
        assert code == 1 and "pump_b" in err and "600 of 600 samples saturated" in err
        assert np.load(tmp_path / "r" / "counts.npy").shape == (600, 8)

    def test_clock_step(self, run, tmp_path):
        utc = 1_700_000_000_000 + 32 * np.arange(600)
        utc[300:] += 60_000
        (tmp_path / "x.bin").write_bytes(frames.encode_revision_1(counts(), utc_ms=utc))
        code, _, err = run("board", "decode", "x.bin", "--out", "r")
        assert code == 1 and "+60.0 s at tick 320" in err and "--clock-steps keep" in err
        assert run("board", "decode", "x.bin", "--out", "r", "--clock-steps", "keep")[0] == 0

    def test_no_such_port(self, run):
        code, _, err = run("board", "capture", "/dev/ttyNOPE")
        assert code == 1 and "no such device" in err and "Traceback" not in err

    def test_busy_port(self, run, tmp_path):
        from glider_jax.board.port import open_port

        line = PtyLine(tmp_path / "tty")
        line.plug()
        held = open_port(str(tmp_path / "tty"), 9600)
        code, _, err = run("board", "capture", tmp_path / "tty")
        held.close()
        line.unplug()
        assert code == 1 and "busy" in err

    def test_recording_without_current(self, run, tmp_path):
        code, _, err = run("energy", "fit", tmp_path / "none.nc")
        assert code == 1 and "none.nc" in err

    def test_emulate_needs_a_place(self, run):
        code, _, err = run("board", "emulate")
        assert code == 1 and "--link" in err


def test_capture_at_the_port(run, tmp_path):
    data = frames.encode_revision_1(counts(60))
    thread, _ = Emulator(PtyLine(tmp_path / "tty"), data, bytes_per_second=2000.0).start()
    while not (tmp_path / "tty").exists():
        pass
    code, out, err = run("board", "capture", tmp_path / "tty", "--out", "log", "--duration-s", 2, "--json")
    thread.join(5)
    assert code == 0, err
    status = json.loads(out)
    assert status["samples"] == 60 and status["frames_missing"] == 0 and len(status["files"]) == 1
    assert run("board", "decode", "log", "--out", "r")[0] == 0


def test_bench_check_passes_and_fails_with_a_plot(run, tmp_path):
    good = bench_log(tmp_path / "good.bin")
    code, out, err = run("board", "bench", good, "--channel", "pump_a", "--json")
    result = json.loads(out)
    assert code == 0 and result["passed"] and result["mean_a"] == pytest.approx(1.0, abs=0.01), err
    assert (tmp_path / "bench-pump_a.png").stat().st_size > 5000
    code, out, _ = run("board", "bench", bench_log(tmp_path / "bad.bin", 1.1), "--channel", "pump_a")
    assert code == 1 and out.startswith("FAIL") and "budget" in out


def test_wiggle(run, tmp_path):
    code, out, err = run("board", "wiggle", bench_log(tmp_path / "good.bin"), "--json")
    assert code == 0 and json.loads(out)["passed"], err
    assert (tmp_path / "wiggle.png").exists()
    assert run("board", "wiggle", tmp_path / "good.bin", "--channel", "brake")[0] == 1


def test_zero_writes_a_calibration(run, tmp_path):
    log = bench_log(tmp_path / "x.bin")
    code, out, err = run("board", "zero", log, "--end-s", 5, "--out", "c.toml", "--json")
    assert code == 0, err
    assert json.loads(out)["zeros"]["main"]["zero_counts"] == pytest.approx(512, abs=0.3)
    assert run("board", "bench", log, "--channel", "pump_a", "--calibration", "c.toml")[0] == 0
    code, _, err = run("board", "zero", log, "--begin-s", 8, "--end-s", 14)
    assert code == 1 and "nothing runs" in err


def test_power(run):
    code, out, _ = run("board", "power", "--json")
    assert code == 0 and json.loads(out)["extra_power_w"] == pytest.approx(1.28)
    code, out, _ = run("board", "power", "--board", "measurement_board_6", "--toml")
    assert code == 0 and out.startswith('devices = ["measurement_board_6"')
    code, _, err = run("board", "power", "--board", "measurement_board_7")
    assert code == 1 and "Did you mean" in err


def test_simulate_and_plot(run, tmp_path):
    code, out, err = run("board", "simulate", "--out", "s", "--yos", 2, "--deepest-m", 15, "--json")
    assert code == 0 and json.loads(out)["samples"] > 1000, err
    assert run("board", "plot", "s/board.bin", "--channel", "pump_a", "--out", "p")[0] == 0
    assert (tmp_path / "p" / "currents.png").stat().st_size > 5000


def test_ports(run):
    code, out, _ = run("board", "ports", "--json")
    assert code == 0 and "ports" in json.loads(out)


def test_energy_of_comet(run, real, tmp_path):
    recording = real("recordings", "comet2019", "comet2019.nc")
    code, out, err = run("energy", "fit", recording, "--out", "v.toml", "--name", "comet", "--json")
    assert code == 0, err
    result = json.loads(out)
    assert result["pump"]["strokes"] == 58 and 6.0 < result["quantities"][SLOPE]["value"] < 12.0
    assert {p.name for p in tmp_path.iterdir()} >= {"v.toml", "v-energy.png", "v-currents.png"}
    from glider_jax.readers.vehicles import read_vehicle

    assert read_vehicle(tmp_path / "v.toml").value(SLOPE) == pytest.approx(
        result["quantities"][SLOPE]["value"], rel=1e-6
    )
    code, out, _ = run("energy", "events", recording, "--out", "e", "--json")
    assert code == 0 and len(json.loads(out)["events"]) == 116
    assert len((tmp_path / "e" / "events.csv").read_text().splitlines()) == 117


def test_energy_of_a_board_log_beside_the_gliders_recording(run, tmp_path):
    import xarray as xr

    from glider_jax.board.simulate import Plan, simulate

    flight = simulate(Plan(depths=(12.0, 25.0, 40.0, 30.0)), 5)
    (tmp_path / "board.bin").write_bytes(flight.encode())
    g = flight.glider
    columns = {
        "m_depth": ("time", g.depth),
        "m_battery": ("time", g.voltage),
        "m_ballast_pumped": ("time", 1e6 * g.volume),
        "m_pressure": ("time", g.depth / 10),
    }
    coords = {"time": ("time", g.time, {"units": "seconds since 1970-01-01T00:00:00Z"})}
    xr.Dataset(columns, coords).to_netcdf(tmp_path / "glider.nc")
    code, out, err = run("energy", "fit", "glider.nc", "--board", "board.bin", "--out", "o", "--json")
    assert code == 0, err
    result = json.loads(out)
    slope = result["quantities"][SLOPE]
    assert abs(slope["value"] - 6.0) < 3 * slope["sigma"] and slope["sigma"] < 0.6
    assert not result["brake_included_in_pump"] and "zero of the main sensor" in err
    assert result["board_against_counter"] is None and 0.02 < result["servos_w"] < 0.2
    assert (tmp_path / "o" / "vehicle.toml").exists()

    columns |= {
        "m_coulomb_current": ("time", g.current),
        "m_coulomb_amphr": ("time", g.charge / 3600.0),
        "m_coulomb_amphr_total": ("time", 10.0 + g.charge / 3600.0),
    }
    xr.Dataset(columns, coords).to_netcdf(tmp_path / "counted.nc")
    code, out, err = run("energy", "fit", "counted.nc", "--board", "board.bin", "--out", "c", "--json")
    assert code == 0, err
    merged = json.loads(out)
    assert merged["quantities"][SLOPE] == slope and "zero of the main sensor" not in err
    hotel = merged["quantities"]["energy.hotel"]
    assert abs(hotel["value"] - 1.6) < 3 * hotel["sigma"] and hotel["sigma"] < 0.05
    check = merged["board_against_counter"]
    assert check["against"] == "coulomb counter" and abs(check["gain_less_one"]) < 0.08
    code, out, err = run("energy", "fit", "counted.nc", "--board", "board.bin", "--out", "c")
    assert (
        code == 0
        and "steady load dive" in out
        and "board against coulomb counter: " in out
        and "pitch and fin servos" in out
    ), err


def test_energy_of_a_board_log_whose_clock_jumped(run, tmp_path):
    import xarray as xr

    from glider_jax.board.simulate import Plan, simulate

    flight = simulate(Plan(depths=(12.0, 25.0, 18.0)), 5)
    late = flight.utc_ms + np.where(np.arange(flight.utc_ms.size) > flight.utc_ms.size - 2000, 90_000, 0)
    (tmp_path / "board.bin").write_bytes(frames.encode_revision_1(flight.counts, boot=1, utc_ms=late))
    g = flight.glider
    columns = {"m_depth": ("time", g.depth), "m_battery": ("time", g.voltage)}
    columns |= {"m_ballast_pumped": ("time", 1e6 * g.volume), "m_pressure": ("time", g.depth / 10)}
    coords = {"time": ("time", g.time, {"units": "seconds since 1970-01-01T00:00:00Z"})}
    xr.Dataset(columns, coords).to_netcdf(tmp_path / "glider.nc")
    code, _, err = run("energy", "fit", "glider.nc", "--board", "board.bin", "--no-plots")
    assert code == 1 and "+90.0 s at tick" in err and "--clock-steps keep" in err
    words = ("energy", "fit", "glider.nc", "--board", "board.bin", "--no-plots", "--clock-steps", "keep")
    assert run(*words)[0] == 0


def test_a_log_of_mixed_rates_through_the_commands(run, tmp_path):
    from glider_jax.board import revision2
    from glider_jax.board.simulate import Plan, simulate

    flight = simulate(Plan(depths=(12.0, 20.0)), 5)
    setup = revision2.Setup(dividers=(4, 0, 0, 1, 1, 2, 8, 8))
    (tmp_path / "board.bin").write_bytes(revision2.sample(setup, flight.counts, 1, flight.utc_ms)[0])
    code, out, err = run("board", "decode", "board.bin", "--out", "r", "--json")
    assert code == 0, err
    ticks = len(flight.counts)
    expected = {"main": -(-ticks // 4), "pump_a": ticks, "pump_b": ticks, "brake": -(-ticks // 2)}
    assert json.loads(out)["samples_by_channel"] == expected | {
        "pitch": -(-ticks // 8),
        "fin": -(-ticks // 8),
    }
    for log in ("board.bin", "r"):
        assert run("board", "plot", log, "--out", "p")[0] == 0
        code, out, err = run("board", "zero", log, "--end-s", 40, "--out", "c.toml", "--json")
        zeros = json.loads(out)["zeros"]
        for name in ("main", "pump_a", "brake", "fin"):
            channel = flight.board[name]
            # At the start the main sensor carries the load of the surface.
            extra = 0.283 / channel.amperes_per_count if name == "main" else 0.0
            assert zeros[name]["zero_counts"] == pytest.approx(channel.zero + extra, abs=0.6)


def test_help_starts_without_heavy_imports():
    import subprocess

    code = (
        "import sys; import glider_jax_cli.board, glider_jax_cli.energy, glider_jax.board.capture;"
        "bad = {'jax', 'xarray', 'scipy', 'matplotlib', 'serial'} & set(sys.modules); sys.exit(str(bad) if bad else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
