"""``doctor`` finds what is wrong and says what to do; help is a tour with examples; completion works quickly."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import time
from importlib import metadata

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import glider_jax_data
from glider_jax.products import installation
from glider_jax_cli import main as entry
from glider_jax_cli.examples import examples

WIDE = {"COLUMNS": "100", "TERM": "dumb"}


def test_a_whole_installation_is_well(monkeypatch, tmp_path):
    monkeypatch.setenv("GLIDER_JAX_CACHE", str(tmp_path))
    monkeypatch.setenv("XLA_FLAGS", "--xla_force_host_platform_device_count=1")
    done = CliRunner().invoke(entry.app, ["doctor"])
    assert done.exit_code == 0, done.output
    assert "all is well" in done.output and "WRONG" not in done.output
    told = json.loads(CliRunner().invoke(entry.app, ["doctor", "--json"]).output)
    names = {check["name"] for check in told["checks"]}
    assert told["ok"] and {"python", "numpy", "devices", "compilation cache", "bundled data", "presets"} <= names


def test_each_fault_is_found_with_what_to_do(monkeypatch, tmp_path):
    old, absent = installation.check_packages(["numpy>=99", "no-such-package-here>=1", 'x; extra == "dbd"']), None
    package, old, absent = old
    assert old.ok is False and "numpy>=99" in old.todo
    assert absent.ok is False and "pip install" in absent.todo
    (tmp_path / "file").write_text("")
    cache = installation.check_cache(tmp_path / "file" / "cache")
    assert cache.ok is False and "GLIDER_JAX_CACHE" in cache.todo
    copied = tmp_path / "changed.nc"
    copied.write_bytes(b"CDF")
    found = next(installation.check_bundled(lambda name: copied))
    assert found.ok is False and "was changed" in found.found and "install" in found.todo
    missing = next(installation.check_bundled(lambda name: glider_jax_data.path(name + "x")))
    assert missing.ok is False and "missing" in missing.found


def test_a_fault_gives_exit_code_one(monkeypatch, tmp_path):
    monkeypatch.setenv("GLIDER_JAX_CACHE", str(tmp_path))
    broken = [installation.Check("x", True, "fine"), installation.Check("y", False, "gone", "Bring it back.")]
    monkeypatch.setattr(installation, "check_installation", lambda cache: iter(broken))
    done = CliRunner().invoke(entry.app, ["doctor"])
    assert done.exit_code == 1 and "WRONG y: gone" in done.output and "Bring it back." in done.output


def test_versions_are_compared_as_numbers():
    assert installation.numbers("0.10.2") >= installation.numbers("0.6")
    assert installation.numbers("2.4.6+local.1") == (2, 4, 6)
    assert installation.requirement("netCDF4>=1.7,<3") == ("netCDF4", "1.7")


def test_an_uninstalled_package_is_told(monkeypatch):
    def absent(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", absent)
    (only,) = installation.check_packages()
    assert only.ok is False and "pip install" in only.todo


def commands():
    """Every command with its words, groups opened."""
    top = get_command(entry.app)
    for name, command in top.commands.items():
        if hasattr(command, "commands"):
            yield from (((name, inner), one) for inner, one in command.commands.items())
        else:
            yield (name,), command


def test_help_is_a_tour():
    text = CliRunner().invoke(entry.app, ["--help"], env=WIDE).output
    for panel in ("Before a mission", "During a mission", "After a mission", "Measuring energy and", "The tool itself"):
        assert panel in text
    assert "ensemble --n 5000 --html" in text and "next --dialog" in text
    for command in get_command(entry.app).commands.values():
        assert 10 < len(command.get_short_help_str(200)) <= 62, f"{command.name} has no purpose in one line"


@pytest.mark.parametrize("words", [w for w, _ in commands()], ids=" ".join)
def test_every_command_shows_its_help(words):
    done = CliRunner().invoke(entry.app, [*words, "--help"], env=WIDE)
    assert done.exit_code == 0 and "Usage:" in done.output


@pytest.mark.parametrize("words", [w for w, _ in commands()], ids=" ".join)
def test_every_command_has_an_example(words):
    text = CliRunner().invoke(entry.app, [*words, "--help"], env=WIDE).output
    lines = [line for line in text.splitlines() if "Usage:" not in line]
    assert any(f"glider-forecast {' '.join(words)}" in line for line in lines), text


@pytest.mark.parametrize(("words", "line"), examples(), ids=lambda text: text)
def test_every_example_names_commands_and_options_that_exist(words, line):
    command, rest = get_command(entry.app), shlex.split(line)
    while hasattr(command, "commands"):
        command = command.commands[rest.pop(0)]
    command.make_context(line, rest, resilient_parsing=False)


def completed(words: str, number: int) -> str:
    """What bash would offer for a line."""
    env = os.environ | {"_GLIDER_FORECAST_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(number)}
    code = "import sys; sys.argv = ['glider-forecast']; from glider_jax_cli.main import main; main()"
    return subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False).stdout


def test_shells_complete_commands_and_options():
    assert "ensemble" in completed("glider-forecast ens", 1).split()
    assert {"--html", "--hydrography"} <= set(completed("glider-forecast ensemble --h", 2).split())
    env = os.environ | {"_GLIDER_FORECAST_COMPLETE": "source_bash"}
    code = "import sys; sys.argv = ['glider-forecast']; from glider_jax_cli.main import main; main()"
    script = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False).stdout
    assert "complete -o default -F" in script


def test_help_and_completion_start_quickly():
    took = []
    for _ in range(3):
        begin = time.perf_counter()
        assert "plan" in completed("glider-forecast pl", 1)
        took.append(time.perf_counter() - begin)
    assert min(took) < 2.0, took


def test_repeatable_options_take_what_a_shell_expands():
    command = get_command(entry.app).commands["ensemble"]
    line = "--currents a.nc b.nc --start-position 54.45 -7.1 --hydrography c d --hydrography e --n 5"
    params = command.make_context("ensemble", line.split()).params
    assert list(params["currents"]) == ["a.nc", "b.nc"] and [str(p) for p in params["hydrography"]] == ["c", "d", "e"]
    assert tuple(params["start_position"]) == (54.45, -7.1) and params["n"] == 5
    plan = get_command(entry.app).commands["plan"]
    # Where an argument may follow, a word after a value is that argument.
    params = plan.make_context("plan", "--vary pitch=20,26 mission.toml".split()).params
    assert list(params["vary"]) == ["pitch=20,26"] and str(params["mission"]) == "mission.toml"
