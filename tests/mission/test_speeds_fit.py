"""Speed distributions: the fit, the file, and the bundled ones against the published totals."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glider_jax.errors import ConfigError, DataError
from glider_jax.mission.speeds_fit import (
    PROBABILITIES,
    SegmentSpeed,
    Selection,
    SpeedDistribution,
    bundled_speeds,
    fit_speeds,
    nearest,
    read_speeds,
    select_segments,
    to_json,
    weighted_quantiles,
    write_speeds,
)
from glider_jax.readers.recordings import read_recording
from glider_jax.records import Recording, Source

YEAR = 365.25 * 86400.0


def segment(speed, *, pitch_deg=26.0, duration=3600.0, through=0.25):
    return SegmentSpeed(
        recording="made",
        start=0.0,
        pitch=np.radians(pitch_deg),
        over_ground=speed,
        through_water=through,
        distance=speed * duration,
        path_length=through * duration,
        duration=duration,
        under_water=duration,
    )


def distribution(**more):
    fields = dict(
        pitch=np.radians(26.0),
        kind="over_ground",
        speeds=np.array([0.1, 0.2, 0.4]),
        probabilities=np.array([0.0, 0.5, 1.0]),
        segments=3,
        distance=1000.0,
        duration=4000.0,
    )
    return SpeedDistribution(**(fields | more))


def flown(*, dives=3, speed_east=0.3, speed_north=-0.4, pitch_deg=26.0, gap=False):
    """A recording of straight dives of an hour with a known speed over the ground."""
    time, depth, pitch, lat, lon = [], [], [], [], []
    t, x, y = 1.5e9, 0.0, 0.0
    for n in range(2 * dives + 1):
        for k in range(30 if n % 2 == 0 else 360):
            under = n % 2 == 1
            saw = abs((k % 120) - 60.0)
            time.append(t)
            depth.append(60.0 - saw if under else 0.0)
            pitch.append(np.radians(-pitch_deg if k % 120 < 60 else pitch_deg) if under else 0.0)
            lat.append(np.nan if under else 40.0 + np.degrees(y / 6_371_000.0))
            lon.append(np.nan if under else 5.0 + np.degrees(x / 6_371_000.0) / np.cos(np.radians(40.0)))
            t += 10.0
            if under:
                x, y = x + 10.0 * speed_east, y + 10.0 * speed_north
    channels = {"depth": depth, "pitch": pitch, "gps_latitude": lat, "gps_longitude": lon}
    channels = {name: np.array(values) for name, values in channels.items()}
    channels["heading"] = np.zeros(len(time))
    channels["depth"] = np.where(channels["depth"] < 2.0, np.where(np.isfinite(lat), 0.0, 2.0), channels["depth"])
    rows = np.ones(len(time), bool)
    if gap:
        rows[100:250] = False
    channels = {name: values[rows] for name, values in channels.items()}
    return Recording("made", np.array(time)[rows], channels, Source("made"), np.array([time[0]]))


def test_speed_over_ground_is_distance_over_time_between_the_fixes():
    chosen = select_segments([flown()])
    assert len(chosen.segments) == 3 and not chosen.excluded
    for one in chosen.segments:
        assert one.over_ground == pytest.approx(0.5, rel=0.01)
        assert np.degrees(one.pitch) == pytest.approx(26.0)
        # Sixty metres in 600 s at 26 degrees, a steady glide being steeper than the hull.
        assert one.through_water == pytest.approx(0.1 / np.tan(np.radians(28.47)), rel=0.03)


def test_segments_with_gaps_or_too_short_are_left_out_and_counted():
    chosen = select_segments([flown(gap=True)])
    assert chosen.excluded == {"a gap in the recording": 1} and len(chosen.segments) == 2
    assert select_segments([flown()], shortest=5000.0).excluded == {"shorter than 5000 s": 3}
    with pytest.raises(DataError, match=r"found none that can be used \(3 with shorter than 5000 s\)"):
        fit_speeds([flown()], shortest=5000.0)
    with pytest.raises(DataError, match="no dive between two fixes"):
        fit_speeds([])


def test_one_distribution_per_degree_and_kind():
    made = [segment(0.2, pitch_deg=25.6), segment(0.3, pitch_deg=26.4), segment(0.4, pitch_deg=20.2)]
    fitted = fit_speeds(Selection(tuple(made)))
    assert [(round(np.degrees(d.pitch)), d.kind, d.segments) for d in fitted] == [
        (20, "over_ground", 1),
        (20, "through_water", 1),
        (26, "over_ground", 2),
        (26, "through_water", 2),
    ]
    assert fitted[0].speeds_sd is None and fitted[2].speeds_sd.shape == PROBABILITIES.shape


def test_the_mean_of_equal_times_is_total_distance_over_total_time():
    rng = np.random.default_rng(1)
    made = [segment(v, duration=t) for v, t in zip(rng.gamma(5.0, 0.06, 200), rng.uniform(1e3, 1e4, 200), strict=True)]
    one = fit_speeds(Selection(tuple(made)))[0]
    assert one.mean_per_time == pytest.approx(one.distance / one.duration, rel=1e-12)
    draws = one.quantile(rng.random(200_000))
    assert draws.mean() == pytest.approx(one.mean_per_time, abs=4.0 * draws.std() / np.sqrt(draws.size))
    slowness = 1.0 / draws
    error = 4.0 * slowness.std() / np.sqrt(slowness.size)
    assert slowness.mean() == pytest.approx(1.0 / one.mean_per_distance, abs=error)
    assert one.mean_per_distance < one.mean_per_time


def test_long_segments_weigh_more():
    both = np.array([0.1, 0.5])
    assert np.median(weighted_quantiles(both, np.array([9.0, 1.0]))) < 0.3
    assert np.median(weighted_quantiles(both, np.array([1.0, 9.0]))) > 0.3


def test_sampling_uncertainty_shrinks_with_the_number_of_segments():
    rng = np.random.default_rng(2)
    spread = []
    for n in (25, 400):
        one = fit_speeds(Selection(tuple(segment(v) for v in rng.normal(0.3, 0.05, n))))[0]
        spread.append(one.speeds_sd[32])
    # The median of n normal values is known to 1.25 sigma over the root of n.
    assert spread[1] == pytest.approx(1.2533 * 0.05 / 20.0, rel=0.35)
    assert 2.0 < spread[0] / spread[1] < 8.0


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(0.01, 2.0), st.floats(1.0, 1e5)), min_size=1, max_size=30))
def test_quantiles_ascend_within_the_values(rows):
    values, weights = np.array(rows).T
    table = weighted_quantiles(values, weights)
    assert np.all(np.diff(table) >= 0.0)
    assert values.min() - 1e-12 <= table[0] and table[-1] <= values.max() + 1e-12


def test_a_file_written_is_the_one_read(tmp_path):
    made = fit_speeds(Selection(tuple(segment(v) for v in (0.2, 0.25, 0.4))))
    path = write_speeds(tmp_path / "new" / "speeds.json", made)
    assert [p.name for p in path.parent.iterdir()] == ["speeds.json"]
    for a, b in zip(made, read_speeds(path), strict=True):
        np.testing.assert_array_equal(a.speeds, b.speeds)
        np.testing.assert_array_equal(a.probabilities, b.probabilities)
        np.testing.assert_array_equal(a.speeds_sd, b.speeds_sd)
        assert a.pitch == pytest.approx(b.pitch) and (a.kind, a.source, a.segments) == (b.kind, b.source, b.segments)
        assert (a.distance, a.duration) == (b.distance, b.duration)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"kind": "over_grund"}, r"distribution 0: .*found 'over_grund'. Did you mean 'over_ground'"),
        ({"speeds": [0.1, 0.05, 0.4]}, "ascending speeds above 0"),
        ({"speeds": [0.0, 0.2, 0.4]}, "ascending speeds above 0"),
        ({"speeds": [10.0, 20.0, 40.0]}, "below 5 m/s"),
        ({"speeds": [0.1, 0.2]}, "as many speeds as probabilities"),
        ({"speeds": ["a", 0.2, 0.3]}, "finite numbers in 'speeds'"),
        ({"probabilities": [0.1, 0.5, 1.0]}, "from 0 to 1"),
        ({"probabilities": [0.0, 0.5, 0.5]}, "from 0 to 1"),
        ({"pitch_deg": 120.0}, "between 0 and 90 degrees"),
        ({"segments": -3}, "totals of 0 or more"),
        ({"speeds": None}, "finite numbers in 'speeds'"),
    ],
)
def test_bad_numbers_in_a_file_are_refused(tmp_path, change, message):
    content = to_json([distribution()])
    content["distributions"][0] |= change
    path = tmp_path / "x.json"
    path.write_text(json.dumps(content))
    with pytest.raises(DataError, match=message):
        read_speeds(path)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "x.json"
    with pytest.raises(DataError, match="found no readable file"):
        read_speeds(path)
    for text, message in [
        ("hello", "expected JSON"),
        ("[]", "found a list"),
        ('{"format": "x", "version": 1}', "found 'x' version 1"),
        ('{"format": "glider_jax speed distribution", "version": 2}', "version 2"),
        ('{"format": "glider_jax speed distribution", "version": 1}', "at least one entry"),
    ]:
        path.write_text(text)
        with pytest.raises(DataError, match=message):
            read_speeds(path)
    content = to_json([distribution()])
    content["distributions"][0]["speed"] = content["distributions"][0].pop("speeds")
    path.write_text(json.dumps(content))
    with pytest.raises(DataError, match="expected 'speeds', found none. Did you mean 'speed'"):
        read_speeds(path)


def test_the_nearest_pitch_of_a_kind_is_taken():
    made = [distribution(pitch=np.radians(p), kind=k) for p in (25.0, 30.0) for k in ("over_ground", "through_water")]
    assert nearest(made, -np.radians(26.0), "through_water") is made[1]
    assert nearest(made, np.radians(29.0), "over_ground") is made[2]
    with pytest.raises(ConfigError, match="Did you mean 'through_water'"):
        nearest(made, 0.4, "thru_water")
    with pytest.raises(ConfigError, match="found none. Choose the other kind"):
        nearest(made[:1], 0.4, "through_water")


def test_bundled_distributions_have_the_published_totals_as_their_means():
    bundled = bundled_speeds()
    published = {25: (2539, 6.263e6, 293.0 * 86400.0), 26: (16411, 3.2527e7, 3.48 * YEAR)}
    for one in bundled:
        segments, distance, duration = published[round(np.degrees(one.pitch))]
        assert (one.segments, one.distance) == (segments, distance) and one.duration == pytest.approx(duration)
        assert one.probabilities.size == 65
        if one.kind == "over_ground":
            assert one.mean_per_time == pytest.approx(distance / duration, rel=1e-5)
    ground = nearest(bundled, np.radians(26.0), "over_ground")
    water = nearest(bundled, np.radians(26.0), "through_water")
    # 283 m take 380 s more than at 0.34 m/s: the harmonic mean of the published simulator.
    assert ground.mean_per_distance == pytest.approx(0.233, abs=1e-5)
    assert 283.0 / ground.mean_per_distance - 283.0 / 0.34 == pytest.approx(380.0, abs=5.0)
    # Without currents the spread is the glider's own, and the mean is the lower one: a vector sum only adds.
    assert np.ptp(water.speeds) < 0.3 * np.ptp(ground.speeds)
    assert ground.mean_per_distance < water.mean_per_time < ground.mean_per_time
    assert "do not add currents" in ground.assumption


def test_an_unknown_bundled_name_is_explained():
    with pytest.raises(ConfigError, match="Did you mean 'paper2010'"):
        bundled_speeds("paper2012")


def test_real_recordings_give_plausible_speeds(real):
    read = [read_recording(real("recordings", n, f"{n}.nc")) for n in ("comet2019", "osu684_2025", "ru28_2017")]
    chosen = select_segments(read)
    assert len(chosen.segments) == 24
    # The deep glider flew eight dives alike.
    deep = [s.through_water for s in chosen.segments if s.recording == "osu684_2025"]
    assert np.std(deep) < 0.01 and np.mean(deep) == pytest.approx(0.265, abs=0.01)
    for one in fit_speeds(chosen):
        assert 0.1 < one.mean_per_time < 0.6
        assert one.mean_per_time == pytest.approx(one.distance / one.duration, rel=1e-9)


def test_a_recording_without_headings_still_gives_a_way_through_the_water():
    made = flown()
    blind = replace(made, channels={k: v for k, v in made.channels.items() if k != "heading"})
    with_heading = select_segments([made]).segments[0].through_water
    assert select_segments([blind]).segments[0].through_water == pytest.approx(with_heading, rel=0.05)
