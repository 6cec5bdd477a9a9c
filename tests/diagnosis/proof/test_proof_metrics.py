"""Scores: intervals against published values, and every judgement on cases made by hand."""

from __future__ import annotations

import math

import pytest

from glider_jax.diagnosis.proof.metrics import (
    candidates,
    confusion,
    gain,
    judge,
    median,
    share,
    strength,
    summary,
    table,
    wilson,
)


def truth(*ids, kind="single", strengths=None, **values):
    effects = {key.replace("__", "."): v for key, v in values.items()} or {f"{id}.x": 1.0 for id in ids}
    return {
        "name": "c1", "kind": kind, "region": "r", "effects": effects, "product": True,
        "strengths": strengths or dict.fromkeys(ids, 8.0),
    }  # fmt: skip


def found(*effects, verdict="explained", **more):
    return {"verdict": verdict, "effects": list(effects)} | more


def effect(id, **more):
    return {"id": id} | more


def test_wilson_gives_published_intervals():
    assert wilson(3, 150) == pytest.approx((0.0068, 0.0571), abs=2e-4)
    assert wilson(1, 60) == pytest.approx((0.0029, 0.0886), abs=2e-4)
    assert wilson(0, 60)[0] == 0.0 and wilson(60, 60)[1] == 1.0
    assert wilson(0, 0) == (0.0, 1.0)


def test_shares_and_medians():
    assert share([True, False, True, True])["share"] == 0.75
    assert share([])["share"] is None
    one = median([1.0, 2.0, 3.0, math.nan])
    assert one["median"] == 2.0 and one["cases"] == 3 and one["low"] <= 2.0 <= one["high"]
    assert median([])["median"] is None


def test_a_right_answer():
    result = judge(truth("a.b"), found(effect("a.b")), 60.0)
    assert result["first_exact"] and result["exact_set"] and result["first_class"] and result["all_found"]
    assert not result["flagged"] and result["silent"]


def test_a_neighbour_of_the_same_class_counts_by_class_only():
    for named in (
        effect("a.c", **{"class": ["a.b", "a.c"]}),
        effect("a.c", **{"class": {"name": "x", "members": ["a.b"]}}),
        effect("a.c", alternatives=[{"id": "a.b", "evidence": 1.0}]),
    ):
        result = judge(truth("a.b"), found(named), 1.0)
        assert result["first_class"] and result["all_in_class"]
        assert not (result["first_exact"] or result["exact_set"] or result["all_found"])
    assert candidates(effect("a.c")) == {"a.c"}


def test_extras_spoil_the_set_but_not_the_pick():
    result = judge(truth("a.b"), found(effect("a.b"), effect("q.r")), 1.0)
    assert result["first_exact"] and not result["exact_set"]
    wrong_first = judge(truth("a.b"), found(effect("q.r"), effect("a.b")), 1.0)
    assert not wrong_first["first_exact"] and wrong_first["all_found"]


def test_nulls_and_outsiders():
    quiet = judge(truth(kind="null", strengths={}), found(verdict="nothing_missing"), 1.0)
    assert not quiet["alarm"] and quiet["strength"] is None
    loud = judge(truth(kind="null", strengths={}), found(effect("a.b")), 1.0)
    assert loud["alarm"]
    proxy = judge(truth("out.x", kind="out"), found(effect("a.b"), verdict="unexplained"), 1.0)
    assert proxy["flagged"] and not proxy["silent"]
    silent = judge(truth("out.x", kind="out"), found(effect("a.b")), 1.0)
    scores = summary([quiet, loud, proxy, silent])
    assert scores["null"]["false alarm"]["hits"] == 1
    assert scores["out"]["flagged unexplained"]["share"] == 0.5
    assert scores["out"]["named and not flagged"]["hits"] == 1


def test_coverage_reads_both_layouts_and_skips_shapes():
    one = {"a.b.x": 0.5, "a.b.scale": 9.0}
    t = truth("a.b") | {"effects": one}
    inside = effect("a.b", parameters={"x": {"value": 0.4, "low": 0.3, "high": 0.6}})
    outside = effect("a.b", parameters=[{"name": "x", "interval": [0.6, 0.7]}])
    assert judge(t, found(inside), 1.0)["covered"] == [True]
    assert judge(t, found(outside), 1.0)["covered"] == [False]
    assert judge(t, found(effect("q.r")), 1.0)["covered"] == []
    current = truth("navigation.mean_current") | {
        "effects": {"navigation.mean_current.east": 0.1},
        "product": False,
    }
    named = effect("navigation.mean_current", parameters={"east": {"low": 0, "high": 0.01}})
    assert judge(current, found(named), 1.0)["covered"] == []


def test_gain_is_relative_to_the_oracle():
    def held(before, after):
        return {
            "held_out": {"streams": {"w": {"before": {"log_score": before}, "after": {"log_score": after}}}}
        }

    assert gain(held(-100.0, -60.0), held(-100.0, -50.0)) == pytest.approx(0.8)
    assert gain(held(-100.0, -60.0), held(-100.0, -99.0)) is None
    assert gain(held(-100.0, -60.0), None) is None
    assert gain({}, held(-100.0, -50.0)) is None


def test_strength_is_that_of_the_weakest():
    assert strength(truth("a.b", "c.d", strengths={"a.b": 9.0, "c.d": 4.0})) == 4.0
    assert strength(truth("out.x", strengths={"out.x": None})) == math.inf


def test_bands_and_table():
    results = [
        judge(truth("a.b", strengths={"a.b": s}), found(effect("a.b")), 30.0) for s in (2.5, 4.0, 8.0, 20.0)
    ]
    results += [judge(truth("a.b", strengths={"a.b": 9.0}), found(verdict="nothing_missing"), 30.0)]
    scores = summary(results)
    assert scores["single"][">=6"]["first pick right"]["hits"] == 2
    assert scores["single"][">=6"]["first pick right"]["cases"] == 3
    assert scores["single"]["0-3"]["exact set"]["share"] == 1.0
    assert scores["minutes a case"]["median"] == 0.5
    assert "| single / >=6 | first pick right | 2/3 = 67 % | 21 to 94 % |" in table(scores)
    assert confusion(results) == {"a.b": {"a.b": 4, "nothing": 1}}
