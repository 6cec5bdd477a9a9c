"""Native Slocum binaries: made here cycle by cycle, cut, garbled, compressed, and the real ones."""

from __future__ import annotations

import locale
import struct
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.errors import DataError
from glider_jax.readers.recordings import read_recording

pytest.importorskip("dbdreader", reason="the optional extra for Slocum binaries is not installed")
lz4_block = pytest.importorskip("lz4.block")

FLIGHT = (("m_present_time", 8, "timestamp"), ("m_depth", 4, "m"), ("m_gps_lat", 8, "lat"), ("m_gps_lon", 8, "lon"))
FLIGHT += (("m_gps_status", 1, "enum"),)
SCIENCE = (("sci_m_present_time", 8, "timestamp"), ("sci_water_temp", 4, "degc"))
START = 1_500_000_000.0
FORMATS = {1: "b", 2: "h", 4: "f", 8: "d"}


def cycle(values, sensors, before):
    """State bits and updated values of one cycle; None is not updated, equal to the one before is repeated."""
    bits, data = [], b""
    for (name, size, _), value in zip(sensors, values, strict=True):
        if value is None:
            bits.append(0)
        elif before.get(name) == value:
            bits.append(1)
        else:
            bits.append(2)
            data += struct.pack("<" + FORMATS[size], int(value) if size < 4 else value)
            before[name] = value
    bits += [0] * (-len(bits) % 4)
    state = bytes(a << 6 | b << 4 | c << 2 | d for a, b, c, d in zip(*[iter(bits)] * 4, strict=True))
    return state + data


def binary(rows, sensors=FLIGHT, *, crc="1a2b3c4d", factored=1, name="unit-2017-194-0-0", mission="TEST.MI"):
    """A Slocum binary and the text of its cache file; a first cycle of zeros is there, as gliders write it."""
    states = (len(sensors) + 3) // 4
    tags = {
        "dbd_label": "DBD(dinkum_binary_data)file",
        "encoding_ver": "5",
        "num_ascii_tags": "14",
        "all_sensors": "0",
        "the8x3_filename": "00010000",
        "full_filename": name,
        "filename_extension": "dbd",
        "mission_name": mission,
        "fileopen_time": "Fri_Jul_14_02:40:00_2017",
        "total_num_sensors": str(len(sensors)),
        "sensors_per_cycle": str(len(sensors)),
        "state_bytes_per_cycle": str(states),
        "sensor_list_crc": crc.upper(),
        "sensor_list_factored": str(factored),
    }
    listing = "".join(f"s: T {i} {i} {size} {n} {unit}\n" for i, (n, size, unit) in enumerate(sensors))
    head = "".join(f"{k}: {v}\n" for k, v in tags.items()).encode()
    head += b"" if factored else listing.encode()
    known = b"sa" + struct.pack("<hfd", 0x1234, 123.456, 123456789.12345) + b"d"
    before: dict[str, float] = {}
    cycles = [cycle([0] * len(sensors), sensors, before), *(cycle(r, sensors, before) for r in rows)]
    return head + known + b"d".join(cycles) + b"X", listing


def flight(n, *, begin=START):
    return [(begin + 4.0 * k, 0.5 * k, 4018.5 if k == 0 else None, -7351.3 if k == 0 else None, 0) for k in range(n)]


def compress(body):
    out = b""
    for at in range(0, len(body), 32768):
        block = lz4_block.compress(body[at : at + 32768], store_size=False)
        out += len(block).to_bytes(2, "big") + block
    return out


def write(folder, filename, body, listing, crc="1a2b3c4d"):
    (folder / "cac").mkdir(exist_ok=True)
    (folder / "cac" / f"{crc}.cac").write_text(listing)
    (folder / filename).write_bytes(body)
    return folder / filename


def counts(recording):
    return {r.kind: r.count for r in recording.repairs}


