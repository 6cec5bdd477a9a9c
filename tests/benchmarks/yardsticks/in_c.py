"""The step in C: compiled once per process with the machine's compiler, called through ctypes."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from tests.benchmarks.yardsticks.arrays import COUNTS, FINAL, PLACES, PLAN, RECORD, Arrays, Flown

#: Members flown side by side, W in mission.c.
WIDTH = 16
_COMMON = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared", "-pthread")
# With these passes GCC splits selections into branches that it can then not make vectors of.
_PLAIN = ("-fno-thread-jumps", "-fno-tree-vrp", "-fno-tree-dominator-opts", "-fno-code-hoisting", "-fno-tree-pre")
#: Tried in this order: the first lets GCC make vector instructions of the whole step.
FLAGS = (
    (*_COMMON, "-fopenmp-simd", "-mprefer-vector-width=512", *_PLAIN),
    (*_COMMON, "-fopenmp-simd"),
    ("-O3", "-march=native", "-fPIC", "-shared", "-pthread"),
)
SCALAR = ((*_COMMON, "-fno-tree-vectorize"),)


class Grids(ctypes.Structure):
    """The struct of the same name in mission.c."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("currents", "error", "floor", "speeds", "waypoints")),
        *((name, ctypes.c_float) for name in PLACES),
        *((name, ctypes.c_int32) for name in COUNTS),
    ]


class CStep:
    """The compiled step; ``reason`` says why there is none.

    ``vectors`` False keeps the compiler from making vector instructions. The memory of the records is kept from one
    flight to the next.
    """

    def __init__(self, vectors: bool = True):
        self.name = "C" if vectors else "C without vectors"
        self.library, self.flags, self.reason = None, (), ""
        self._records = np.empty((0,), np.float32)
        compiler = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
        if compiler is None:
            self.reason = "no C compiler was found"
            return
        with tempfile.TemporaryDirectory() as folder:
            target = Path(folder) / "mission.so"
            source = Path(__file__).with_name("mission.c")
            for flags in FLAGS if vectors else SCALAR:
                made = subprocess.run(
                    [compiler, *flags, "-o", str(target), str(source), "-lm"], capture_output=True, text=True
                )
                if made.returncode == 0:
                    self.library, self.flags = ctypes.CDLL(str(target)), flags
                    break
            else:
                self.reason = f"{compiler} could not compile the step: {made.stderr.strip()[-300:]}"
                return
        version = subprocess.run([compiler, "--version"], capture_output=True, text=True).stdout
        self.version = version.splitlines()[0] if version else compiler
        self.library.block_bytes.restype = ctypes.c_int64

    def fly(self, given: Arrays, threads: int) -> Flown:
        """Fly all members; the records are overwritten by the next flight."""
        count = given.codes.size
        padded = -(-count // WIDTH) * WIDTH

        def pad(values):
            return np.ascontiguousarray(values[..., np.resize(np.arange(count), padded)])

        member, keys, codes = pad(given.member), pad(given.keys), pad(given.codes)
        shape = (given.outputs, len(RECORD), padded)
        if self._records.shape != shape:
            self._records = np.zeros(shape, np.float32)
            self._blocks = np.zeros(self.library.block_bytes() * (padded // WIDTH) + 64, np.uint8)
        final = np.empty((len(FINAL), padded), np.float32)
        start = self._blocks.ctypes.data
        tables = (given.currents, given.error, given.floor, given.speeds, given.waypoints)
        grids = Grids(*(t.ctypes.data for t in tables), *map(float, given.places), *map(int, given.counts))
        assert given.plan.size == len(PLAN)
        failed = self.library.fly(
            given.plan.ctypes.data_as(ctypes.c_void_p), ctypes.byref(grids), member.ctypes.data_as(ctypes.c_void_p),
            keys.ctypes.data_as(ctypes.c_void_p), codes.ctypes.data_as(ctypes.c_void_p),
            ctypes.c_void_p(start + (-start) % 64), self._records.ctypes.data_as(ctypes.c_void_p),
            final.ctypes.data_as(ctypes.c_void_p), ctypes.c_int64(padded), ctypes.c_int32(given.outputs),
            ctypes.c_int32(threads),
        )  # fmt: skip
        if failed:
            raise RuntimeError("the C step could not start its threads")
        return Flown(self._records[:, :, :count], final[:, :count])
