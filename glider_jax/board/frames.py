"""The wire format of the measurement board, as defined by this project; NumPy only.

No byte format of the original board was published, so this one is ours: see ``docs/board-frames.md``.
Every frame is
an 8-byte header, a payload of even length and two CRC-16s. All multi-byte integers are little-endian;
ten-bit samples
are packed most significant bit first. One *tick* is the board's sampling interrupt, 32 ms in revision 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.crc import crc_many
from glider_jax.errors import ConfigError

SYNC = (0xEB, 0x90)
SYNC_WORD = 0x90EB  # the two sync bytes read as one little-endian number
HEADER = 8
TRAILER = 4
OVERHEAD = HEADER + TRAILER
LARGEST_PAYLOAD = 254
SEQUENCE_RANGE = 1 << 24
BOOT_RANGE = 16
FULL_SCALE = 1023
TICK = 0.032
BAUD = 9600

# Flags, the high four bits of byte 4.
TRIGGERED = 1
PRE_ROLL = 2
SATURATED = 4
OVERRUN = 8

CHANNELS_8 = ("main", "external", "emergency", "pump_a", "pump_b", "brake", "pitch", "fin")
CHANNELS_6 = ("main", "pump_a", "pump_b", "brake", "pitch", "fin")

# Revision 1 frame types.
EIGHT, SIX, EIGHT_TIMED, SIX_TIMED = 0, 1, 2, 3
# Revision 2 frame types.
SETUP, SAMPLES, EVENT, SUBSET, CLOCK = 0, 1, 2, 3, 4
REVISIONS = (1, 2)


@dataclass(frozen=True)
class Layout:
    """What one revision 1 frame type carries: the channel names in order, and whether a UTC stamp precedes
    them."""

    channels: tuple[str, ...]
    timed: bool

    @property
    def packed(self) -> int:
        """Bytes of the packed samples, padded with zero bits to an even number of bytes."""
        return packed_size(len(self.channels))

    @property
    def payload(self) -> int:
        """Bytes of the payload."""
        return self.packed + (6 if self.timed else 0)


REVISION_1 = {
    EIGHT: Layout(CHANNELS_8, False),
    SIX: Layout(CHANNELS_6, False),
    EIGHT_TIMED: Layout(CHANNELS_8, True),
    SIX_TIMED: Layout(CHANNELS_6, True),
}


def packed_size(samples: int) -> int:
    """Bytes that so many ten-bit samples take, rounded up to an even number."""
    whole = -(-10 * samples // 8)
    return whole + whole % 2


def pack_samples(counts: NDArray[np.integer]) -> NDArray[np.uint8]:
    """Pack ten-bit samples, most significant bit first, zero padded to an even number of bytes.

    Parameters
    ----------
    counts : (frame, channel) A/D counts, 0 to 1023.

    Returns
    -------
    (frame, byte) the packed samples.

    Raises
    ------
    ConfigError : a count is outside ten bits.
    """
    counts = np.asarray(counts)
    if counts.size and (counts.min() < 0 or counts.max() > FULL_SCALE):
        raise ConfigError(
            f"samples: expected ten-bit counts from 0 to {FULL_SCALE}, found {int(counts.min())} to "
            f"{int(counts.max())}. Convert amperes to counts first."
        )
    wide = counts.astype(np.uint32)
    packed = np.zeros((counts.shape[0], packed_size(counts.shape[1])), dtype=np.uint8)
    for channel in range(counts.shape[1]):
        byte, offset = divmod(10 * channel, 8)
        placed = wide[:, channel] << np.uint32(6 - offset)
        packed[:, byte] |= (placed >> np.uint32(8)).astype(np.uint8)
        packed[:, byte + 1] |= (placed & np.uint32(0xFF)).astype(np.uint8)
    return packed


def unpack_samples(packed: NDArray[np.uint8], channels: int) -> NDArray[np.uint16]:
    """Undo :func:`pack_samples`: (frame, byte) to (frame, channel) counts."""
    counts = np.empty((packed.shape[0], channels), dtype=np.uint16)
    for channel in range(channels):
        byte, offset = divmod(10 * channel, 8)
        pair = (packed[:, byte].astype(np.uint16) << np.uint16(8)) | packed[:, byte + 1]
        counts[:, channel] = (pair >> np.uint16(6 - offset)) & np.uint16(FULL_SCALE)
    return counts


def padding_is_zero(packed: NDArray[np.uint8], channels: int) -> NDArray[np.bool_]:
    """Whether the bits after the last sample are all zero, frame by frame; an encoder never sets them."""
    byte, used = divmod(10 * channels, 8)
    good = np.ones(packed.shape[0], dtype=bool)
    if byte < packed.shape[1]:
        good &= (packed[:, byte] & (0xFF >> used)) == 0
        good &= ~packed[:, byte + 1 :].any(axis=1)
    return good


def integers(values: NDArray[np.integer], size: int) -> NDArray[np.uint8]:
    """Little-endian bytes of non-negative integers: (frame,) to (frame, size)."""
    wide = np.ascontiguousarray(values, dtype="<u8")
    return wide.view(np.uint8).reshape(-1, 8)[:, :size]


def from_integers(data: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Undo :func:`integers`: (frame, size up to 7) to (frame,)."""
    out = np.zeros(data.shape[0], dtype=np.int64)
    for column in range(data.shape[1] - 1, -1, -1):
        out = (out << 8) | data[:, column]
    return out


