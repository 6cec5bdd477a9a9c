"""The report of a diagnosis as one HTML page: first what a pilot needs, below it numbers, equations and sources.

Imports the physics' declarations. A newcomer would get wrong: every text from a recording or a file is escaped, and
the page needs nothing from outside.
"""

from __future__ import annotations

import base64
import html
from datetime import UTC, datetime
from typing import Any

from glider_jax.diagnosis.candidates import USUAL
from glider_jax.diagnosis.schema import size_in_words, spoken
from glider_jax.physics.library import TERMS_BY_ID

#: nats from which evidence is called sure.
SURE = 15.0
_NUMBERS = ("No", "One", "Two", "Three", "Four", "Five", "Six", "Seven")
e = html.escape


def undecided(content: dict[str, Any], least: float = 2.0) -> list[dict[str, Any]]:
    """Usual effects that this recording could show only at many times their typical size; the likeliest first."""
    found = []
    twins = {a["id"] for effect in content["effects"] for a in effect["alternatives"]}
    for entry in content["not_found"]:
        sizes = [p["minimum"] / p["typical"] for p in entry["minimum_detectable"] if p["minimum"] and p["typical"]]
        if entry["id"] in USUAL - twins and sizes and min(sizes) > least:
            found.append(entry)
    return sorted(found, key=lambda entry: -(entry["evidence"] or 0.0))


def headline(content: dict[str, Any]) -> str:
    """The verdict in one line."""
    count = len(content["effects"])
    if content["verdict"] == "nothing_missing":
        return "Nothing is missing: the model explains this recording"
    number = _NUMBERS[count] if count < len(_NUMBERS) else str(count)
    left_out = f"{number} {'effect was' if count == 1 else 'effects were'} left out of the model"
    if content["verdict"] == "unexplained":
        return f"{left_out}, and part of the mismatch has no name" if count else "Part of the mismatch has no name"
    return left_out


def page(content: dict[str, Any], pictures: dict[str, bytes]) -> str:
    """The whole page; ``pictures`` are PNG by name."""
    recording = content["recording"]
    start = datetime.fromtimestamp(recording["start"], UTC).strftime("%d %B %Y, %H:%M UTC")
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'><meta name='viewport' "
        "content='width=device-width'><title>Diagnosis</title><style>", _STYLE, "</style></head><body>",
        f"<h1>{e(headline(content))}</h1>",
        f"<p class='small'>{e(recording['name'])}{_which(content)}, from {start}: {recording['days']:.1f} days, "
        f"{recording['dives']} dives between surfacings or blocks of yos, {recording['legs']} half yos. "
        f"Vehicle {e(content['vehicle']['name'])}. Diagnosed in {content['seconds']:.0f} s.</p>",
    ]  # fmt: skip
    parts += [_lead(effect) for effect in content["effects"]]
    parts += [f"<p class='warn'>{e(text)}</p>" for text in content["warnings"]]
    parts.append(_changes(content))
    parts.append(_next_steps(content))
    parts.append(_regimes(content))
    for effect in content["effects"]:
        parts.append(_effect(effect))
    parts.append(_flow(content))
    parts.append(_unexplained(content, pictures))
    parts.append("<h2>Measured minus model, before and after</h2>")
    parts.append(
        _picture(pictures, "residuals", "Violet: the model as given, calibrated. Green: with what was left out.")
    )
    parts.append("<h2>For the oceanographer</h2>")
    parts += [_held_out(content), _places(content, pictures), _calibration(content), _limits(content)]
    if content["missing"] or content["notes"]:
        lines = "".join(f"<li>{e(t)}</li>" for t in (*content["missing"], *content["notes"]))
        parts.append(f"<h3>What was missing, and notes</h3><ul>{lines}</ul>")
    parts.append(_sources(content))
    parts.append("</body></html>")
    return "\n".join(part for part in parts if part)


def _which(content: dict[str, Any]) -> str:
    told = content.get("regimes")
    return f", mission {len(told)} of {len(told)}" if told else ""


def _sureness(effect: dict[str, Any]) -> str:
    if effect.get("doubted"):
        return "doubtful: looks like it, but a curve without physics fits better"
    if effect["tentative"]:
        return "perhaps"
    if effect["alternatives"]:
        return "this or a near twin"
    return "sure" if effect["evidence"] > SURE and effect["held_out"]["confirmed"] else "likely"


