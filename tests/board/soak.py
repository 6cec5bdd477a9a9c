"""Capture an emulated board for a long time with faults on the line, and account for every frame.

Run as a script for a soak of any length; the tests call :func:`soak` for seconds. The emulator plays in a
thread, the
capture runs in a process of its own over a pseudo-terminal.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from glider_jax.board import decoder, frames
from glider_jax.board.emulator import Emulator, PtyLine
from glider_jax.board.faults import Fault

CAPTURE = """
import json, sys
from pathlib import Path
from glider_jax.board.capture import Capture, Options
status = Capture(Options(sys.argv[1], Path(sys.argv[2]), rotate_bytes=int(sys.argv[3]), identify_s=0)).run()
print(json.dumps(status.as_dict()))
"""


def faults_for(size: int, rate: float, unplugs: int, others: int, longest_s: float, seed: int) -> list[Fault]:
    """Unplugs of random length and single damaged places, spread over the stream."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.03, 0.97, size=unplugs + others) * size
    kinds = ["unplug"] * unplugs + list(rng.choice(["flip", "burst", "drop", "double", "noise"], size=others))
    return [
        Fault(int(at), str(kind), float(rng.uniform(0.1 * longest_s, longest_s)))
        for at, kind in sorted(zip(places, kinds, strict=True))
    ]


def soak(folder: Path, seconds: float, unplugs: int, others: int, speed: float = 1.0, seed: int = 0) -> dict:
    """Play ``seconds`` of board time at ``speed`` times 9,600 baud and compare what was captured with what
    was sent."""
    rng = np.random.default_rng(seed)
    ticks = int(seconds / frames.TICK)
    counts = rng.integers(1, 1023, size=(ticks, 8)).astype(np.uint16)
    data = frames.encode_revision_1(counts)
    rate = len(data) / seconds * speed
    faults = faults_for(len(data), rate, unplugs, others, min(20.0, seconds / 20) / speed, seed)
    emulator = Emulator(PtyLine(folder / "tty"), data, bytes_per_second=rate, faults=faults, seed=seed)
    thread, stop = emulator.start()
    while not (folder / "tty").exists():
        stop.wait(0.01)
    command = [sys.executable, "-c", CAPTURE, str(folder / "tty"), str(folder / "log"), "1000000"]
    capture = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    thread.join()
    stop.wait(1.0)
    capture.terminate()
    status = json.loads(capture.communicate(timeout=30)[0])

    reader = decoder.Decoder()
    batches = list(decoder.decode_pieces(decoder.read_pieces(folder / "log"), reader))
    parts = [part for batch in batches for part in batch.samples]
    tick = np.concatenate([part.tick for part in parts])
    got = np.concatenate([part.counts for part in parts])
    size = len(data) // ticks
    begins = np.arange(ticks) * size
    whole = np.zeros(ticks, dtype=bool)
    for start, end in emulator.delivered:
        whole |= (begins >= start) & (begins + size <= end)
    follower = reader.report.follower
    lost = np.flatnonzero(whole)[~np.isin(np.flatnonzero(whole), tick)]
    # How many bytes of its delivered stretch lie before and after a lost frame: at its end it was still in the cable,
    # at its beginning it was discarded on opening.
    around = [
        next((begins[row] - start, end - begins[row] - size) for start, end in emulator.delivered if end > begins[row])
        for row in lost
    ]
    return {
        "lost_frames_bytes_before_and_after": [[int(before), int(after)] for before, after in around],
        "seconds": seconds,
        "speed": speed,
        "frames_sent": ticks,
        "frames_delivered_whole": int(whole.sum()),
        "frames_captured": int(tick.size),
        "delivered_but_not_captured": int(lost.size),
        "captured_twice": int(tick.size - np.unique(tick).size),
        "captured_wrong": int(np.count_nonzero((got != counts[tick]).any(axis=1))),
        "missing_reported": follower.missing,
        "missing_true": int(tick[-1] - tick[0] + 1 - tick.size),
        "unplugs": emulator.outages,
        "outages_seen": status["outages"],
        "line_faults": others,
        "files": len(list((folder / "log").glob("*.bin"))),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--unplugs", type=int, default=20)
    parser.add_argument("--faults", type=int, default=200)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        result = soak(
            Path(place), 60.0 * chosen.minutes, chosen.unplugs, chosen.faults, chosen.speed, chosen.seed
        )
    print(json.dumps(result, indent=1))