def build(
    revision: int,
    kind: int,
    payload: NDArray[np.uint8],
    sequence: NDArray[np.integer],
    boot: int = 0,
    flags: NDArray[np.integer] | int = 0,
) -> NDArray[np.uint8]:
    """Put headers and checks around payloads of one length.

    Parameters
    ----------
    revision, kind : 0 to 15 each, the two halves of byte 2.
    payload : (frame, byte), an even number of bytes up to 254.
    sequence : (frame,) number of each frame, taken modulo 2**24.
    boot : how often the board has started, modulo 16, so that a restart is never mistaken for a gap.
    flags : one number or (frame,), 0 to 15.

    Returns
    -------
    (frame, byte) complete frames.
    """
    payload = np.asarray(payload, dtype=np.uint8)
    count, length = payload.shape
    if length % 2 or length > LARGEST_PAYLOAD:
        raise ConfigError(
            f"frame: expected an even payload of up to {LARGEST_PAYLOAD} bytes, found {length}."
        )
    frames = np.empty((count, length + OVERHEAD), dtype=np.uint8)
    frames[:, 0], frames[:, 1] = SYNC
    frames[:, 2] = (revision << 4) | kind
    frames[:, 3] = length
    frames[:, 4] = (np.asarray(flags, dtype=np.uint8) << 4) | np.uint8(boot % BOOT_RANGE)
    frames[:, 5:8] = integers(np.asarray(sequence) % SEQUENCE_RANGE, 3)
    frames[:, 8 : 8 + length] = payload
    checked = np.ascontiguousarray(frames[:, 2 : 8 + length]).view("<u2")
    frames[:, 8 + length :] = integers(crc_many(checked), 4)
    return frames


def encode_revision_1(
    counts: NDArray[np.integer],
    first: int = 0,
    boot: int = 0,
    flags: NDArray[np.integer] | int = 0,
    utc_ms: NDArray[np.integer] | None = None,
    stamp_every: int = 32,
) -> bytes:
    """Encode consecutive samples of all channels as a revision 1 stream.

    Parameters
    ----------
    counts : (tick, channel) A/D counts; eight channels in the order of ``CHANNELS_8`` or six as
        ``CHANNELS_6``.
    first : tick number of the first row since the board started.
    boot : start counter of the board.
    flags : one number or (tick,); ``SATURATED`` is added where a sample sits on a rail.
    utc_ms : (tick,) UTC in ms since 1970 if the board knows it; every ``stamp_every``-th frame then
        carries it.

    Returns
    -------
    The bytes as they go over the wire.
    """
    counts = np.asarray(counts)
    kinds = {8: (EIGHT, EIGHT_TIMED), 6: (SIX, SIX_TIMED)}
    if counts.ndim != 2 or counts.shape[1] not in kinds:
        raise ConfigError(f"revision 1 samples: expected shape (tick, 8) or (tick, 6), found {counts.shape}.")
    plain, timed = kinds[counts.shape[1]]
    packed = pack_samples(counts)
    sequence = first + np.arange(counts.shape[0], dtype=np.int64)
    all_flags = np.broadcast_to(np.asarray(flags, dtype=np.uint8), sequence.shape).copy()
    all_flags[((counts == 0) | (counts == FULL_SCALE)).any(axis=1)] |= SATURATED
    stamped = np.zeros(sequence.shape, dtype=bool)
    if utc_ms is not None:
        stamped = sequence % stamp_every == 0
    size = packed.shape[1] + OVERHEAD
    out = np.zeros((counts.shape[0], size + 6), dtype=np.uint8)
    out[~stamped, :size] = build(1, plain, packed[~stamped], sequence[~stamped], boot, all_flags[~stamped])
    if stamped.any():
        payload = np.concatenate([integers(np.asarray(utc_ms)[stamped], 6), packed[stamped]], axis=1)
        out[stamped] = build(1, timed, payload, sequence[stamped], boot, all_flags[stamped])
    used = np.ones(out.shape, dtype=bool)
    used[~stamped, size:] = False
    return out[used].tobytes()


def line_load(bytes_per_second: float, baud: int = BAUD) -> float:
    """Share of an 8N1 line that a stream takes: ten bits on the wire for each byte."""
    return bytes_per_second * 10.0 / baud
