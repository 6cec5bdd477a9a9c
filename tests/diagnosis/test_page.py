"""The report's page: the verdict in one line, what a pilot needs first, nothing that a file could smuggle in."""

from __future__ import annotations

from glider_jax.diagnosis.page import headline, page, undecided


def effect(**other):
    """A named effect."""
    return {
        "id": "flight.pitch_gain", "title": "Pitch scale", "plain": "All glides are flatter.", "tentative": False,
        "evidence": 50.0, "alternatives": [], "certain": True, "shapes": {}, "located": "On dives.",
        "class": {"label": "pitch scale", "members": [], "twins": [], "decided_by": "a measured speed"},
        "parameters": [{"name": "gain", "value": -0.13, "sd": 0.01, "interval_90": [-0.15, -0.11], "unit": "1",
                        "text": "scale", "shown": {"unit": "%", "value": -13.0, "interval_90": [-15.0, -11.0]}}],
        "held_out": {"gain": 20.0, "folds_gaining": 1.0, "confirmed": True}, "equation": "x", "reference": "y",
    } | other  # fmt: skip


def content(*effects, **other):
    """A diagnosis with these effects."""
    return {
        "verdict": "explained" if effects else "nothing_missing", "effects": list(effects), "warnings": [],
        "recording": {"name": "<script>", "start": 0.0, "days": 1.0, "dives": 3, "legs": 40},
        "vehicle": {"name": "v"}, "seconds": 12.0, "unexplained": [], "calibration": [], "localisation": [],
        "missing": [], "notes": [], "search": {"path": [], "candidates": 50},
        "held_out": {"streams": {}, "figures": {"surfacing_error_m": {"before": 2580.4, "after": 310.2}}},
        "not_found": [
            {"id": "flight.lift_loss", "title": "Loss of lift", "evidence": 0.1, "verdict": "not_supported",
             "decided_by": "a measured speed", "minimum_detectable": [
                 {"name": "loss", "minimum": 3.0, "unit": "1", "shown": {"unit": "%", "minimum": 300.0},
                  "typical": 0.2}]},
            {"id": "flight.drag_bias", "title": "Parasite drag", "evidence": 1.0, "verdict": "not_supported",
             "decided_by": "", "minimum_detectable": [
                 {"name": "share", "minimum": 0.05, "unit": "1", "shown": {"unit": "%", "minimum": 5.0},
                  "typical": 0.25}]},
        ],
    } | other  # fmt: skip


def test_the_verdict_is_one_plain_line():
    """Counts in words, and nothing missing said as such."""
    assert headline(content()).startswith("Nothing is missing")
    assert headline(content(effect())) == "One effect was left out of the model"
    both = content(effect(), effect(), verdict="unexplained")
    assert headline(both) == "Two effects were left out of the model, and part of the mismatch has no name"


def test_what_comes_first_is_what_a_pilot_needs():
    """Name and sureness, then what it changes in metres without exponents, then what to do; equations last."""
    text = page(content(effect()), {})
    order = [text.index(words) for words in ("Pitch scale", "sure", "What it changes", "What to do", "Equations")]
    assert order == sorted(order)
    assert "2580" in text and "310" in text and "e+0" not in text
    assert "-13 %" in text and "cannot tell" in text


def test_what_only_its_size_makes_unlikely_is_said():
    """A twin that would have to be large is told with its size; the name stays sure."""
    twin = {"id": "flight.salinity_bias", "title": "Salinity bias", "behind": 0.0, "name": "bias", "value": 0.6,
            "unit": "1", "times_typical": 12.0, "shown": {"unit": "1", "value": 0.6}}  # fmt: skip
    sure = effect(**{"class": {"label": "x", "members": [], "twins": [twin], "decided_by": "a second CTD"}})
    text = page(content(sure), {})
    assert "could not tell it from salinity bias (0.6, 12 times its usual size)" in text
    assert "a second CTD" in text and ">sure<" in text
    rare = effect(**{"class": sure["class"] | {"twins": [twin | {"times_typical": 0.4}]}})
    assert "(0.6, which is rarer)" in page(content(rare), {})


def test_a_near_twin_is_named_in_the_first_lines():
    """An effect that another explains as well is not called sure."""
    twin = {"id": "flight.lift_loss", "title": "Loss of lift", "behind": 0.5}
    text = page(content(effect(alternatives=[twin])), {})
    assert "this or a near twin" in text and "It could as well be loss of lift" in text
    assert "perhaps" in page(content(effect(tentative=True)), {})


def test_only_what_could_not_be_seen_is_undecided():
    """Fifteen times the typical size cannot be told, a fifth of it can."""
    assert [one["id"] for one in undecided(content())] == ["flight.lift_loss"]


def test_names_from_files_cannot_become_markup():
    """The recording's name is text."""
    text = page(content(effect()), {})
    assert "<script>" not in text and "&lt;script&gt;" in text


def without_name(covariate="dive", gain: float | None = 34.0, instead=()):
    """Structure without a name."""
    return {
        "place": {"covariate": covariate, "stream": "vertical speed"}, "sentence": "It sinks.", "rms": 0.5,
        "unit": "cm/s", "held_out_gain": gain, "instead_of": list(instead),
    }  # fmt: skip


def test_what_has_no_name_says_what_it_means():
    """Gains are told where they were asked for; a pitch that stands still is a matter of the sensor, not of nats."""
    assert "better by 34 nats" in page(content(verdict="unexplained", unexplained=[without_name()]), {})
    for covariate, words in (("stuck", "Look at the sensor first"), ("stroke", "set aside")):
        text = page(content(verdict="unexplained", unexplained=[without_name(covariate, None)]), {})
        assert words in text
        assert "nats" not in text[text.index("Without a name") : text.index("before and after</h2>")]


def test_a_doubted_name_is_not_to_be_acted_on():
    """The tag, the heading and the paragraph on what has no name all say so."""
    one = without_name(instead=["flight.pitch_gain"])
    text = page(content(effect(doubted=True, tentative=True), verdict="unexplained", unexplained=[one]), {})
    assert "doubtful" in text and "Doubtful: Pitch scale" in text and "do not act on it" in text
