"""Capture over a pseudo-terminal and TCP: nothing received is lost by unplugging, signals or a kill."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from glider_jax.board import frames, logfile
from glider_jax.board import port as ports
from glider_jax.board.capture import Capture, Options
from glider_jax.board.clock import read_arrivals
from glider_jax.board.decoder import decode_bytes, read_pieces
from glider_jax.board.emulator import Emulator, PtyLine, TcpLine
from glider_jax.board.faults import Fault
from glider_jax.board.logfile import Folder, Journal, RotatingLog, read_journal
from glider_jax.board.port import open_port
from glider_jax.board.record import read_log
from glider_jax.errors import CaptureError, DataError
from tests.board.soak import CAPTURE, soak


def stream(ticks=200, seed=0):
    return frames.encode_revision_1(
        np.random.default_rng(seed).integers(1, 1023, (ticks, 8)).astype(np.uint16)
    )


def start(line, data, rate, faults=(), patient=False):
    emulator = Emulator(line, data, bytes_per_second=rate, faults=list(faults), patient=patient)
    thread, stop = emulator.start()
    if isinstance(line, PtyLine):
        while not line.link.exists():
            time.sleep(0.005)
    else:
        while line.port == 0:
            time.sleep(0.005)
    return emulator, thread, stop


def captured(folder):
    return b"".join(read_pieces(folder))


def test_two_seconds_at_9600_baud(tmp_path):
    data = stream(90)
    emulator, thread, _ = start(PtyLine(tmp_path / "tty"), data, 960.0)
    seen = []
    status = Capture(
        Options(str(tmp_path / "tty"), tmp_path / "log", duration_s=3.0),
        on_status=lambda s: seen.append(s.bytes_per_second),
    ).run()
    thread.join(5)
    assert captured(tmp_path / "log") == data
    assert status.report.samples == 90 and status.report.follower.missing == 0
    assert 700 < max(seen) <= 1100
    assert set(status.currents) <= set(frames.CHANNELS_8)


def test_soak_for_seconds_loses_nothing_delivered(tmp_path):
    result = soak(tmp_path, seconds=12.0, unplugs=2, others=8, speed=3.0, seed=3)
    assert result["delivered_but_not_captured"] == 0
    assert result["captured_twice"] == result["captured_wrong"] == 0
    assert result["missing_reported"] == result["missing_true"]
    assert result["unplugs"] == 2 and result["outages_seen"] >= 2
    assert result["frames_captured"] > 100


@pytest.mark.slow
def test_soak_for_an_hour(tmp_path):
    minutes = float(os.environ.get("GLIDER_JAX_SOAK_MINUTES", "60"))
    result = soak(tmp_path, seconds=60.0 * minutes, unplugs=int(minutes / 2.5) + 1, others=int(5 * minutes))
    assert result["delivered_but_not_captured"] == 0
    assert result["captured_twice"] == result["captured_wrong"] == 0
    assert result["missing_reported"] == result["missing_true"]


def test_files_rotate_at_frame_boundaries_and_appear_complete(tmp_path):
    data = stream(400)
    _, thread, _ = start(PtyLine(tmp_path / "tty"), data, 9600.0)
    status = Capture(
        Options(str(tmp_path / "tty"), tmp_path / "log", duration_s=2.0, rotate_bytes=2000)
    ).run()
    thread.join(5)
    logs = sorted((tmp_path / "log").glob("*.bin"))
    assert len(logs) >= 3 and [p.name for p in logs] == status.files
    assert not list((tmp_path / "log").glob("*.part"))
    for path in logs:
        assert decode_bytes(path.read_bytes())[1].noise == 0
    assert captured(tmp_path / "log") == data


def test_samples_are_placed_by_arrival_where_the_board_knows_no_time(tmp_path):
    _, thread, _ = start(PtyLine(tmp_path / "tty"), stream(100), 22 / 0.032)
    begin = time.time()
    Capture(Options(str(tmp_path / "tty"), tmp_path / "log", duration_s=4.0)).run()
    thread.join(5)
    assert len(read_arrivals(tmp_path / "log")) >= 3
    utc = read_log(tmp_path / "log").utc(slice(None))
    assert abs(utc[0] - begin) < 1.0
    assert np.diff(utc) == pytest.approx(0.032, rel=1e-4)


def run_capture(tmp_path, *options):
    command = [sys.executable, "-c", CAPTURE, str(tmp_path / "tty"), str(tmp_path / "log"), "1000000"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def wait_for_bytes(folder, count):
    limit = time.monotonic() + 20.0
    while time.monotonic() < limit:
        if sum(p.stat().st_size for p in folder.glob("*.bin*")) >= count:
            return
        time.sleep(0.01)
    pytest.fail("the capture wrote too little")


def test_sigint_completes_the_file(tmp_path):
    data = stream(3000)
    emulator, thread, stop = start(PtyLine(tmp_path / "tty"), data, 3000.0)
    process = run_capture(tmp_path)
    wait_for_bytes(tmp_path / "log", 2000)
    process.send_signal(signal.SIGINT)
    status = json.loads(process.communicate(timeout=10)[0])
    stop.set()
    thread.join(5)
    assert process.returncode == 0
    got = captured(tmp_path / "log")
    assert data.startswith(got) and len(got) == status["bytes_received"] >= 2000
    assert not list((tmp_path / "log").glob("*.part"))
    assert read_journal(tmp_path / "log")[-1]["event"] == "stopped"


def test_kill_loses_nothing_written_and_the_next_capture_goes_on(tmp_path):
    data = stream(6000)
    emulator, thread, stop = start(PtyLine(tmp_path / "tty"), data, 3000.0)
    process = run_capture(tmp_path)
    wait_for_bytes(tmp_path / "log", 3000)
    process.kill()
    process.communicate(timeout=10)
    sent = emulator.delivered[-1][1]
    left = captured(tmp_path / "log")
    assert data.startswith(left)
    # What was sent in the last read of the killed process, at most a tenth of a second, was never received.
    assert sent - len(left) < 600
    assert list((tmp_path / "log").glob("*.part"))
    second = run_capture(tmp_path)
    limit = time.monotonic() + 20.0
    while (
        not any(e["event"] == "recovered" for e in read_journal(tmp_path / "log"))
        and time.monotonic() < limit
    ):
        time.sleep(0.02)
    wait_for_bytes(tmp_path / "log", len(left) + 2000)
    second.terminate()
    second.communicate(timeout=10)
    stop.set()
    thread.join(5)
    got = captured(tmp_path / "log")
    assert got.startswith(left)
    batch, report = decode_bytes(got)
    truth = decode_bytes(data)[0].samples[0].counts
    np.testing.assert_array_equal(batch.samples[0].counts, truth[batch.samples[0].tick])


def test_tcp(tmp_path):
    data = stream(150)
    line = TcpLine()
    _, thread, _ = start(line, data, 6000.0, [Fault(1500, "unplug", 0.2)])
    status = Capture(
        Options(f"socket://127.0.0.1:{line.port}", tmp_path / "log", duration_s=3.0, retry_s=0.05)
    ).run()
    thread.join(5)
    batch, report = decode_bytes(captured(tmp_path / "log"))
    truth = decode_bytes(data)[0].samples[0].counts
    np.testing.assert_array_equal(batch.samples[0].counts, truth[batch.samples[0].tick])
    assert status.outages >= 1 and captured(tmp_path / "log").startswith(data[:1500])


def count_reads(monkeypatch):
    """Every byte that the system hands to the capture, in order."""
    received, read = [], os.read

    def counted(descriptor, size):
        data = read(descriptor, size)
        received.append(data)
        return data

    monkeypatch.setattr(ports.os, "read", counted)
    return received


def test_every_byte_read_is_in_the_log_though_the_cable_goes_in_the_middle(tmp_path, monkeypatch):
    received = count_reads(monkeypatch)
    monkeypatch.setattr(Emulator, "_drain", lambda self, stop: None)
    pulls = [Fault(at, "unplug", 0.05) for at in (1500, 6000, 9500)]
    _, thread, _ = start(PtyLine(tmp_path / "tty"), stream(600), 6000.0, pulls)
    options = Options(str(tmp_path / "tty"), tmp_path / "log", duration_s=3.5, retry_s=0.02, rotate_bytes=3000)
    status = Capture(options).run()
    thread.join(5)
    assert status.outages >= 3 and len(b"".join(received)) > 5000
    assert captured(tmp_path / "log") == b"".join(received)


def test_bytes_that_wait_when_the_port_is_opened_are_kept(tmp_path):
    line, data = PtyLine(tmp_path / "tty"), stream(20)
    line.plug()
    line.send(data)
    while line.drained():
        time.sleep(0.01)
    port = open_port(str(tmp_path / "tty"), 9600)
    assert port.read() == data
    port.close()
    line.unplug()


def test_bytes_that_wait_when_the_capture_is_stopped_are_kept(tmp_path):
    line, data = PtyLine(tmp_path / "tty"), stream(20)
    line.plug()
    capture = Capture(Options(str(tmp_path / "tty"), tmp_path / "log"))
    line.send(data)
    while line.drained():
        time.sleep(0.01)
    capture.stop.set()
    capture.run()
    line.unplug()
    assert captured(tmp_path / "log") == data


def test_a_kill_while_a_file_is_completed_loses_nothing(tmp_path, monkeypatch):
    class Killed(BaseException):
        pass

    def kill(*_):
        raise Killed

    data = stream(3)
    log = RotatingLog(tmp_path)
    log.write(data[:50])
    for name in ("ftruncate", "fsync"):
        with monkeypatch.context() as patch:
            patch.setattr(logfile.os, name, kill)
            with pytest.raises(Killed):
                log.rotate(data[44:50])
        Folder(tmp_path).close()
        both = [p.read_bytes() for p in sorted(tmp_path.glob("*.bin.part"))]
        assert both[0][:44] + both[1] == data[:50]
        batch, _ = decode_bytes(b"".join(both) + data[50:])
        assert batch.samples[0].tick.tolist() == [0, 1, 2]
        for path in tmp_path.iterdir():
            path.unlink()
        log = RotatingLog(tmp_path)
        log.write(data[:50])


def test_a_full_disk_is_told_and_not_taken_for_a_lost_port(tmp_path, monkeypatch):
    _, thread, stop = start(PtyLine(tmp_path / "tty"), stream(400), 6000.0)
    write, room = os.write, [1000]

    def full(descriptor, data):
        # Only the log writes views; the emulator shares this module's os.
        if isinstance(data, memoryview):
            if len(data) > room[0]:
                raise OSError(28, "No space left on device")
            room[0] -= len(data)
        return write(descriptor, data)

    monkeypatch.setattr(logfile.os, "write", full)
    with pytest.raises(CaptureError, match="No space left on device.*make room"):
        Capture(Options(str(tmp_path / "tty"), tmp_path / "log", duration_s=10.0)).run()
    stop.set()
    thread.join(5)
    monkeypatch.undo()
    assert stream(400).startswith(captured(tmp_path / "log"))
    Folder(tmp_path / "log").close()


class TestClearErrors:
    def test_no_such_port(self, tmp_path):
        with pytest.raises(CaptureError, match="no such device"):
            open_port(str(tmp_path / "ttyUSB7"), 9600)

    def test_busy_port(self, tmp_path):
        line = PtyLine(tmp_path / "tty")
        line.plug()
        first = open_port(str(tmp_path / "tty"), 9600)
        with pytest.raises(CaptureError, match="busy"):
            open_port(str(tmp_path / "tty"), 9600)
        first.close()
        line.unplug()

    def test_not_a_port(self, tmp_path):
        (tmp_path / "file").write_text("x")
        with pytest.raises(CaptureError, match="cannot be opened"):
            open_port(str(tmp_path / "file"), 9600)

    def test_unknown_address(self):
        with pytest.raises(CaptureError, match="socket://HOST:PORT"):
            open_port("sockett://here:1", 9600)

    def test_wrong_baud_stops_with_an_error_and_keeps_the_bytes(self, tmp_path):
        _, thread, stop = start(PtyLine(tmp_path / "tty"), stream(3000), 3000.0)
        options = Options(
            str(tmp_path / "tty"), tmp_path / "log", baud=19200, identify_s=0.8, duration_s=10.0
        )
        with pytest.raises(DataError, match="read at 19200 baud; the bytes are kept"):
            Capture(options).run()
        stop.set()
        thread.join(5)
        assert len(captured(tmp_path / "log")) > 500

    def test_two_captures_in_one_folder(self, tmp_path):
        folder = Folder(tmp_path)
        with pytest.raises(CaptureError, match="another capture"):
            Folder(tmp_path)
        folder.close()
        Folder(tmp_path).close()

    def test_folder_that_cannot_be_made(self, tmp_path):
        (tmp_path / "file").write_text("x")
        with pytest.raises(CaptureError, match="--out"):
            Folder(tmp_path / "file")


def test_a_torn_journal_line_is_left_out(tmp_path):
    journal = Journal(tmp_path / "capture.jsonl")
    journal.note("opened", port="x")
    journal.close()
    with open(tmp_path / "capture.jsonl", "a") as stream_:
        stream_.write('{"utc": 1, "ev')
    assert [e["event"] for e in read_journal(tmp_path)] == ["opened"]


def test_rotation_of_an_unused_log_makes_no_file(tmp_path):
    log = RotatingLog(tmp_path)
    log.write(b"")
    assert log.rotate() is None and list(tmp_path.iterdir()) == []
