"""Commands through their entry point."""

from __future__ import annotations

import sys

import pytest

from glider_jax_cli.main import main


@pytest.fixture
def run(monkeypatch, tmp_path, capsys):
    """Run the entry point with words; return exit code, standard output and standard error."""
    monkeypatch.setenv("GLIDER_JAX_CACHE", str(tmp_path / "cache"))
    # Earlier tests may have started JAX with other devices, which cannot be changed then.
    monkeypatch.setenv("XLA_FLAGS", "--xla_force_host_platform_device_count=1")
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["glider-forecast", *map(str, words)])
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = stop.code or 0
        out = capsys.readouterr()
        return code, out.out, out.err

    return call
