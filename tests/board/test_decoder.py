"""Decoder: damage of every kind, gaps to the sample, streaming, and what is not a log at all."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.board import frames
from glider_jax.board.clock import fit_clock
from glider_jax.board.decoder import Decoder, decode_bytes, read_pieces
from glider_jax.board.faults import KINDS, at_wrong_baud, damage
from glider_jax.board.record import open_record, read_log, write_record
from glider_jax.errors import DataError

SIZE = 22


def log(ticks=400, seed=0, first=0, boot=1, channels=8):
    counts = np.random.default_rng(seed).integers(1, 1023, (ticks, channels)).astype(np.uint16)
    return counts, frames.encode_revision_1(counts, first, boot)


def decoded(batches):
    parts = [part for batch in batches for part in batch.samples]
    return np.concatenate([p.tick for p in parts]), np.concatenate([p.counts for p in parts])


@settings(deadline=None, max_examples=40)
@given(st.lists(st.integers(1, 700), min_size=1, max_size=60), st.integers(0, 2**32 - 1))
def test_the_result_does_not_depend_on_how_bytes_are_cut(cuts, seed):
    rng = np.random.default_rng(seed)
    _, raw = log(200, seed)
    pieces = [raw[i : i + SIZE] for i in range(0, len(raw), SIZE)]
    for index in rng.integers(0, 200, 20):
        pieces[index] = damage(pieces[index], str(rng.choice(KINDS)), rng)
    stream = b"".join(pieces)
    whole, report = decode_bytes(stream)
    decoder, batches, at, turn = Decoder(), [], 0, 0
    while at < len(stream):
        size = cuts[turn % len(cuts)]
        batches.append(decoder.feed(stream[at : at + size]))
        at, turn = at + size, turn + 1
    batches.append(decoder.feed(b"", final=True))
    tick, counts = decoded(batches)
    np.testing.assert_array_equal(tick, whole.samples[0].tick)
    np.testing.assert_array_equal(counts, whole.samples[0].counts)
    assert decoder.report.noise == report.noise
    assert decoder.report.follower.missing == report.follower.missing


@pytest.mark.parametrize("kind", KINDS)
def test_damage_never_gives_a_wrong_sample(kind):
    rng = np.random.default_rng(1)
    counts, raw = log(3000)
    pieces = [raw[i : i + SIZE] for i in range(0, len(raw), SIZE)]
    hurt = np.arange(1, 3000, 2)
    for index in hurt:
        pieces[index] = damage(pieces[index], kind, rng)
    batch, report = decode_bytes(b"".join(pieces))
    (samples,) = batch.samples
    np.testing.assert_array_equal(samples.counts, counts[samples.tick])
    assert (np.diff(samples.tick) > 0).all()
    # Every frame that was not touched is there, unless a false header in front of it was believed: never.
    assert np.isin(np.arange(0, 3000, 2), samples.tick).all()
    present = samples.tick[-1] - samples.tick[0] + 1 - samples.tick.size
    assert report.follower.missing == present


def test_every_gap_is_counted_to_the_sample():
    counts, raw = log(1000)
    gone = [(10, 11), (100, 250), (990, 999)]
    keep = np.ones(1000, dtype=bool)
    for begin, end in gone:
        keep[begin:end] = False
    stream = b"".join(raw[SIZE * i : SIZE * (i + 1)] for i in np.flatnonzero(keep))
    batch, report = decode_bytes(stream)
    assert [(g.before, g.after, g.missing) for g in report.follower.gaps] == [
        (9, 11, 1),
        (99, 250, 150),
        (989, 999, 9),
    ]
    assert report.follower.missing == 160
    np.testing.assert_array_equal(batch.samples[0].counts, counts[keep])


def test_repeated_frames_are_given_once():
    counts, raw = log(100)
    stream = raw[: SIZE * 60] + raw[SIZE * 40 :]
    batch, report = decode_bytes(stream)
    np.testing.assert_array_equal(batch.samples[0].counts, counts)
    assert report.follower.repeats == 20


def test_numbers_wrap_without_a_gap():
    counts, raw = log(100, first=2**24 - 50)
    batch, report = decode_bytes(raw)
    assert report.follower.missing == 0
    assert batch.samples[0].tick.tolist() == list(range(2**24 - 50, 2**24 + 50))


def test_a_restart_is_an_epoch_and_not_a_gap():
    first, raw_first = log(50, first=1000, boot=3)
    second, raw_second = log(70, seed=2, first=0, boot=4)
    batch, report = decode_bytes(raw_first + raw_second)
    samples = batch.samples[0]
    assert report.follower.restarts == 1 and report.follower.missing == 0
    np.testing.assert_array_equal(samples.counts, np.concatenate([first, second]))
    assert samples.epoch.tolist() == [0] * 50 + [1] * 70


def test_a_restart_that_the_board_did_not_count_is_seen():
    _, first = log(50, first=100_000, boot=3)
    _, second = log(50, first=0, boot=3)
    _, report = decode_bytes(first + second)
    assert report.follower.restarts == 1 and report.samples == 100


def test_one_stray_frame_does_not_derail_the_rest():
    counts, raw = log(100)
    _, stray = log(1, first=8_000_000, boot=1)
    _, other = log(1, first=5, boot=9)
    stream = raw[: SIZE * 30] + stray + raw[SIZE * 30 : SIZE * 60] + other + raw[SIZE * 60 :]
    batch, report = decode_bytes(stream)
    np.testing.assert_array_equal(batch.samples[0].counts, counts)
    assert report.follower.strays == 2 and report.follower.restarts == 0


def test_sync_bytes_inside_samples_do_no_harm():
    # Counts chosen so that the packed payload holds the sync bytes again and again.
    value = np.frombuffer(bytes(frames.SYNC) * 5, dtype=np.uint8)[None]
    counts = np.repeat(frames.unpack_samples(value, 8), 200, axis=0)
    batch, report = decode_bytes(frames.encode_revision_1(counts))
    np.testing.assert_array_equal(batch.samples[0].counts, counts)
    assert report.damaged == 0


def test_frames_of_another_layout_are_left_out_and_counted():
    counts, eight = log(50)
    _, six = log(20, first=50, channels=6)
    batch, report = decode_bytes(eight + six)
    np.testing.assert_array_equal(batch.samples[0].counts, counts)
    assert report.other_layout == 20


def test_saturated_samples_are_counted_by_channel(tmp_path):
    counts, _ = log(500)
    counts[:, 3] = 1023
    counts[7, 5] = 0
    path = tmp_path / "board.bin"
    path.write_bytes(frames.encode_revision_1(counts))
    record = read_log(path)
    assert record.report["samples_on_a_rail"]["pump_a"] == 500
    assert record.report["samples_on_a_rail"]["brake"] == 1
    record.require_usable("brake")
    with pytest.raises(DataError, match="pump_a.*500 of 500 samples saturated"):
        record.require_usable("pump_a")


class TestNotOurs:
    def test_noise(self):
        noise = np.random.default_rng(0).bytes(50_000)
        with pytest.raises(DataError, match="no intact frame in 50000 bytes.*wrong baud"):
            decode_bytes(noise)

    def test_text(self):
        with pytest.raises(DataError, match="not a log of this board"):
            decode_bytes(b"dbd_label:  DBD(dinkum_binary_data)file\n" * 100)

    def test_empty(self):
        with pytest.raises(DataError, match="empty"):
            decode_bytes(b"")

    @pytest.mark.parametrize("received", [4800, 19200, 38400])
    def test_wrong_baud(self, received):
        _, raw = log(300)
        with pytest.raises(DataError, match="baud"):
            decode_bytes(at_wrong_baud(raw, 9600, received))

    def test_the_right_baud_gives_the_bytes_back(self):
        _, raw = log(50)
        assert at_wrong_baud(raw, 9600, 9600) == raw

    def test_unknown_revision_is_named(self):
        payload = np.zeros((5, 10), dtype=np.uint8)
        stream = frames.build(3, 1, payload, np.arange(5)).tobytes()
        with pytest.raises(DataError, match="5 of revision 3"):
            decode_bytes(stream)

    def test_wrong_revision_asked_for(self):
        _, raw = log(50)
        with pytest.raises(DataError, match="revision 2, found 50 intact"):
            decode_bytes(raw, revision=2)

    def test_absent_file(self, tmp_path):
        with pytest.raises(DataError, match="found nothing"):
            list(read_pieces(tmp_path / "no.bin"))

    def test_folder_without_logs(self, tmp_path):
        with pytest.raises(DataError, match="found none"):
            list(read_pieces(tmp_path))


def test_padding_that_is_not_zero_is_refused():
    packed = frames.pack_samples(np.full((1, 6), 500))
    packed[0, -1] |= 1
    good = frames.encode_revision_1(np.full((1, 6), 500), first=1)
    _, report = decode_bytes(frames.build(1, frames.SIX, packed, np.array([0])).tobytes() + good)
    assert report.samples == 1 and report.damaged == 1


class TestClock:
    def stamps(self, ticks, utc, epoch=0):
        return np.stack([np.full(ticks.size, epoch), ticks, np.rint(utc * 1000)], axis=1).astype(np.int64)

    def test_drift_is_fitted(self):
        ticks = np.arange(0, 200_000, 32)
        clock = fit_clock(self.stamps(ticks, 1.7e9 + ticks * 0.032 * (1 + 2e-4)), 1)
        assert clock.period[0] == pytest.approx(0.032 * (1 + 2e-4), rel=1e-7)
        assert clock.utc(np.array([0]), np.array([100_000]))[0] == pytest.approx(1.7e9 + 3200.64, abs=2e-3)
        assert not clock.steps

    def test_a_step_is_reported_and_not_followed(self):
        ticks = np.arange(0, 64_000, 32)
        utc = 1.7e9 + ticks * 0.032
        utc[1000:] += 90.0
        clock = fit_clock(self.stamps(ticks, utc), 1)
        (step,) = clock.steps
        assert step.tick == 32_000 and step.seconds == pytest.approx(90.0, abs=1e-2)
        assert clock.utc(np.array([0]), np.array([64_000]))[0] == pytest.approx(1.7e9 + 2048.0, abs=1e-2)
        with pytest.raises(DataError, match=r"\+90.0 s at tick 32000"):
            clock.require_steady("x")

    def test_without_stamps_time_counts_from_the_start(self, tmp_path):
        path = tmp_path / "board.bin"
        path.write_bytes(log(100)[1])
        record = read_log(path)
        np.testing.assert_allclose(record.utc(slice(0, 3)), [0.0, 0.032, 0.064])


def test_record_folder_equals_memory(tmp_path):
    counts, raw = log(5000)
    (tmp_path / "board.bin").write_bytes(raw[: 22 * 1000] + b"garbage" + raw[22 * 1100 :])
    record, decoder = write_record(read_pieces(tmp_path / "board.bin", 997), tmp_path / "out", "board.bin")
    memory = read_log(tmp_path / "board.bin")
    for name in ("tick", "epoch", "counts", "flags"):
        np.testing.assert_array_equal(getattr(record, name), getattr(memory, name))
    assert decoder.report.follower.missing == 100 and decoder.report.noise == 7
    again = open_record(tmp_path / "out")
    np.testing.assert_array_equal(again.counts, np.delete(counts, np.arange(1000, 1100), axis=0))