def test_flight_and_science_are_joined(tmp_path):
    write(tmp_path, "00010000.DBD", *binary(flight(20)))
    science = [(START + 4.0 * k + 0.5, 10.0 + k) for k in range(20)]
    write(tmp_path, "00010000.ebd", *binary(science, SCIENCE, crc="99990000"), crc="99990000")
    got = read_recording(tmp_path)
    assert got.time.size == 40
    np.testing.assert_allclose(got["depth"][np.isfinite(got["depth"])], 0.5 * np.arange(20))
    np.testing.assert_allclose(got["temperature"][np.isfinite(got["temperature"])], 283.15 + np.arange(20))
    fix = np.isfinite(got["gps_latitude"])
    assert got["gps_latitude"][fix][0] == pytest.approx(40.0 + 18.5 / 60.0)
    assert got["gps_longitude"][fix][0] == pytest.approx(-73.0 - 51.3 / 60.0)
    assert got.attributes["missions"] == ("TEST.MI",) and got.attributes["segments"] == ("unit-2017-194-0-0",)
    assert got.segment_start[0] == START
    assert sorted(p.name for p in tmp_path.iterdir()) == ["00010000.DBD", "00010000.ebd", "cac"]  # nothing written


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 900, width=32), st.none() | st.floats(-1000, 9000)), min_size=1, max_size=12))
def test_round_trip(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("dbd")
    rows = [(START + 4.0 * k, d, x, x, None) for k, (d, x) in enumerate(values)]
    got = read_recording(write(folder, "a.dbd", *binary(rows)))
    np.testing.assert_array_equal(got.time, [r[0] for r in rows])
    np.testing.assert_array_equal(got["depth"], [r[1] for r in rows])


def test_compressed_files_and_caches_give_the_same(tmp_path):
    body, listing = binary(flight(3000))
    plain = read_recording(write(tmp_path, "a.dbd", body, listing))
    other = tmp_path / "other"
    other.mkdir()
    (other / "1A2B3C4D.CCC").write_bytes(compress(listing.encode()))
    (other / "a.dcd").write_bytes(compress(body))
    packed = read_recording(other / "a.dcd")
    np.testing.assert_array_equal(packed.time, plain.time)
    np.testing.assert_array_equal(packed["depth"], plain["depth"])
    assert not counts(packed)


def test_a_file_with_its_own_sensor_list_needs_no_cache(tmp_path):
    body, _ = binary(flight(5), factored=0)
    (tmp_path / "a.sbd").write_bytes(body)
    assert read_recording(tmp_path / "a.sbd").time.size == 5


def test_a_half_downloaded_file_keeps_its_intact_cycles(tmp_path):
    body, listing = binary(flight(50))
    got = read_recording(write(tmp_path, "a.dbd", body[:-40], listing))
    np.testing.assert_allclose(got["depth"], 0.5 * np.arange(got.time.size))
    assert 40 <= got.time.size < 50
    assert counts(got) == {"files cut short or garbled, intact part kept": 1}
    assert got.repairs[0].detail.startswith("a.dbd: ")


def test_reading_goes_on_after_garbled_bytes(tmp_path):
    body, listing = binary(flight(200))
    body = bytearray(body)
    middle = len(body) // 2
    body[middle : middle + 30] = b"\xff" * 30
    got = read_recording(write(tmp_path, "a.dbd", bytes(body), listing))
    assert got.time.size > 180
    k = (got.time - START) / 4.0
    np.testing.assert_allclose(got["depth"], 0.5 * k)
    assert "files cut short or garbled, intact part kept" in counts(got)


@pytest.mark.parametrize("size", [0, 3, 40, 200, -1])
def test_a_header_cut_short_is_named_and_ends(tmp_path, size):
    body, listing = binary(flight(5))
    size = body.index(b"sa4\x12") + 5 if size < 0 else size
    write(tmp_path, "bad.dbd", body[:size], listing)
    write(tmp_path, "good.sbd", *binary(flight(5), name="unit-2017-194-0-1"))
    got = read_recording(tmp_path)
    assert got.time.size == 5
    assert counts(got)["damaged files left out"] == 1 and "bad.dbd" in got.repairs[0].detail


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=300), st.integers(0, 700), st.booleans())
def test_any_bytes_end_in_rows_or_in_one_sentence(tmp_path_factory, noise, at, packed):
    folder = tmp_path_factory.mktemp("fuzz")
    body, listing = binary(flight(20))
    body = body[:at] + noise + body[at + len(noise) :]
    path = write(folder, "a.dcd" if packed else "a.dbd", compress(body) if packed else body, listing)
    try:
        got = read_recording(path)
    except DataError as problem:
        assert "a.d" in str(problem)
    else:
        assert np.all(np.diff(got.time) > 0.0)


