"""The board's benchmarks at reduced size: what must be zero is zero, and memory does not grow."""

from __future__ import annotations

import pytest

from tests.benchmarks.bench_board import corruption, noise, speed

pytestmark = pytest.mark.benchmarks


def test_no_damaged_frame_is_believed(capsys):
    result = corruption(180_000)
    with capsys.disabled():
        print(f"\n{result}")
    assert result["wrong_samples"] == result["out_of_order"] == result["untouched_lost"] == 0
    assert result["expected_undetected_per_million"] < 1e-3


def test_noise_rich_in_headers_is_not_believed():
    result = noise(1 << 24)
    assert result["frames"] == 0 and result["candidates"] > 100_000


def test_a_day_decodes_in_seconds_with_constant_memory(capsys):
    result = speed(1.0)
    with capsys.disabled():
        print(f"\n{result}")
    assert result["missing"] == 0 and result["growth_mib_since_first_pieces"] < 30
    assert result["times_real_time"] > 5000
