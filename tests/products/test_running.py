"""Large runs: stopped and taken up, damaged checkpoints, and several processes on one machine."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace

import netCDF4
import numpy as np
import pytest

from glider_jax.errors import DataError
from glider_jax.products import running
from glider_jax.products.atomic import Terminated, termination_raises
from glider_jax.products.checkpoint import NAME, Checkpoint, undivided
from glider_jax.products.job import Options, run_ensemble

OPTIONS = Options(n=12, days=0.5, outputs=frozenset({"nc", "json"}))


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr(running, "CHUNK", 4)
    monkeypatch.setattr(running, "STREAM_ABOVE", 8)
    monkeypatch.setattr(running, "EVERY", 0.0)


def same(one, other):
    """Whether two folders hold the same forecast, to the bit."""
    a, b = (json.loads((folder / "summary.json").read_text()) for folder in (one, other))
    for found in (a, b):
        found["provenance"].pop("created")
    assert a == b
    with netCDF4.Dataset(one / "forecast.nc") as x, netCDF4.Dataset(other / "forecast.nc") as y:
        assert set(x.variables) == set(y.variables)
        for name in x.variables:
            x[name].set_auto_mask(False)
            y[name].set_auto_mask(False)
            assert x[name][...].tobytes() == y[name][...].tobytes(), name
        assert x.geospatial_lat_max == y.geospatial_lat_max
    return a


def stop_after(members):
    def progress(done):
        if done >= members:
            os.kill(os.getpid(), signal.SIGTERM)

    return progress


def test_a_stopped_run_is_taken_up_to_the_same_bit(small_chunks, tmp_path):
    run_ensemble(OPTIONS, tmp_path / "whole")
    folder = tmp_path / "stopped"
    with pytest.raises(Terminated), termination_raises():
        run_ensemble(OPTIONS, folder, stop_after(8))
    told = json.loads((folder / "summary.partial.json").read_text())
    assert told["forecast"]["members"] == 8 and told["forecast"]["complete"] is False
    with netCDF4.Dataset(folder / "forecast.partial.nc") as data:
        assert data.complete == 0 and data.members_written == 8
    assert not (folder / "forecast.nc").exists() and (folder / NAME).exists()

    flown = []
    run_ensemble(OPTIONS, folder, flown.append, resume=True)
    assert flown == [12]
    found = same(tmp_path / "whole", folder)
    assert found["forecast"]["members"] == 12 and found["forecast"]["complete"] is True
    assert not (folder / NAME).exists() and not (folder / "summary.partial.json").exists()


def test_a_checkpoint_serves_one_question_only(small_chunks, tmp_path):
    with pytest.raises(DataError, match="found none"):
        run_ensemble(OPTIONS, tmp_path, resume=True)
    with pytest.raises(Terminated), termination_raises():
        run_ensemble(OPTIONS, tmp_path, stop_after(4))
    with pytest.raises(DataError, match="other inputs, options or code"):
        run_ensemble(replace(OPTIONS, seed=5), tmp_path, resume=True)
    (tmp_path / "forecast.partial.nc").unlink()
    with pytest.raises(DataError, match="the unfinished file"):
        run_ensemble(OPTIONS, tmp_path, resume=True)
    (tmp_path / NAME).write_bytes(b"not a checkpoint")
    with pytest.raises(DataError, match="cannot be read"):
        run_ensemble(OPTIONS, tmp_path, resume=True)
    # Without the wish to resume, what is left is replaced.
    run_ensemble(OPTIONS, tmp_path)
    assert (tmp_path / "forecast.nc").exists() and not (tmp_path / NAME).exists()


def test_a_short_run_that_is_stopped_leaves_what_it_flew(monkeypatch, tmp_path):
    monkeypatch.setattr(running, "CHUNK", 4)
    with pytest.raises(KeyboardInterrupt):

        def progress(done):
            raise KeyboardInterrupt

        run_ensemble(OPTIONS, tmp_path, progress)
    with netCDF4.Dataset(tmp_path / "forecast.partial.nc") as data:
        assert data.members_written == 4
        assert np.isfinite(data["lat"][:4]).all()


def test_a_signal_waits_for_the_end_of_what_must_not_be_divided():
    seen = []
    with pytest.raises(Terminated), termination_raises():
        with undivided():
            os.kill(os.getpid(), signal.SIGTERM)
            seen.append("whole")
        seen.append("never")
    assert seen == ["whole"]


def test_a_checkpoint_returns_what_was_kept(tmp_path):
    point = Checkpoint(tmp_path, "question")
    assert point.load() is None
    point.save(done=3, values=np.arange(3))
    state = Checkpoint(tmp_path, "question").load()
    assert state["done"] == 3 and state["values"].tolist() == [0, 1, 2]
    with pytest.raises(DataError):
        Checkpoint(tmp_path, "another").load()
    point.remove()
    assert point.load() is None


def test_two_processes_fly_what_one_does(tmp_path):
    command = [sys.executable, "-m", "glider_jax_cli.main", "ensemble", "--n", "24", "--days", "0.5",
               "--format", "nc,json", "--out"]  # fmt: skip
    environment = os.environ | {"JAX_PLATFORMS": "cpu"}
    for folder, more in (("one", []), ("two", ["--processes", "2"])):
        subprocess.run([*command, str(tmp_path / folder), *more], check=True, env=environment, timeout=600)
    same(tmp_path / "one", tmp_path / "two")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--processes", "0"], "--processes"),
        (["--processes", "2", "--process-id", "2", "--coordinator", "127.0.0.1:1"], "--process-id"),
        (["--processes", "2", "--process-id", "0"], "--coordinator"),
    ],
)
def test_numbers_of_processes_that_do_not_fit_are_explained(more, said, tmp_path):
    command = [sys.executable, "-m", "glider_jax_cli.main", "ensemble", "--n", "4", "--days", "0.2", "--out",
               str(tmp_path), *more]  # fmt: skip
    found = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert found.returncode == 1 and said in found.stderr and "Traceback" not in found.stderr