def _lead(effect: dict[str, Any]) -> str:
    twins = ", or ".join(spoken(a["title"]) for a in effect["alternatives"])
    or_twins = f" It could as well be {e(twins)}." if twins else ""
    single = len(effect["parameters"]) == 1 and effect["parameters"][0]["value"] < 0.0
    or_twins = (" Here the other way round: the number is negative." if single else "") + or_twins
    if effect["class"]["twins"]:
        or_twins += f" The measurements alone could not tell it from {', or from '.join(_twins(effect))}."
    return (
        f"<p class='card'><b>{e(effect['title'])}</b>{e(size_in_words(effect))} "
        f"<span class='tag'>{_sureness(effect)}</span><br>{e(effect['plain'])}{or_twins}</p>"
    )


def _twins(effect: dict[str, Any]) -> list[str]:
    """What fits as well and is not likely, with the size that it would have to have."""
    told = []
    for one in effect["class"]["twins"]:
        size = f"{one['shown']['value']:.2g} {one['shown']['unit']}".removesuffix(" 1")
        times = one["times_typical"]
        why = f", {times:.0f} times its usual size" if times > 2.0 else ", which is rarer"
        told.append(f"{e(spoken(one['title']))} ({e(size)}{why})")
    return told


def _changes(content: dict[str, Any]) -> str:
    """What the named effects change for a pilot: where it surfaces, what it draws."""
    rows = []
    figures = content["held_out"]["figures"]
    pair = figures.get("surfacing_error_m")
    if pair:
        rows.append(("miss of a dive segment, median", pair["before"], pair["after"], "", "m"))
    pair = figures.get("energy_error_j_per_day")
    if pair:
        rows.append(("energy the model did not expect", pair["before"] / 1e3, pair["after"] / 1e3, "", "kJ a day"))
    flown = content.get("ensemble")
    if flown:
        before, after, known = flown["before"], flown["after"], flown["recorded_charge_ah_per_day"]
        text = f"ensemble of {flown['members']} over {flown['hours']:.0f} h, "
        rows.append((text + "miss of a surfacing", before["position_error_m"], after["position_error_m"], "", "m"))
        rows.append((text + "energy score", before["energy_score_m"], after["energy_score_m"], "", "m"))
        recorded = "" if known is None else f"{known:.2f}"
        rows.append((text + "charge", before["charge_ah_per_day"], after["charge_ah_per_day"], recorded, "Ah a day"))
    if not rows or not content["effects"]:
        return ""
    cells = "".join(
        f"<tr><td>{e(name)}</td><td>{_plain(before)}</td><td><b>{_plain(after)}</b></td><td>{recorded}</td>"
        f"<td>{unit}</td></tr>"
        for name, before, after, recorded, unit in rows
    )
    missed = content.get("forecast_misses")
    said = f"<p>{e(missed['sentence'])}</p>" if missed else ""
    return (
        "<h2>What it changes</h2><table><tr><th></th><th>without</th><th>with</th><th>recorded</th><th></th></tr>"
        f"{cells}</table>{said}"
    )


