"""Frames: both checks against a plain implementation, and exact round trips of every frame type."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from glider_jax.board import frames, revision2
from glider_jax.board.crc import crc_many, crc_pair
from glider_jax.board.decoder import decode_bytes
from glider_jax.errors import ConfigError

COUNTS = st.integers(0, 1023)


def test_crc_a_has_the_published_check_value():
    assert crc_pair(b"123456789") & 0xFFFF == 0x29B1


@given(st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_fast_checks_equal_the_plain_ones(half, seed):
    data = np.random.default_rng(seed).integers(0, 256, (5, 2 * half), dtype=np.uint8)
    assert [crc_pair(bytes(row)) for row in data] == crc_many(data.view("<u2")).tolist()


def test_generators_have_no_common_factor():
    a, b = (1 << 16) | 0x1021, (1 << 16) | 0x8BB7
    while b:
        while a.bit_length() >= b.bit_length():
            a ^= b << (a.bit_length() - b.bit_length())
        a, b = b, a
    assert a == 1


@given(arrays(np.uint16, st.tuples(st.integers(1, 20), st.integers(1, 16)), elements=COUNTS))
def test_packing_is_exact_and_padded_with_zeros(counts):
    packed = frames.pack_samples(counts)
    assert packed.shape[1] % 2 == 0
    np.testing.assert_array_equal(frames.unpack_samples(packed, counts.shape[1]), counts)
    assert frames.padding_is_zero(packed, counts.shape[1]).all()


def test_packing_is_most_significant_bit_first():
    packed = frames.pack_samples(np.array([[0b1000000001, 0b0111111110]]))
    assert packed.tolist() == [[0b10000000, 0b01011111, 0b11100000, 0]]


@pytest.mark.parametrize("bad", [-1, 1024])
def test_counts_beyond_ten_bits_are_refused(bad):
    with pytest.raises(ConfigError, match="ten-bit"):
        frames.pack_samples(np.array([[bad, 5]]))


@settings(deadline=None, max_examples=60)
@given(
    channels=st.sampled_from([6, 8]),
    ticks=st.integers(1, 80),
    first=st.integers(0, 2**24 - 1),
    boot=st.integers(0, 15),
    timed=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_revision_1_round_trip(channels, ticks, first, boot, timed, seed):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 1024, (ticks, channels)).astype(np.uint16)
    flags = rng.integers(0, 16, ticks)
    utc = rng.integers(0, 2**47) + 32 * np.arange(ticks) if timed else None
    batch, report = decode_bytes(frames.encode_revision_1(counts, first, boot, flags, utc))
    (samples,) = batch.samples
    np.testing.assert_array_equal(samples.counts, counts)
    np.testing.assert_array_equal(samples.tick, first + np.arange(ticks))
    rails = ((counts == 0) | (counts == 1023)).any(axis=1)
    np.testing.assert_array_equal(samples.flags, flags | np.where(rails, frames.SATURATED, 0))
    assert samples.channels == (frames.CHANNELS_8 if channels == 8 else frames.CHANNELS_6)
    assert report.noise == report.follower.missing == report.damaged == 0
    if timed:
        stamped = np.flatnonzero((first + np.arange(ticks)) % 32 == 0)
        np.testing.assert_array_equal(batch.clock[:, 2], utc[stamped])
        np.testing.assert_array_equal(batch.clock[:, 1], first + stamped)


def test_a_stream_fits_the_line_with_margin():
    for channels in (8, 6):
        raw = frames.encode_revision_1(np.full((3200, channels), 512), utc_ms=np.arange(3200) * 32)
        assert frames.line_load(len(raw) / (3200 * frames.TICK)) < 0.75


@st.composite
def setups(draw):
    dividers = draw(st.lists(st.integers(0, 5), min_size=8, max_size=8).filter(any))
    sampled = [name for name, divider in zip(revision2.CHANNELS, dividers, strict=True) if divider]
    return revision2.Setup(
        dividers=tuple(dividers),
        tick_us=draw(st.integers(4000, 65535)),
        trigger_channels=tuple(
            sorted(draw(st.sets(st.sampled_from(sampled), max_size=3)), key=revision2.CHANNELS.index)
        ),
        zero=tuple(draw(st.lists(st.integers(0, 1023), min_size=8, max_size=8))),
        threshold=tuple(draw(st.lists(st.integers(1, 900), min_size=8, max_size=8))),
        pre_roll=draw(st.integers(0, 9)),
        post_roll=draw(st.integers(0, 9)),
        subset_window=draw(st.integers(5, 60)),
        serial=draw(st.integers(0, 65535)),
    )


@given(setups())
def test_setup_round_trip(setup):
    assert revision2.Setup.from_payload(setup.payload()[0]) == setup


@settings(deadline=None, max_examples=60)
@given(setups(), st.integers(1, 200), st.integers(0, 15), st.integers(0, 2**32 - 1))
def test_revision_2_local_log_round_trip(setup, ticks, boot, seed):
    counts = np.random.default_rng(seed).integers(0, 1024, (ticks, 8)).astype(np.uint16)
    utc = 1_700_000_000_000 + 7 * np.arange(ticks)
    local, _ = revision2.sample(setup, counts, boot, utc, clock_every=50)
    batch, report = decode_bytes(local)
    assert batch.setups == (setup,)
    assert report.follower.missing == report.noise == 0
    np.testing.assert_array_equal(batch.clock[:, 2], utc[::50])
    seen = np.zeros((ticks, 8), dtype=bool)
    for part in batch.samples:
        columns = [revision2.CHANNELS.index(name) for name in part.channels]
        np.testing.assert_array_equal(part.counts, counts[part.tick][:, columns])
        seen[np.ix_(part.tick, columns)] = True
    wanted = np.zeros((ticks, 8), dtype=bool)
    for bit, divider in enumerate(setup.dividers):
        if divider:
            wanted[::divider, bit] = True
    if setup.trigger_channels:
        kept = np.zeros(ticks, dtype=bool)
        for tick in range(ticks):
            for name in setup.trigger_channels:
                bit = revision2.CHANNELS.index(name)
                if (
                    wanted[tick, bit]
                    and abs(int(counts[tick, bit]) - setup.zero[bit]) >= setup.threshold[bit]
                ):
                    kept[max(tick - setup.pre_roll, 0) : tick + setup.post_roll + 1] = True
        wanted &= kept[:, None]
        assert sum(t.logged for t in batch.triggers) == np.count_nonzero(wanted.any(axis=1))
        assert sum(t.started for t in batch.triggers) * 2 == len(batch.triggers)
    np.testing.assert_array_equal(seen, wanted)


@settings(deadline=None, max_examples=40)
@given(setups(), st.integers(60, 300), st.integers(0, 2**32 - 1))
def test_revision_2_subset_round_trip(setup, ticks, seed):
    counts = np.random.default_rng(seed).integers(0, 1024, (ticks, 8)).astype(np.uint16)
    _, link = revision2.sample(setup, counts)
    batch, report = decode_bytes(link)
    assert report.samples == 0
    (window,) = batch.subset
    size = setup.subset_window
    assert window.tick.tolist() == list(range(0, ticks // size * size, size))
    for row, first in enumerate(window.tick):
        for column, name in enumerate(window.channels):
            bit = revision2.CHANNELS.index(name)
            taken = np.arange(first, first + size)
            block = counts[taken[taken % setup.dividers[bit] == 0], bit]
            assert abs(window.mean[row, column] - block.mean()) <= 1 / 128 + 1e-9
            assert (window.least[row, column], window.most[row, column]) == (block.min(), block.max())


def test_triggers_log_the_pre_roll_and_say_so():
    counts = np.full((1000, 8), 512)
    counts[500:520, 3] = 700
    setup = revision2.Setup(trigger_channels=("pump_a",), pre_roll=10, post_roll=20)
    batch, _ = decode_bytes(revision2.sample(setup, counts)[0])
    (part,) = batch.samples
    assert part.tick.tolist() == list(range(490, 540))
    assert (part.flags[:10] == frames.PRE_ROLL).all() and (part.flags[10:] == frames.TRIGGERED).all()
    start, end = batch.triggers
    assert (start.started, start.tick, end.started, end.tick, end.logged) == (True, 500, False, 539, 50)


def test_a_triggered_log_is_far_smaller():
    counts = np.full((20_000, 8), 512)
    counts[5000:5600, 3] = 900
    always = revision2.sample(revision2.Setup(), counts)[0]
    triggered = revision2.sample(revision2.Setup(trigger_channels=("pump_a",)), counts)[0]
    assert len(triggered) < 0.05 * len(always)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"dividers": (0,) * 8}, "at least one sampled channel"),
        ({"dividers": (1,) * 7}, "expected 8 numbers"),
        ({"dividers": (300,) + (1,) * 7}, "expected 0 to 255"),
        ({"trigger_channels": ("external",)}, "not sampled"),
        ({"tick_us": 100}, "4000"),
        ({"dividers": (9,) * 8, "subset_window": 5}, "largest divider"),
    ],
)
def test_bad_setups_are_explained(changes, text):
    with pytest.raises(ConfigError, match=text):
        revision2.Setup(**changes)


def test_bytes_per_second_is_what_is_sent():
    setup = revision2.Setup(dividers=(4, 0, 0, 1, 1, 2, 1, 1))
    ticks = 31_250
    local, _ = revision2.sample(setup, np.full((ticks, 8), 512))
    assert len(local) / (ticks * setup.tick) == pytest.approx(setup.bytes_per_second(), rel=1e-3)
