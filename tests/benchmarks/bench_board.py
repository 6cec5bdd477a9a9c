"""Measure the board's decoder: undetected damage, speed and memory, and the coverage of fitted models.

Run: ``python -m tests.benchmarks.bench_board corruption|noise|speed|coverage``. Results are printed as JSON.
"""

from __future__ import annotations

import argparse
import json
import resource
import time

import numpy as np

from glider_jax.board import frames
from glider_jax.board.crc import crc_many
from glider_jax.board.decoder import Decoder, decode_bytes
from glider_jax.board.faults import KINDS, damage
from glider_jax.errors import DataError

SIZE = 22


def corruption(total: int, seed: int = 0, run: int = 20_000) -> dict:
    """Damage every second frame of streams until ``total`` are damaged; count samples that are wrong and
    believed."""
    rng = np.random.default_rng(seed)
    result = dict.fromkeys(
        (
            "damaged_frames",
            "wrong_samples",
            "out_of_order",
            "untouched_lost",
            "damaged_but_intact",
            "failed_checks",
        ),
        0,
    )
    by_kind = dict.fromkeys(KINDS, 0)
    single_a = 0
    begin = time.process_time()
    while result["damaged_frames"] < total:
        kind = KINDS[(result["damaged_frames"] // (run // 2)) % len(KINDS)]
        counts = rng.integers(0, 1024, (run, 8)).astype(np.uint16)
        raw = frames.encode_revision_1(counts)
        pieces = [raw[i : i + SIZE] for i in range(0, len(raw), SIZE)]
        for index in range(1, run, 2):
            pieces[index] = damage(pieces[index], kind, rng)
        batch, report = decode_bytes(b"".join(pieces))
        tick, got = batch.samples[0].tick, batch.samples[0].counts
        real = tick < run
        result["wrong_samples"] += int((~real).sum() + (got[real] != counts[tick[real]]).any(axis=1).sum())
        result["out_of_order"] += int(np.count_nonzero(np.diff(tick) <= 0))
        result["untouched_lost"] += int(np.count_nonzero(~np.isin(np.arange(0, run, 2), tick)))
        result["damaged_but_intact"] += int(np.count_nonzero(tick % 2 == 1))
        result["failed_checks"] += report.damaged
        result["damaged_frames"] += run // 2
        by_kind[kind] += run // 2
        touched = [
            (p, raw[SIZE * i : SIZE * (i + 1)]) for i, p in zip(range(1, run, 2), pieces[1::2], strict=True)
        ]
        whole = [
            p for p, before in touched if len(p) == SIZE and p[:4] == before[:4] and p[:-2] != before[:-2]
        ]
        if whole:
            body = np.frombuffer(b"".join(whole), dtype=np.uint8).reshape(-1, SIZE)
            stored = body[:, SIZE - 4 : SIZE - 2].copy().view("<u2")[:, 0]
            found = crc_many(np.ascontiguousarray(body[:, 2 : SIZE - 4]).view("<u2")) & 0xFFFF
            single_a += int(np.count_nonzero(found == stored))
    result["cpu_s"] = time.process_time() - begin
    result["by_kind"] = by_kind
    result["would_pass_one_crc16"] = int(single_a)
    result["expected_undetected_per_million"] = (
        1e6 * result["failed_checks"] / result["damaged_frames"] / 2**32
    )
    return result


def noise(total: int, seed: int = 1) -> dict:
    """Decode pure noise rich in sync bytes; count frames that are believed."""
    rng = np.random.default_rng(seed)
    decoder, step = Decoder(), 1 << 20
    for _ in range(total // step):
        block = rng.integers(0, 256, step, dtype=np.uint8)
        places = rng.integers(0, step - 4, step // 40)
        for offset, value in enumerate((*frames.SYNC, 0x10, 10)):
            block[places + offset] = value
        decoder.feed(block)
    decoder.feed(b"", final=True)
    try:
        decoder.check()
    except DataError as error:
        text = str(error)
    else:
        text = "believed"
    return {
        "bytes": total // step * step,
        "frames": decoder.report.frames,
        "candidates": decoder.report.damaged,
        "error": text,
    }


def speed(days: float, channels: int = 8) -> dict:
    """Decode a log of so many days piece by piece from memory that is reused; CPU seconds and peak memory."""
    rng = np.random.default_rng(0)
    block = 1 << 17
    counts = np.clip(np.rint(512 + rng.normal(0, 0.6, (block, channels))), 1, 1022).astype(np.uint16)
    counts[1000:1700, 3] += 90
    ticks = int(days * 86_400 / frames.TICK)
    decoder = Decoder()
    spent, done, size = 0.0, 0, 0
    after_first = None
    while done < ticks:
        # Encoding is not measured; it makes each piece fresh so that numbers go on.
        utc = 1_700_000_000_000 + 32 * np.arange(done, done + block)
        raw = frames.encode_revision_1(counts, first=done, utc_ms=utc)
        begin = time.process_time()
        for at in range(0, len(raw), 1 << 20):
            decoder.feed(raw[at : at + (1 << 20)])
        spent += time.process_time() - begin
        done, size = done + block, size + len(raw)
        if after_first is None and done > 10 * block:
            after_first = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    decoder.feed(b"", final=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "days": days,
        "bytes": size,
        "samples": decoder.report.samples,
        "missing": decoder.report.follower.missing,
        "cpu_s": spent,
        "times_real_time": done * frames.TICK / spent,
        "peak_mib": peak / 1024,
        "growth_mib_since_first_pieces": (peak - (after_first or peak)) / 1024,
    }


def coverage(seeds: int) -> dict:
    """Simulated missions through frames, decoder, events and fits: how often the model that flew is
    returned."""
    from tests.board.test_fits import board_fit, covered

    each = joint = 0
    single: dict[str, int] = {}
    for seed in range(seeds):
        model, truth = board_fit(seed)
        a, b = covered(model, truth)
        each, joint = each + a, joint + b
        for name, half in model.intervals(0.95, simultaneous=False).items():
            single[name] = single.get(name, 0) + int(abs(model.estimates[name].value - truth[name]) <= half)
    return {"seeds": seeds, "simultaneous_95": each, "joint_region_95": int(joint), "single_95": single}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("corruption", "noise", "speed", "coverage"))
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--days", type=float, default=26.0)
    parser.add_argument("--seeds", type=int, default=100)
    chosen = parser.parse_args()
    calls = {
        "corruption": lambda: corruption(chosen.frames),
        "noise": lambda: noise(1 << 28),
        "speed": lambda: speed(chosen.days),
        "coverage": lambda: coverage(chosen.seeds),
    }
    print(json.dumps(calls[chosen.what](), indent=1))