def _plain(value: float) -> str:
    """Three figures, without an exponent where a pilot would read metres."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def _level(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 200.0 else f"{value:.2f}" if abs(value) >= 1.0 else f"{value:.3f}"


def _next_steps(content: dict[str, Any]) -> str:
    steps = []
    if content["effects"]:
        steps.append(
            "Forecast with what was found: <code>glider-forecast ensemble --vehicle vehicle.toml</code>, the file "
            "beside this page."
        )
    for effect in content["effects"]:
        if (effect["alternatives"] or effect["class"]["twins"]) and effect["class"]["decided_by"]:
            steps.append(f"To tell {e(spoken(effect['title']))} from its twins: {e(effect['class']['decided_by'])}.")
    unknown = undecided(content)
    if unknown:
        names = "; ".join(f"{e(spoken(n['title']))} ({e(n['decided_by'])})" for n in unknown[:8])
        steps.append(f"This recording cannot tell, even if they were large: {names}.")
    if not steps:
        return ""
    return "<h2>What to do</h2><ul>" + "".join(f"<li>{step}</li>" for step in steps) + "</ul>"


def _regimes(content: dict[str, Any]) -> str:
    told = content.get("regimes")
    if not told:
        return ""
    names = list(dict.fromkeys(name for one in told for name in one["levels"]))
    heads = "".join(
        f"<th>mission {one['number']}<br>{datetime.fromtimestamp(one['start'], UTC):%d %b}</th>" for one in told
    )
    rows = ""
    for name in names:
        cells = "".join(
            f"<td>{_level(one['levels'][name]['value'])}</td>" if name in one["levels"] else "<td></td>" for one in told
        )
        unit = next(one["levels"][name]["unit"] for one in told if name in one["levels"])
        rows += f"<tr><td>{e(name.removeprefix('flight.').replace('_', ' '))}</td>{cells}<td>{e(unit)}</td></tr>"
    named = "".join(
        f"<li>Mission {one['number']}: {e('; '.join(spoken(t) for t in one['titles']) or 'nothing')} left out. "
        + (f"<a href='mission-{one['number']}/report.html'>Its own page.</a>" if one is not told[-1] else "This page.")
        + "</li>"
        for one in told
    )
    return f"<h2>Missions</h2><table><tr><th></th>{heads}<th></th></tr>{rows}</table><ul>{named}</ul>"


def _effect(effect: dict[str, Any]) -> str:
    word = "Doubtful: " if effect.get("doubted") else "Perhaps: " if effect["tentative"] else ""
    lines = [f"<h2>{word}{e(effect['title'])}</h2>"]
    if effect["located"]:
        lines.append(f"<p>Where it shows: {e(effect['located'])}</p>")
    rows = "".join(
        f"<tr><td>{e(_label(p))}</td><td>{p['shown']['value']:.3g} {e(p['shown']['unit'])}</td>"
        f"<td>{p['shown']['interval_90'][0]:.3g} to {p['shown']['interval_90'][1]:.3g}</td></tr>"
        for p in effect["parameters"]
    )
    lines.append(f"<table><tr><th></th><th>value</th><th>90 % interval</th></tr>{rows}</table>")
    for name, value in effect["shapes"].items():
        lines.append(
            f"<p>{e(name)}: {value / 3600.0:.3g} h</p>"
            if name in ("period", "onset", "decay")
            else f"<p>{e(name)}: {value:.3g}</p>"
        )
    held = effect["held_out"]
    gain = "" if held["gain"] is None else f" ({held['gain']:.0f} nats gained)"
    sure = "holds" if held["confirmed"] else "does not surely hold"
    lines.append(
        f"<p class='small'>{e(effect['id'])}. Evidence {effect['evidence']:.1f} nats; {sure} on dives left out of the "
        f"fit{gain}.</p>"
    )
    if effect["alternatives"]:
        names = ", ".join(f"{e(spoken(a['title']))} ({a['behind']:+.1f} nats behind)" for a in effect["alternatives"])
        lines.append(f"<p class='small'>As well explained by: {names}.</p>")
    return "\n".join(lines)


def _label(parameter: dict[str, Any]) -> str:
    """A parameter's text; that of another term than the effect's own says which."""
    term = parameter["name"].rpartition(".")[0]
    return f"{TERMS_BY_ID[term].info.title}: {parameter['text']}" if term in TERMS_BY_ID else parameter["text"]


def _flow(content: dict[str, Any]) -> str:
    told = content.get("flow")
    if not told:
        return ""
    rows = "".join(
        f"<tr><td>{row['predicted']} after the first {row['fitted']}</td><td>{row['before_m']:.0f}</td>"
        f"<td><b>{row['after_m']:.0f}</b></td><td>{row['persistence_m']:.0f}</td></tr>"
        for row in told["later"]
    )
    table = (
        "<table><tr><th>later segments, median miss in m</th><th>still water</th><th>with the flow</th>"
        f"<th>last segment's flow</th></tr>{rows}</table>"
        if rows
        else ""
    )
    return (
        "<h2>The flow that no product gave</h2>"
        f"<p>Between its fixes the water moved {100.0 * told['rms']:.0f} cm/s (rms over the segments).</p>{table}"
    )


def _unexplained(content: dict[str, Any], pictures: dict[str, bytes]) -> str:
    if not content["unexplained"]:
        return ""
    lines = ["<h2>Without a name</h2>"]
    for one in content["unexplained"]:
        lines.append(f"<p>{e(one['sentence'])} {e(_without_name(one))}</p>")
    lines.append(_picture(pictures, "unexplained", "Shape of what has no name, with its 90 % band."))
    return "\n".join(lines)


def _without_name(one: dict[str, Any]) -> str:
    """What structure without a name is worth, and what it means for what was named."""
    if one["place"]["covariate"] == "stuck":
        return "Look at the sensor first: effects named in speed, lift or drag may be its doing."
    if one["place"]["covariate"] == "stroke":
        return (
            f"Their excess is {one['rms']:.2g} {one['unit']} rms. They were set aside from the pump's own cost; what "
            "made them is not in the catalogue."
        )
    said = f"Size {one['rms']:.2g} {one['unit']} rms where it is."
    if one["held_out_gain"] is not None:
        said += f" As a smooth curve it foretells dives left out of the fit better by {one['held_out_gain']:.0f} nats."
    if one["instead_of"]:
        names = " and ".join(spoken(TERMS_BY_ID[id].info.title) for id in one["instead_of"])
        return (
            f"{said} A curve without physics explains more than {names} in its place: the name is that of a neighbour, "
            "do not act on it."
        )
    return said + " No effect of the catalogue fits it, so what is named in the same measurement is tentative."


def _held_out(content: dict[str, Any]) -> str:
    rows = "".join(
        f"<tr><td>{e(name)}</td><td>{s['n']}</td><td>{s['before']['rms']:.3g}</td><td>{s['after']['rms']:.3g}</td>"
        f"<td>{s['floor']:.3g}</td><td>{e(s['unit'])}</td>"
        f"<td>{s['after']['log_score'] - s['before']['log_score']:+.1f}</td></tr>"
        for name, s in content["held_out"]["streams"].items()
    )
    return (
        "<h3>On dives left out of the fit (rms)</h3><table><tr><th>measurement</th><th>number</th><th>before</th>"
        f"<th>after</th><th>noise</th><th>unit</th><th>log score gained</th></tr>{rows}</table>"
    )


def _places(content: dict[str, Any], pictures: dict[str, bytes]) -> str:
    lines = "".join(f"<li>{e(p['sentence'])}</li>" for p in content["localisation"][:8])
    said = f"<ul>{lines}</ul>" if lines else "<p>Nowhere beyond chance.</p>"
    picture = _picture(pictures, "places", "How surely each measurement's mismatch depends on what; dark is sure.")
    return f"<h3>Where the mismatch is</h3>{said}{picture}"


def _calibration(content: dict[str, Any]) -> str:
    rows = "".join(
        f"<tr><td>{e(c['name'])}</td><td>{c['given']:.6g} &plusmn; {c['sigma']:.3g}</td>"
        f"<td>{c['fitted']:.6g} &plusmn; {c['sd']:.2g}</td></tr>"
        for c in content["calibration"]
        if c["kind"] == "calibration"
    )
    return (
        "<h3>The vehicle's own numbers</h3><p>They were free within their stated uncertainty, so what they explain was "
        f"not called left-out physics.</p><table><tr><th></th><th>given</th><th>fitted</th></tr>{rows}</table>"
    )


def _limits(content: dict[str, Any]) -> str:
    rows = ""
    for entry in content["not_found"]:
        sizes = ", ".join(
            f"{p['shown']['minimum']:.3g} {e(p['shown']['unit'])}"
            for p in entry["minimum_detectable"]
            if p["shown"]["minimum"] is not None
        )
        if entry["verdict"] == "not_testable":
            sizes = f"no likely size, only {sizes}" if sizes else "cannot be seen in this recording"
        rows += f"<tr><td>{e(entry['title'])}</td><td>{sizes}</td></tr>"
    return (
        "<h3>What was looked for and not found</h3><details><summary>Smallest size of each that would surely have been "
        f"seen</summary><table><tr><th></th><th>smallest size</th></tr>{rows}</table></details>"
    )


def _sources(content: dict[str, Any]) -> str:
    rows = "".join(
        f"<li>{e(x['title'])}: <code>{e(x['equation'])}</code>. {e(x['reference'])}.</li>" for x in content["effects"]
    )
    path = "".join(f"<li>{e(line)}</li>" for line in content["search"]["path"]) or "<li>nothing was accepted</li>"
    return (
        f"<h3>Equations and sources</h3><ul>{rows}</ul><h3>How the search went</h3><ul>{path}</ul><p class='small'>"
        f"{content['search']['candidates']} effects were tried. An effect is accepted at 4.3 nats of evidence beyond "
        "its prior odds, with the vehicle's calibrations free and noise that is alike within dives and over hours. A "
        "nat is a factor of e in the odds.</p>"
    )


def _picture(pictures: dict[str, bytes], name: str, text: str) -> str:
    if name not in pictures:
        return ""
    data = base64.b64encode(pictures[name]).decode()
    caption = e(text)
    image = f"<img alt='{caption}' src='data:image/png;base64,{data}'>"
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
h1{line-height:1.2}h2{margin-top:2rem}.small{color:#666;font-size:.85rem}
.warn{background:#fff3cd;padding:.5rem .8rem}.card{border-left:.3rem solid #1b9e77;padding:.2rem .8rem;margin:.8rem 0}
.tag{background:#e8f4f0;border-radius:.6rem;padding:0 .6rem;font-size:.85rem;white-space:nowrap}
table{border-collapse:collapse;margin:.6rem 0}td,th{border-bottom:1px solid #ddd;padding:.2rem .7rem;text-align:left}
img{max-width:100%}figure{margin:1rem 0}figcaption{color:#666;font-size:.85rem}code{background:#f4f4f4;padding:0 .2rem}
"""
