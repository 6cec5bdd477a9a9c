"""Examples shown at the foot of each command's help; a test checks that every one of them parses."""

from __future__ import annotations

_EXAMPLES = {
    "dialog": ("dialog unit_network.log", "dialog unit_network.log --all --json"),
    "recording": ("recording recording.nc", "recording from-glider --cache cache"),
    "diagnose": (
        "diagnose recording.nc --vehicle vehicle.toml",
        "diagnose from-glider --mission missions --currents currents.nc --bathymetry etopo.nc --out diagnosis",
    ),
    "terms": ("terms", "terms --base --json"),
    "prove": ("prove --out run --cases 12 --seed 7", "prove --out run --set null --cases 20"),
    "board decode": ("board decode board.log --out board-record",),
    "board capture": ("board capture /dev/ttyUSB0 --out board-capture --duration-s 3600",),
    "board emulate": ("board emulate --link board-port",),
    "board simulate": ("board simulate --out board-simulated --yos 6",),
    "board bench": ("board bench board-record --channel brake --applied-a 0.5",),
    "board wiggle": ("board wiggle board-record --channel fin",),
    "board zero": ("board zero board-record --end-s 60 --out calibration.toml",),
    "board plot": ("board plot board-record --channel pump --out figures",),
    "board power": ("board power", "board power --toml"),
    "board ports": ("board ports",),
    "energy fit": (
        "energy fit recording.nc --out vehicle.toml",
        "energy fit recording.nc --board board-record --out vehicle.toml",
    ),
    "energy events": ("energy events recording.nc --out events",),
    "speeds fit": ("speeds fit recording.nc --out speeds", "ensemble --speeds speeds/speeds.json"),
}


def epilog(words: str) -> str | None:
    """Examples of a command named by its words, a line each; None where its help shows some already."""
    shown = _EXAMPLES.get(words)
    if not shown:
        return None
    title = "Examples:" if len(shown) > 1 else "Example:"
    return "\n\n".join([title, *(f"glider-forecast {line}" for line in shown)])


def examples() -> list[tuple[str, str]]:
    """Every example with the words of the command it belongs to."""
    return [(words, line) for words, shown in _EXAMPLES.items() for line in shown]
