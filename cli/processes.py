"""Several processes that fly one ensemble together, on this machine or on many, by JAX's own distributed runtime."""

from __future__ import annotations

import atexit
import os
import socket
import subprocess
import sys

from glider_jax.errors import ConfigError

#: s; how long a process waits for the others to come.
PATIENCE = 120


class Processes:
    """The processes of a run, seen from one of them; a context that ends the others it started.

    Without a number, and outside of SLURM, this process starts the others on this machine and ends them with itself.

    Parameters
    ----------
    processes : how many take part.  coordinator : HOST:PORT of the first one, free on this machine if None.
    number : which one this is, from 0.

    Raises
    ------
    ConfigError : the numbers do not fit each other, or the others do not come.
    """

    def __init__(self, processes: int, coordinator: str | None, number: int | None) -> None:
        if processes < 1:
            raise ConfigError(f"--processes: expected at least 1, found {processes}.")
        self.processes = processes
        self.number = _number(processes, number) if processes > 1 else 0
        self.starts = self.number is None
        if not self.starts and processes > 1 and coordinator is None:
            raise ConfigError(
                "--coordinator: expected HOST:PORT of the first process, found none. Give it to all of them."
            )
        self.coordinator = coordinator
        self.started: list[subprocess.Popen] = []
        self.joined = False

    @property
    def leads(self) -> bool:
        """Whether this one writes and prints."""
        return not self.number

    def join(self) -> None:
        """Meet the others; called when the inputs are read, so that what is wrong with them is said by one alone."""
        if self.processes == 1:
            return
        import jax

        here = self.coordinator or f"127.0.0.1:{_free_port()}"
        if self.starts:
            self._start(here)
        jax.config.update("jax_cpu_collectives_implementation", "gloo")
        try:
            jax.distributed.initialize(
                here,
                num_processes=self.processes,
                process_id=self.number or 0,
                initialization_timeout=PATIENCE,
                # The first writes the products while the others wait.
                shutdown_timeout_seconds=3600,
            )
        except (RuntimeError, ValueError) as error:
            raise ConfigError(
                f"--coordinator: expected {self.processes} processes to meet at {here} within {PATIENCE} s, "
                f"found: {str(error).splitlines()[0]}. Check that all were started and the port can be reached."
            ) from error
        self.joined = True

    def _start(self, here: str) -> None:
        import jax

        share = str(max(1, len(os.sched_getaffinity(0)) // self.processes))
        jax.config.update("jax_num_cpu_devices", int(share))
        command = [sys.executable, "-m", "glider_jax_cli.main", *sys.argv[1:], "--coordinator", here]
        for k in range(1, self.processes):
            environment = os.environ | {"GLIDER_JAX_DEVICES": share}
            whole = [*command, "--process-id", str(k)]
            self.started.append(subprocess.Popen(whole, stdout=subprocess.DEVNULL, env=environment))

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, kind, error, trace) -> None:
        if kind is None and self.joined:
            import jax

            # The others leave only when all do.
            jax.distributed.shutdown()
        if kind is not None:
            for child in self.started:
                child.kill()
            if self.joined:
                # JAX would wait at exit for processes that are gone.
                code = error.code if isinstance(error, SystemExit) else 130 if kind is KeyboardInterrupt else 1
                atexit.register(_leave, code if isinstance(code, int) else 1)
        for child in self.started:
            child.wait()


def _leave(code: int) -> None:
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _number(processes: int, number: int | None) -> int | None:
    """This process's number: as given, or SLURM's where it started as many tasks."""
    if number is None and os.environ.get("SLURM_NTASKS") == str(processes):
        number = int(os.environ["SLURM_PROCID"])
    if number is not None and not 0 <= number < processes:
        raise ConfigError(f"--process-id: expected 0 to {processes - 1}, found {number}.")
    return number


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
