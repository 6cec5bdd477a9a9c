"""Every command printed in the README and the docs exists, takes the options it is printed with, and runs.

Commands on files that a reader would bring are parsed only; those on bundled data run as printed, with ``--slow`` where
that takes over ten seconds. A shell is played: lines are joined, comments cut, and patterns become two names.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command

from glider_jax.readers.vehicles import presets
from glider_jax_cli import main as entry

ROOT = Path(__file__).resolve().parents[1]
TEXTS = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
#: Commands that take hours as printed: their parts have tests of their own.
ENDLESS = ("prove",)
#: Parameters that name what is read.
READ = set(
    "mission vehicle currents bathymetry seafloor_from hydrography tides grid speeds polygons dialog recording "
    "recordings paths log board calibration flown flown_mission real".split()
)
#: Commands that need an input but no option in particular: without words the text only names them.
NAMED = ("next", "scores")
#: Options of commands that need an interrupted run or another machine; tests/products/test_running.py has them.
ELSEWHERE = ("--resume", "--process-id")
#: Members beyond which a command takes minutes; such a command is run with as many.
MANY = 20_000
QUICK = ("terms", "doctor", "data", "board", "mission")
_FENCE = re.compile(r"^[ ]*```[^\n]*\n(.*?)^[ ]*```", re.S | re.M)
_INLINE = re.compile(r"`((?:glider-forecast|pytest)\b[^`]*)`")


def printed(text: str) -> list[str]:
    """Commands of a text, as a shell would read them, in order and without repeats."""
    found = []
    for block in _FENCE.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            line = line.strip().removeprefix("$ ")
            for part in line.split("&&"):
                part = part.strip().removeprefix(".venv/bin/")
                if part.startswith(("glider-forecast ", "pytest ", "python -m pytest")):
                    found.append(part)
    found += [" ".join(part.split()) for part in _INLINE.findall(_FENCE.sub("", text))]
    return list(dict.fromkeys(" ".join(shlex.split(part, comments=True)) for part in found))


COMMANDS = list(dict.fromkeys(command for path in TEXTS for command in printed(path.read_text(encoding="utf-8"))))
OURS = [command for command in COMMANDS if command.startswith("glider-forecast")]
TESTS = [command for command in COMMANDS if "pytest" in command]


def words_of(command: str) -> list[str]:
    """The words after the program's name; patterns become two names, as if files were there."""
    words = []
    for word in shlex.split(command)[1:]:
        if word.endswith("..."):
            words += [word[:-3] + "1", word[:-3] + "2"]
        else:
            words += [word.replace("*", "1"), word.replace("*", "2")] if "*" in word else [word]
    return words


def context_of(command: str):
    """The command's parsed context, or None where the text only names it or asks for its help."""
    found, rest = get_command(entry.app), words_of(command)
    while hasattr(found, "commands") and rest and not rest[0].startswith("-"):
        assert rest[0] in found.commands, f"{command}: no command '{rest[0]}'"
        found = found.commands[rest.pop(0)]
    if hasattr(found, "commands") or "--help" in rest:
        return None
    if not rest and (found.name in NAMED or any(param.required for param in found.params)):
        return None
    return found.make_context(command, rest)


def inputs(context) -> list[str]:
    """Files a command would read that are not here."""
    wanted = []
    for param in context.command.params:
        value = context.params.get(param.name)
        if value is None or param.name not in READ:
            continue
        wanted += [str(one) for one in (value if isinstance(value, list | tuple) else [value])]
    known = {"none", *presets()}
    return [name for name in wanted if name not in known and ":" not in name and not (ROOT / name).exists()]


def test_there_are_commands_to_check():
    assert len(OURS) >= 15 and any("ensemble --n 5000" in command for command in OURS)


@pytest.mark.parametrize("command", OURS)
def test_the_printed_command_parses(command):
    context_of(command)


@pytest.mark.parametrize("command", TESTS)
def test_the_printed_test_exists(command):
    known = {"--validation", "--slow", "--benchmarks", "-s", "-q", "-x", "-m"}
    for word in shlex.split(command):
        if word.startswith("-"):
            assert word in known, command
        elif "/" in word:
            assert (ROOT / word.split("::")[0]).exists(), command


def runnable() -> list:
    """Commands on bundled data, the long ones marked slow."""
    found = []
    for command in OURS:
        context = context_of(command)
        name = words_of(command)[0]
        wanting = context is not None and inputs(context)
        if name in ENDLESS or "fetch" in command or wanting or any(word in command for word in ELSEWHERE):
            continue
        quick = context is None or name in QUICK
        found.append(pytest.param(command, marks=() if quick else pytest.mark.slow, id=command))
    return found


def run(words: list[str], folder: Path, cache: Path) -> subprocess.CompletedProcess:
    """Run a command in an empty folder."""
    import os

    code = "import sys; from glider_jax_cli.main import main; main()"
    env = os.environ | {"GLIDER_JAX_CACHE": str(cache), "COLUMNS": "100"}
    return subprocess.run([sys.executable, "-c", code, *words], cwd=folder, env=env, capture_output=True, text=True,
                          check=False)  # fmt: skip


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.mark.parametrize("command", runnable())
def test_the_printed_command_runs(command, tmp_path, cache):
    words = words_of(command)
    if "--n" in words:
        place = words.index("--n") + 1
        words[place] = str(min(int(words[place]), MANY))
    if context_of(command) is None and "--help" not in words:
        words.append("--help")
    done = run(words, tmp_path, cache)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "Traceback" not in done.stderr


def test_the_main_job_runs_small_as_printed(tmp_path, cache):
    """The first command of the README with fewer members and days leaves the products it is said to leave."""
    (command,) = [c for c in OURS if c == "glider-forecast ensemble --n 5000"]
    words = [word if word != "5000" else "20" for word in words_of(command)]
    done = run([*words, "--days", "0.3"], tmp_path, cache)
    assert done.returncode == 0, done.stderr[-2000:]
    for name in ("forecast.nc", "summary.json", "map.png", "battery.png", "forecast.geojson", "forecast.kmz"):
        assert (tmp_path / "forecast" / name).stat().st_size > 0


def test_the_shell_is_played_rightly():
    first = ["```sh", "$ a", "glider-forecast x --y 1 \\", "   --z 2  # words"]
    text = "\n".join([*first, ".venv/bin/glider-forecast q && pytest t", "```", "`pytest p`"])
    assert printed(text) == ["glider-forecast x --y 1 --z 2", "glider-forecast q", "pytest t", "pytest p"]
    assert words_of("glider-forecast a b/*.nc C...") == ["a", "b/1.nc", "b/2.nc", "C1", "C2"]
