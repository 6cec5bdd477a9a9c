"""Programs that outlive the process: read back they compute the same, and what cannot be read is made anew."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from glider_jax.mission import programs
from glider_jax.products import kept_fields
from glider_jax.products.kept_fields import kept_currents
from glider_jax.records import CurrentGrid, Source


def scaled(static, values, factor):
    return {"scaled": values * factor + static, "sum": jnp.sum(values)}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    monkeypatch.setattr(programs, "_known", {})
    yield tmp_path / "programs"
    jax.config.update("jax_compilation_cache_dir", before)


def run(static=1.0, n=4, factor=2.0):
    values = np.arange(n, dtype=np.float32)
    devices = tuple(jax.devices()[:1])
    return jax.tree.map(np.asarray, programs.call("test", scaled, static, devices, values, np.float32(factor)))


def forget(monkeypatch, compiler=None):
    monkeypatch.setattr(programs, "_known", {})
    if compiler is not None:
        monkeypatch.setattr(programs, "_compile", compiler)


def test_a_kept_program_is_read_back_and_takes_new_numbers(folder, monkeypatch):
    first = run()
    np.testing.assert_allclose(first["scaled"], [1, 3, 5, 7])

    def never(*_):
        raise AssertionError("compiled again")

    forget(monkeypatch, never)
    again = run(factor=3.0)
    np.testing.assert_allclose(again["scaled"], [1, 4, 7, 10])
    assert again["sum"] == 6.0 and len(list(folder.glob("*.program"))) == 1


def test_other_shapes_constants_and_source_are_other_programs(folder, monkeypatch):
    run()
    run(n=5)
    run(static=2.0)
    monkeypatch.setattr(programs, "surroundings", lambda: "another version")
    run()
    assert len(list(folder.glob("*.program"))) == 4


@pytest.mark.parametrize("content", [b"", b"not a program", b"\x80\x05N."])
def test_a_damaged_program_is_made_anew(folder, monkeypatch, content):
    run()
    (path,) = folder.glob("*.program")
    path.write_bytes(content)
    forget(monkeypatch)
    np.testing.assert_allclose(run()["scaled"], [1, 3, 5, 7])
    assert path.stat().st_size > 100


def test_only_so_many_are_kept(folder, monkeypatch):
    monkeypatch.setattr(programs, "KEPT", 2)
    for n in range(1, 5):
        run(n=n)
    assert len(list(folder.glob("*.program"))) == 2


def test_a_program_of_one_device_is_read_where_there_are_more(tmp_path):
    code = f"""
import jax, numpy as np
jax.config.update("jax_num_cpu_devices", 2)
jax.config.update("jax_compilation_cache_dir", {str(tmp_path)!r})
from glider_jax.mission import programs
def double(static, values):
    return values * 2
for turn in range(2):
    programs._known.clear()
    found = programs.call("double", double, None, tuple(jax.devices()[:1]), np.ones(3, np.float32))
    if turn == 0:
        programs._compile = None
print(np.asarray(found).tolist(), len(jax.devices()))
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert found.stdout.strip() == "[2.0, 2.0, 2.0] 2", found.stderr


def grid():
    values = np.linspace(0.0, 1.0, 8).reshape(2, 1, 2, 2)
    return CurrentGrid(
        np.array([0.0, 3600.0]), np.zeros(1), np.array([40.0, 41.0]), np.array([-70.0, -69.0]), values, -values,
        Source("made", {"a.nc": "12"}, ("one note",)), east_sd=0.1 * values, filled=0.25, fill_method="linear",
    )  # fmt: skip


def test_a_program_that_jax_has_cached_is_kept_whole(tmp_path):
    text = """
import sys
import jax, jax.numpy as jnp, numpy as np
from glider_jax.mission import programs
jax.config.update("jax_compilation_cache_dir", sys.argv[1])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
# JAX decides at the first compilation of a process whether it caches.
jax.block_until_ready(jax.jit(lambda x: x + 1)(1.0))

def loop(static, values):
    return jax.lax.fori_loop(0, static, lambda k, v: jnp.cumsum(v) / (k + 1.0), values)

def call():
    return np.asarray(programs.call("loop", loop, 5, tuple(jax.devices()[:1]), np.arange(300.0, dtype=np.float32)))

first = call()
programs._known.clear()
programs.surroundings = lambda: "a later version"
call()
programs._known.clear()
def never(*_):
    raise AssertionError("what was kept was not whole")
programs._compile = never
np.testing.assert_array_equal(call(), first)
"""
    done = subprocess.run([sys.executable, "-c", text, str(tmp_path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_kept_currents_are_those_that_were_read(tmp_path):
    file, made = tmp_path / "a.nc", []
    file.write_bytes(b"1")

    def make():
        made.append(1)
        return grid()

    def ask(asked=("box",)):
        return kept_currents(tmp_path / "kept", [file], asked, make)

    first, again = ask(), ask()
    assert len(made) == 1
    for name in ("time", "latitude", "east", "north", "east_sd"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert again.north_sd is None and again.sea is None and again.filled == 0.25 and again.fill_method == "linear"
    assert again.source == first.source and again.constant_in_time is False
    ask(("another box",))
    assert len(made) == 2
    file.write_bytes(b"12")
    ask()
    assert len(made) == 3
    for path in (tmp_path / "kept").glob("*.npz"):
        path.write_bytes(b"damaged")
    ask()
    assert len(made) == 4
    kept_currents(None, [file], ("box",), make)
    assert len(made) == 5


def test_currents_too_large_to_keep_are_not(tmp_path, monkeypatch):
    monkeypatch.setattr(kept_fields, "LARGEST", 10)
    file = tmp_path / "a.nc"
    file.write_bytes(b"1")
    found = kept_currents(tmp_path / "kept", [file], (), lambda: replace(grid(), filled=0.5))
    assert found.filled == 0.5 and not list((tmp_path / "kept").glob("*"))
