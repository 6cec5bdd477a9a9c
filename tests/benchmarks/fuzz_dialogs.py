"""Throw damaged and random text at the dialog and state readers, and check what comes out.

Run with ``python -m tests.benchmarks.fuzz_dialogs --count 1000000 --seed 1``. The corpus is the tests' own printouts
and, where they are at hand, the real logs. Only ``DataError`` may come out; every position, age and number that is
given must be possible. The first input that fails is written to ``--keep`` and ends the run with code 1.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import sys
import time
from pathlib import Path

from glider_jax.errors import DataError
from glider_jax.readers.dialogs import DialogLog, read_dialog
from glider_jax.readers.glider_state import GliderState, read_glider_state
from glider_jax.readers.live_state import latest_state
from tests.readers.dialog_layouts import MOMENT, printout, state_file

HERE = Path(__file__).resolve().parent
SHARED = Path(os.environ.get("GLIDER_JAX_SHARED", HERE.parents[2] / "shared")) / "real" / "live"
REAL = ("swfsc_terminal_logs/*", "composed/*", "dockserver/*.xml")
WORDS = [
    w.encode("latin-1")
    for w in (
        "1e+308", "69696969.000", "-69696969", "nan", "inf", "-0", "1e999", "9" * 25, "0000.000", "\xb2", "%s", "\\x00",
        "sensor:", "GPS Location:", "secs ago", "Curr Time: ", "MT: ", "Vehicle Name: ", "MissionNum:", "Because:",
        "GliderDos A 8 >", "GliderLAB N -1 >", "RESUMING MISSION", "End of Mission", "Waypoint: (0,0)", "(", "[", "{",
        "Connection Event: Carrier Detect found", "MissionSTARTDate:", "Mission Number: a-2027-123-0-1 ", "\r", "\n",
        "ABORT HISTORY: total since reset: \xb2", "<report>", "</report>", "<gliderState>", "<lat>", "</time>", "&amp;",
        "2027-05-04T12:30:01Z sfmc.a.DIALOG ", "\r\n", "\x08", "\x1b[2J", " 99999 1 sensor: m_x = 1 v\n", "\x00",
        "../../etc/passwd", "Feb 30 25:61:61 0000",
    )
]  # fmt: skip


def corpus() -> list[bytes]:
    """Texts to damage: one surfacing, several, two gliders, a state file, and the real files that are here."""
    later = printout(MOMENT + 7200.0, number="kelp7-2027-123-0-42", inflections=126)
    other = printout(MOMENT + 30.0, vehicle="kelp8", number="kelp8-2027-123-0-9")
    bare = printout(MOMENT + 60.0, number=None, menu=False)
    places = [(MOMENT + 60.0 * i, MOMENT + 60.0 * i - 20.0, " 5412.000", "-1020.000") for i in range(4)]
    texts = [printout(), bare, printout() + "RESUMING MISSION\n" + later, other + bare, state_file(places)]
    files = [path for pattern in REAL for path in sorted(SHARED.glob(pattern))]
    return [t.encode() for t in texts] + [f.read_bytes() for f in files]


def starts(texts: list[bytes]) -> list[tuple[int, int]]:
    """Places (text, offset) at which lines of a dialog or state stand, so that most pieces have something in them."""
    marks = (
        b"Vehicle Name",
        b"Curr Time",
        b"GPS ",
        b"secs ago",
        b"<report>",
        b"ABORT",
        b"Waypoint",
        b"Glider",
        b"sensor:",
    )
    found = []
    for i, text in enumerate(texts):
        for mark in marks:
            at = text.find(mark)
            while at >= 0:
                found.append((i, at))
                at = text.find(mark, at + 1)
    return found


def piece(draw: random.Random, texts: list[bytes], places: list[tuple[int, int]], longest: int) -> bytes:
    """A cut of one text, most often where a dialog stands."""
    if draw.random() < 0.9:
        which, at = draw.choice(places)
        at = max(0, at - draw.randrange(120))
    else:
        which = draw.randrange(len(texts))
        at = draw.randrange(len(texts[which]))
    return texts[which][at : at + draw.randrange(1, longest)]


def damaged(draw: random.Random, texts: list[bytes], places: list[tuple[int, int]]) -> bytes:
    """One input: random bytes, or one to three pieces spliced, then flipped, cut, doubled, shuffled and salted."""
    if draw.random() < 0.03:
        return draw.randbytes(draw.randrange(300))
    raw = bytearray()
    for _ in range(draw.choice((1, 1, 1, 2, 3))):
        raw += piece(draw, texts, places, 700)
    for _ in range(draw.randrange(6)):
        if not raw:
            break
        what, at = draw.randrange(8), draw.randrange(len(raw))
        if what == 0:
            raw[at] ^= 1 << draw.randrange(8)
        elif what == 1:
            raw[at] = draw.randrange(256)
        elif what == 2:
            del raw[at : at + draw.randrange(1, 40)]
        elif what == 3:
            raw[at:at] = draw.choice(WORDS)
        elif what == 4:
            raw[at:at] = raw[max(0, at - draw.randrange(1, 200)) : at]
        elif what == 5:
            raw[at : at + draw.randrange(12)] = draw.choice(WORDS)
        elif what == 6:
            lines = raw.split(b"\n")
            draw.shuffle(lines)
            raw = bytearray(b"\n".join(lines))
        else:
            for _ in range(draw.randrange(1, 30)):
                raw[draw.randrange(len(raw))] ^= 1 << draw.randrange(8)
    return bytes(raw)


def check_log(log: DialogLog) -> None:
    """Everything that a log gives is possible."""
    times = [s.time for s in log.surfacings if math.isfinite(s.time)]
    assert times == sorted(times)
    for one in log.surfacings:
        places = [
            p for p in (one.gps, one.dead_reckoned, one.too_far, one.invalid, *one.fixes) if p is not None
        ]
        assert all(abs(p.latitude) <= 90.0 and abs(p.longitude) <= 180.0 and p.age >= 0.0 for p in places)
        assert all(math.isfinite(d.value) and d.age >= 0.0 for d in one.sensors.values())
        assert all(math.isfinite(d.value) for d in one.defaults.values())
        words = (
            one.vehicle,
            one.mission,
            one.mission_number,
            one.reason,
            one.behavior,
            one.evidence,
            *one.errors,
        )
        assert all(w.isascii() and (not w or w.isprintable()) and len(w) <= 220 for w in words)
        assert one.state in ("in mission", "not in mission", "unknown") and one.dumps >= 1
        if one.waypoint is not None:
            assert abs(one.waypoint.latitude) <= 90.0 and not one.waypoint.range < 0.0
    assert all(r.count > 0 for r in log.repairs)


def check_state(state: GliderState) -> None:
    """Everything that a state gives is possible."""
    assert list(state.surface_times) == sorted(state.surface_times)
    assert all(abs(f.latitude) <= 90.0 and abs(f.longitude) <= 180.0 and f.age >= 0.0 for f in state.fixes)


def one_input(raw: bytes, number: int) -> None:
    """Read one input as a log, some also as text, as a state, and merged as of a moment."""
    log = read_dialog(raw if number % 4 else raw.decode("utf-8", "replace"))
    check_log(log)
    if number % 8 == 0 or b"<report>" in raw:
        try:
            state = read_glider_state(raw if b"<gliderState" in raw else b"<gliderState>" + raw)
        except DataError:
            return
        check_state(state)
        try:
            live = latest_state([log, state], now=None if number % 16 else MOMENT)
            live.fix(3600.0)
        except DataError:
            return


def main() -> int:
    """Run until the count or the time is reached; print how many inputs there were."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--count", type=int, default=1_000_000)
    options.add_argument("--seconds", type=float, default=math.inf)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--keep", type=Path, default=Path("fuzz_failure.bin"))
    said = options.parse_args()
    draw, texts = random.Random(said.seed), corpus()
    places = starts(texts)
    begin, slowest, size, number, raw = time.perf_counter(), 0.0, 0, 0, b""
    whole = False
    try:
        while number < said.count:
            raw = damaged(draw, texts, places)
            before = time.perf_counter()
            if before - begin > said.seconds:
                break
            one_input(raw, number)
            slowest, size, number = max(slowest, time.perf_counter() - before), size + len(raw), number + 1
            if number % 100_000 == 0:
                print(f"{number} inputs, {time.perf_counter() - begin:.0f} s", flush=True)
        whole = True
    finally:
        if not whole:
            said.keep.write_bytes(raw)
            print(f"stopped at input {number} of seed {said.seed}; it is in {said.keep}", file=sys.stderr)
    print(
        f"{number} inputs, seed {said.seed}, {len(texts)} texts, mean {size / max(1, number):.0f} bytes, "
        f"{time.perf_counter() - begin:.0f} s, slowest {1e3 * slowest:.0f} ms, 0 failures"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