def test_a_missing_cache_file_is_named_and_the_rest_is_kept(tmp_path):
    write(tmp_path, "a.sbd", *binary(flight(5)))
    body, _ = binary([(START, 10.0)], SCIENCE, crc="feedbeef")
    (tmp_path / "a.tbd").write_bytes(body)
    got = read_recording(tmp_path)
    assert got.time.size == 5
    assert got.repairs[0].kind == "files left out for want of a cache file"
    assert "a.tbd: needs feedbeef.cac" in got.repairs[0].detail


def test_no_cache_at_all_says_what_to_give(tmp_path):
    body, _ = binary(flight(5))
    (tmp_path / "a.sbd").write_bytes(body)
    with pytest.raises(DataError, match=r"1a2b3c4d.cac.*--cache"):
        read_recording(tmp_path / "a.sbd")
    with pytest.raises(DataError, match="expected a folder of sensor lists"):
        read_recording(tmp_path / "a.sbd", cache=tmp_path / "nowhere")


def test_the_fullest_readable_copy_of_a_segment_is_taken(tmp_path):
    write(tmp_path, "a.sbd", *binary(flight(20)[::4]))
    body, listing = binary(flight(20))
    write(tmp_path, "a.dbd", body, listing)
    got = read_recording(tmp_path)
    assert got.time.size == 20 and counts(got)["lower-resolution copies of a segment left out"] == 1
    (tmp_path / "a.dbd").write_bytes(body[:100])
    assert read_recording(tmp_path).time.size == 5


def test_files_of_two_gliders_are_not_one_recording(tmp_path):
    write(tmp_path, "a.sbd", *binary(flight(5), name="maria-997-2022-164-7-0"))
    write(tmp_path, "b.sbd", *binary(flight(5, begin=START + 100.0), name="unit_887-2021-321-3-0"))
    with pytest.raises(DataError, match="expected the files of one glider, found those of maria-997, unit_887"):
        read_recording(tmp_path)


def test_without_the_extra_the_message_says_how_to_get_it(tmp_path, monkeypatch):
    write(tmp_path, "a.sbd", *binary(flight(5)))
    monkeypatch.setitem(sys.modules, "dbdreader", None)
    with pytest.raises(DataError, match=r"pip install 'glider-jax\[dbd\]'"):
        read_recording(tmp_path / "a.sbd")


def test_the_locale_is_left_alone(tmp_path):
    before = locale.setlocale(locale.LC_ALL)
    read_recording(write(tmp_path, "a.sbd", *binary(flight(5))))
    assert locale.setlocale(locale.LC_ALL) == before


COMPARED = ("depth", "pitch", "heading", "gps_latitude", "gps_longitude", "pumped_volume", "charge_used", "water_vx")


@pytest.mark.parametrize("name", ["comet2019", "osu684_2025", "maria2022", "rosie2019"])
def test_real_binaries_agree_with_their_netcdf(real, name):
    nc = read_recording(real("recordings", name, f"{name}.nc"))
    raw = read_recording(real("recordings", name, "orig"))
    _, mine, theirs = np.intersect1d(raw.time, nc.time, return_indices=True)
    assert mine.size > 0.999 * nc.time.size
    for key in COMPARED:
        if key in nc:
            a, b = raw[key][mine], nc[key][theirs]
            assert np.isfinite(b).sum() > 0
            both = np.isfinite(a) & np.isfinite(b)
            assert both.sum() >= 0.99 * np.isfinite(b).sum(), key
            np.testing.assert_allclose(a[both], b[both], rtol=2e-6, atol=2e-6, err_msg=key)


def test_real_damaged_files_are_named_and_their_intact_cycles_kept(real):
    got = read_recording(real("recordings", "osu684_2025", "orig"))
    found = {r.kind: r for r in got.repairs}
    assert found["damaged files left out"].count == 5
    for name in ("01330005.tcd", "01330007.tcd", "01330013.ecd", "01330013.tcd", "01330016.tcd"):
        assert name in found["damaged files left out"].detail
    cut = found["files cut short or garbled, intact part kept"]
    assert cut.count == 3 and "01330016.ecd: 8655 intact cycles kept, 52 bytes lost" in cut.detail
    assert found["lower-resolution copies of a segment left out"].count == 30
    assert got.segment_start.size == 16
