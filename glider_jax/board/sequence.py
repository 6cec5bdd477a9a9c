"""Follow frame numbers through gaps, repeats and restarts; NumPy only.

Numbers are 24 bits wide and wrap after six days; the follower unwraps them. A number that runs backwards
is a repeat
and its frame is not returned twice. A change of the boot counter starts a new epoch. A lone frame whose
number does
not fit its predecessor must be confirmed by the frame after it, so that one freak cannot derail the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from glider_jax.board.frames import SEQUENCE_RANGE

LARGEST_LONE_JUMP = 1 << 20
REPEAT_WINDOW = 4096
GAPS_KEPT = 10_000


@dataclass(frozen=True)
class Gap:
    """Frames that never came: the epoch, the last number before, the first after, and how many are
    missing."""

    epoch: int
    before: int
    after: int

    @property
    def missing(self) -> int:
        """Frames lost in this gap."""
        return self.after - self.before - 1


@dataclass
class Follower:
    """State of the sequence between two buffers, and what has been counted so far.

    ``epoch`` is -1 before the first frame; ``gaps`` keeps the first ``GAPS_KEPT``, the counts cover all of
    them.
    """

    epoch: int = -1
    boot: int = -1
    last: int = -1
    gap_count: int = 0
    missing: int = 0
    repeats: int = 0
    strays: int = 0
    restarts: int = 0
    first: list[int] = field(default_factory=list)
    gaps: list[Gap] = field(default_factory=list)

    def follow(
        self, boot: NDArray[np.uint8], sequence: NDArray[np.int64], final: bool
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.int32], int]:
        """Take the next frames in the order received.

        Parameters
        ----------
        boot, sequence : (frame,) as on the wire.
        final : whether no more frames will come to confirm the last one.

        Returns
        -------
        Which frames to keep, their unwrapped numbers and their epochs (frame,), and how many frames were
        consumed;
        the others must be offered again with the next buffer.
        """
        count = sequence.size
        keep = np.zeros(count, dtype=bool)
        numbers = np.zeros(count, dtype=np.int64)
        epochs = np.full(count, self.epoch, dtype=np.int32)
        if count == 0:
            return keep, numbers, epochs, 0
        step = np.diff(sequence) % SEQUENCE_RANGE
        joined = (step >= 1) & (step <= LARGEST_LONE_JUMP) & (boot[1:] == boot[:-1])
        starts = np.concatenate([[0], np.flatnonzero(~joined) + 1])
        ends = np.concatenate([starts[1:], [count]])
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            alone = end - start == 1
            fits = self._fits(int(boot[start]), int(sequence[start]))
            if alone and not fits and end == count and not final:
                return keep, numbers, epochs, start
            if alone and not fits and not (final and end == count) and self.epoch >= 0:
                if not (end < count and self._confirms(boot, sequence, end)):
                    self.strays += 1
                    continue
            run = np.concatenate([[0], np.cumsum(step[start : end - 1])])
            self._take(int(boot[start]), int(sequence[start]), run, slice(start, end), keep, numbers, epochs)
        return keep, numbers, epochs, count

    def _confirms(self, boot: NDArray[np.uint8], sequence: NDArray[np.int64], at: int) -> bool:
        """Whether the frame at ``at`` carries on from the one before it."""
        step = int(sequence[at] - sequence[at - 1]) % SEQUENCE_RANGE
        return bool(boot[at] == boot[at - 1]) and 1 <= step < SEQUENCE_RANGE // 2

    def _fits(self, boot: int, sequence: int) -> bool:
        if self.epoch < 0 or boot != self.boot:
            return False
        ahead = (sequence - self.last) % SEQUENCE_RANGE
        return ahead <= LARGEST_LONE_JUMP or ahead >= SEQUENCE_RANGE - REPEAT_WINDOW

    def _take(
        self,
        boot: int,
        sequence: int,
        run: NDArray[np.int64],
        where: slice,
        keep: NDArray[np.bool_],
        numbers: NDArray[np.int64],
        epochs: NDArray[np.int32],
    ) -> None:
        """Enter one ascending run that begins at ``sequence``; ``run`` counts from 0."""
        ahead = (sequence - self.last) % SEQUENCE_RANGE
        backward = ahead >= SEQUENCE_RANGE // 2 or ahead == 0
        fresh = self.epoch < 0 or boot != self.boot
        if not fresh and backward and ahead != 0 and SEQUENCE_RANGE - ahead > REPEAT_WINDOW:
            # Too far back for a repeat on the wire: a restart of a board that did not count it.
            fresh = True
        if fresh:
            self.restarts += self.epoch >= 0
            self.epoch += 1
            self.boot = boot
            base = sequence
            self.last = base - 1
            if len(self.first) < GAPS_KEPT:
                self.first.append(base)
        else:
            base = self.last + (ahead if not backward else (ahead - SEQUENCE_RANGE if ahead else 0))
        unwrapped = base + run
        new = unwrapped > self.last
        self.repeats += int(np.count_nonzero(~new))
        keep[where], numbers[where], epochs[where] = new, unwrapped, self.epoch
        taken = unwrapped[new]
        if taken.size:
            before = np.concatenate([[self.last], taken[:-1]])
            holes = np.flatnonzero(taken - before > 1)
            self.gap_count += holes.size
            self.missing += int((taken - before - 1).sum())
            for hole in holes[: max(0, GAPS_KEPT - len(self.gaps))]:
                self.gaps.append(Gap(self.epoch, int(before[hole]), int(taken[hole])))
            self.last = int(taken[-1])
