"""``--html`` and ``--style`` through the entry point: the page appears, says what it forecasts; bad words are named."""

from __future__ import annotations

import json

from tests.readers.glider_layouts import simulate, write_native


def test_ensemble_writes_the_page_beside_the_other_products(run, tmp_path):
    words = ["ensemble", "--n", "40", "--days", "0.5", "--format", "json,map", "--html", "--style", "paper", "--json"]
    code, out, err = run(*words, "--out", tmp_path / "f")
    assert code == 0, err
    assert sorted(p.name for p in (tmp_path / "f").iterdir()) == ["map.pdf", "map.png", "report.html", "summary.json"]
    text = (tmp_path / "f" / "report.html").read_text(encoding="utf-8")
    first = json.loads(out)["surfacings"][0]["place"]
    assert first["text"] in text and "new_jersey" in text and "report.html" in err
    assert "covers the forecast" in text and '"land"' in text


def test_an_unknown_style_is_named(run):
    for words in (["ensemble", "--n", "5"], ["plan"], ["validate"], ["hindcast", "x.nc"]):
        code, _, err = run(*words, "--style", "papr")
        assert code == 1 and "'papr'" in err and "paper" in err


def test_next_and_hindcast_write_their_pages(run, tmp_path):
    recording = write_native(tmp_path / "unit.nc", simulate(dives=4, yos=6))
    code, _, err = run("next", "--recording", recording, "--now", "data", "--n", "100", "--hours", "12", "--html")
    assert code == 0, err
    text = (tmp_path / "next" / "next.html").read_text(encoding="utf-8")
    assert "Next first fix" in text and "last fix" in text and " h old" in text
    code, _, err = run("hindcast", recording, "--n", "100", "--html", "--out", "h")
    assert code == 0, err
    assert "Every surfacing" in (tmp_path / "h" / "hindcast.html").read_text(encoding="utf-8")
    code, _, err = run("hindcast", recording, "--html")
    assert code == 1 and "--out" in err


def test_plan_writes_its_page(run, tmp_path):
    code, _, err = run(
        "plan", "--loop", "--days", "1", "--n", "4", "--vary", "pitch=20,26", "--no-tornado", "--html", "--out", "p"
    )  # fmt: skip
    assert code == 0, err
    assert "Every setting" in (tmp_path / "p" / "plan.html").read_text(encoding="utf-8")
