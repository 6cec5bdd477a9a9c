"""The forecast as one picture: where the glider may go, and where it comes up next.

Left, the whole forecast: depth contours, mean current, density of all members' tracks, some tracks, 50 and 90 % regions
at chosen times, waypoints, start and median end. Right, the next surfacings enlarged, with their times and places in
words. Drawn with the Agg canvas alone, without pyplot, because importing that costs half a second.
"""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import FancyBboxPatch

from glider_jax.products import cartography as chart
from glider_jax.products.coordinates import unwrap_longitude
from glider_jax.products.figure_style import save_figure, style_of
from glider_jax.products.summary import summarise
from glider_jax.products.wording import drawn
from glider_jax.records import Array, BathymetryGrid, CurrentGrid, Track

_TRACKS = 12
_MOST_POINTS = 2_000_000
_MAIN = (0.065, 0.095, 0.565, 0.80)
_ZOOM = (0.715, 0.475, 0.265, 0.42)
_ZOOM_ALONE = (0.715, 0.29, 0.265, 0.42)
_SIZE = (13.0, 8.6)
# Shares of the width and height of the map that the legend and the key take.
_LEGEND, _KEY = (0.26, 0.22), (0.35, 0.11)
_SURFACING_COLOURS = (chart.VERMILLION, chart.BLUE, chart.GREEN, chart.PURPLE)


def plot_map(
    track: Track,
    path: str | Path,
    *,
    bathymetry: BathymetryGrid | None = None,
    currents: CurrentGrid | None = None,
    summary: Mapping[str, Any] | None = None,
    title: str | None = None,
    style: str = "screen",
    dpi: int | None = None,
) -> Path:
    """Draw the map of a forecast as PNG.

    Parameters
    ----------
    track : the ensemble, or a sample of it where ``summary`` speaks for all.
    path : final name.
    bathymetry, currents : what lies under the tracks; either may be absent.
    summary : from ``summarise``; made from the track if None.
    title : heading; the name of the mission in the settings if None.
    style, dpi : see ``products.figure_style``; the style's resolution if None.
    """
    look = style_of(style)
    summary = summarise(track) if summary is None else summary
    reference = float(summary["forecast"]["start_place"]["longitude"])
    longitude = unwrap_longitude(track.longitude, reference)
    figure = Figure(figsize=_SIZE, facecolor="white")
    FigureCanvasAgg(figure)
    main, zoom = figure.add_axes(_MAIN), figure.add_axes(_ZOOM if look.words else _ZOOM_ALONE)
    limits = map_limits(track, longitude, summary, reference)
    chart.prepare(main, limits)
    if bathymetry is not None:
        chart.draw_bathymetry(main, bathymetry, limits)
    start, end = float(track.time[0]), float(track.time[-1])
    key = chart.draw_currents(main, currents, limits, start, end) if currents is not None else None
    mesh = _draw_density(main, track, longitude, limits)
    _draw_tracks(main, track, longitude)
    shown = _draw_positions(main, summary, reference)
    _draw_marks(main, track, longitude, summary, reference)
    chart.draw_scale_bar(main, limits)
    legend, key_corner = _free_corners(track, longitude, summary, reference, limits)
    _draw_legend(main, shown, key, currents, legend)
    _draw_key(main, mesh, key_corner)
    _draw_zoom(zoom, track, longitude, summary, reference, bathymetry)
    if not look.words:
        zoom.set_title("", loc="left")
    if look.words:
        _write_words(figure, track, summary, title)
    return save_figure(figure, path, look, dpi=dpi, metadata=_metadata(summary))


def _metadata(summary: Mapping[str, Any]) -> dict[str, str]:
    made = summary["provenance"]
    return {
        "Software": f"glider_jax {made['version']}",
        "Title": "Glider ensemble forecast",
        "Description": f"seed {made['seed']}, {summary['forecast']['members']} members, {made['created']}",
    }


def map_limits(
    track: Track, longitude: Array, summary: Mapping[str, Any], reference: float, ratio: float | None = None
) -> chart.Limits:
    """Limits that hold all but the farthest thousandth of the members' places, the regions shown and the waypoints.

    Longitudes are unwrapped around ``reference``; ``ratio`` is the width of the map over its height, that of the
    static map if None.
    """
    active = np.asarray(track.active)
    if not active.any():
        # All ended at the start: their last places are all there is.
        active = np.ones_like(active)
    levels = (0.001, 0.999)
    lat, lon = (np.quantile(x[active], levels) for x in (np.asarray(track.latitude), longitude))
    marks = _marks(summary)
    marks = np.concatenate([marks, *_outlines(summary)])
    return chart.limits_around(
        np.concatenate([lat, marks[:, 0]]),
        np.concatenate([lon, unwrap_longitude(marks[:, 1], reference)]),
        ratio=_MAIN[2] * _SIZE[0] / (_MAIN[3] * _SIZE[1]) if ratio is None else ratio,
        least_km=5.0,
    )


def _marks(summary: Mapping[str, Any]) -> Array:
    """Latitude and longitude of the start and the waypoints, (k, 2)."""
    places = [summary["forecast"]["start_place"], *(waypoint["place"] for waypoint in summary["waypoints"])]
    return np.array([[place["latitude"], place["longitude"]] for place in places])


def _outlines(summary: Mapping[str, Any]) -> list[Array]:
    """Outlines of the regions shown, (point, 2) latitude and longitude."""
    return [
        np.asarray(polygon[0])[:, ::-1]
        for entry in _chosen(summary["positions"])
        for region in entry["regions"]
        for polygon in region["geometry"]["coordinates"]
    ]


def _free_corners(
    track: Track, longitude: Array, summary: Mapping[str, Any], reference: float, limits: chart.Limits
) -> tuple[str, str]:
    """Corners for the legend and the key in which they hide least; the scale bar has the lower left one."""
    step = max(1, track.n // 500)
    members = np.stack([np.asarray(track.latitude)[::step].ravel(), longitude[::step].ravel()], axis=1)
    outlines = np.concatenate([np.zeros((0, 2)), *_outlines(summary)])
    # A mark outweighs all members; the points of an outline count as ten each.
    groups = [(members, 1.0), (outlines, 10.0), (_marks(summary), float(len(members)))]

    def hidden(corner: str, size: tuple[float, float]) -> float:
        found = 0.0
        for places, weight in groups:
            x = (unwrap_longitude(places[:, 1], reference) - limits.west) / (limits.east - limits.west)
            y = (places[:, 0] - limits.south) / (limits.north - limits.south)
            beside = x > 1.0 - size[0] if corner.endswith("right") else x < size[0]
            found += weight * float((beside & (y > 1.0 - size[1] if "upper" in corner else y < size[1])).sum())
        return found

    pairs = itertools.permutations(("upper left", "lower right", "upper right"), 2)
    return min(pairs, key=lambda pair: hidden(pair[0], _LEGEND) + hidden(pair[1], _KEY))


def _draw_density(axes: Axes, track: Track, longitude: Array, limits: chart.Limits) -> AxesImage:
    """How often members are in each cell, all output times together, on a logarithmic scale."""
    active = np.asarray(track.active)
    x, y = longitude[active], np.asarray(track.latitude)[active]
    step = max(1, x.size // _MOST_POINTS)
    columns = 130
    rows = max(1, round(columns * (limits.north - limits.south) * limits.stretch / (limits.east - limits.west)))
    # Cells by multiplication rather than searching edges: ten times as fast for a million points.
    i = ((y[::step] - limits.south) * (rows / (limits.north - limits.south))).astype(np.intp)
    j = ((x[::step] - limits.west) * (columns / (limits.east - limits.west))).astype(np.intp)
    good = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
    counts = np.bincount(i[good] * columns + j[good], minlength=rows * columns).reshape(rows, columns) * step
    shown = np.ma.masked_equal(counts, 0)
    norm = LogNorm(vmin=1, vmax=max(float(counts.max()), 10.0))
    return axes.imshow(
        shown,
        extent=(limits.west, limits.east, limits.south, limits.north),
        origin="lower",
        aspect=limits.stretch,
        cmap="viridis_r",
        norm=norm,
        # Rare places are faint, so that the eye is not drawn to the edge.
        alpha=np.ma.filled(0.2 + 0.65 * norm(shown), 0.0),
        interpolation="nearest",
        zorder=1.5,
    )


def _draw_key(axes: Axes, mesh: AxesImage, corner: str) -> None:
    """The colours of the density, in a box in a corner."""
    x = 0.665 if corner.endswith("right") else 0.018
    y = 0.018 if corner.startswith("lower") else 0.907
    box = FancyBboxPatch(
        (x, y), 0.318, 0.075, boxstyle="round,pad=0,rounding_size=0.008", transform=axes.transAxes,
        facecolor="white", edgecolor="#CCCCCC", alpha=0.9, zorder=9,
    )  # fmt: skip
    axes.add_patch(box)
    inner = axes.inset_axes((x + 0.025, y + 0.034, 0.268, 0.018), zorder=10)
    bar = axes.figure.colorbar(mesh, cax=inner, orientation="horizontal")
    axes.text(x + 0.159, y + 0.057, "members × times per cell", fontsize=7.5, ha="center", va="bottom",
              transform=axes.transAxes, zorder=11)  # fmt: skip
    bar.ax.tick_params(labelsize=7, pad=1.5, length=2)
    bar.ax.minorticks_off()


def _draw_tracks(axes: Axes, track: Track, longitude: Array) -> None:
    chosen = np.unique(np.linspace(0, track.n - 1, min(_TRACKS, track.n)).astype(int))
    for k in chosen:
        last = max(int(np.asarray(track.active[k]).sum()), 1)
        axes.plot(
            longitude[k, : last + 1],
            track.latitude[k, : last + 1],
            color="black",
            linewidth=0.5,
            alpha=0.55,
            zorder=3,
        )


def _chosen(entries: list[Mapping[str, Any]], most: int = 4) -> list[Mapping[str, Any]]:
    """Positions spread over the forecast whose regions do not crowd the map."""
    entries = [entry for entry in entries if entry["regions"] and entry["share_active"] >= 0.5]
    if len(entries) <= most:
        return entries
    hours = np.array([entry["hours"] for entry in entries])
    wanted = np.linspace(0, hours[-1], most + 1)[1:]
    return [entries[k] for k in sorted({int(np.abs(hours - w).argmin()) for w in wanted})]


def _draw_positions(axes: Axes, summary: Mapping[str, Any], reference: float) -> bool:
    """Regions at chosen times: 50 % as a solid line, 90 % as a dashed one, labelled with hours."""
    chosen = _chosen(summary["positions"])
    taken: list[tuple[float, float]] = []
    height = float(np.ptp(axes.get_ylim()))
    for entry in chosen:
        for region in entry["regions"]:
            inner = region["probability"] <= 0.5
            chart.draw_rings(
                axes, region["geometry"], reference, color=chart.ORANGE if inner else chart.VERMILLION,
                linewidth=1.8 if inner else 1.3, linestyle="-" if inner else (0, (5, 2)), zorder=5,
            )  # fmt: skip
        place = entry["place"]
        top = max(
            (point for ring in entry["regions"][-1]["geometry"]["coordinates"] for point in ring[0]),
            key=lambda point: point[1],
            default=[place["longitude"], place["latitude"]],
        )
        hours = entry["hours"]
        label = f"+{hours:g} h" if hours < 48 else f"+{hours / 24:g} d"
        x, y = float(unwrap_longitude(top[0], reference)), top[1]
        # Labels that would lie on one another are lifted clear.
        while any(abs(y - other[1]) < 0.022 * height and abs(x - other[0]) < 0.08 * height for other in taken):
            y += 0.024 * height
        taken.append((x, y))
        axes.annotate(
            label, (x, y), xytext=(0, 3), textcoords="offset points", ha="center", va="bottom", fontsize=8.5,
            fontweight="bold", path_effects=chart.HALO, zorder=8,
        )  # fmt: skip
    return bool(chosen)


def _draw_marks(axes: Axes, track: Track, longitude: Array, summary: Mapping[str, Any], reference: float) -> None:
    """Waypoints with their numbers, the start, and the median of the members' last places."""
    for waypoint in summary["waypoints"]:
        x, y = (
            float(unwrap_longitude(waypoint["place"]["longitude"], reference)),
            waypoint["place"]["latitude"],
        )
        axes.plot(
            x,
            y,
            marker="o",
            markersize=13,
            color="white",
            markeredgecolor="black",
            markeredgewidth=1.2,
            zorder=7,
        )
        axes.text(
            x,
            y,
            str(waypoint["number"]),
            ha="center",
            va="center_baseline",
            fontsize=8.5,
            fontweight="bold",
            zorder=8,
        )
    start = summary["forecast"]["start_place"]
    axes.plot(
        float(unwrap_longitude(start["longitude"], reference)), start["latitude"], marker="^", markersize=11,
        color=chart.GREEN, markeredgecolor="white", markeredgewidth=1.2, linestyle="none", zorder=7.5,
    )  # fmt: skip
    axes.plot(
        np.median(longitude[:, -1]), np.median(track.latitude[:, -1]), marker="s", markersize=9, color=chart.PURPLE,
        markeredgecolor="white", markeredgewidth=1.2, linestyle="none", zorder=7.5,
    )  # fmt: skip


def _draw_legend(axes: Axes, regions: bool, key: float | None, currents: CurrentGrid | None, corner: str) -> None:
    handles = [
        Line2D([], [], marker="^", color=chart.GREEN, linestyle="none", markersize=9, label="start"),
        Line2D([], [], marker="s", color=chart.PURPLE, linestyle="none", markersize=8, label="median end"),
        Line2D(
            [],
            [],
            marker="o",
            color="white",
            markeredgecolor="black",
            linestyle="none",
            markersize=9,
            label="waypoint",
        ),
        Line2D([], [], color="black", linewidth=0.6, label="single members"),
    ]
    if regions:
        handles += [
            Line2D([], [], color=chart.ORANGE, linewidth=1.8, label="50 % region"),
            Line2D([], [], color=chart.VERMILLION, linewidth=1.3, linestyle=(0, (5, 2)), label="90 % region"),
        ]
    if key is not None:
        depth = float(currents.depth[0]) if currents.depth.size else 0.0
        where = "surface" if depth < 1.0 else f"{depth:g} m"
        handles.append(Line2D([], [], color="#3C4A55", marker=r"$\rightarrow$", markersize=12, linestyle="none",
                              label=f"mean current ({where})"))  # fmt: skip
    axes.legend(handles=handles, loc=corner, fontsize=8, framealpha=0.9, borderpad=0.6).set_zorder(10)


def _draw_zoom(
    axes: Axes, track: Track, longitude: Array, summary: Mapping[str, Any], reference: float,
    bathymetry: BathymetryGrid | None,
) -> None:  # fmt: skip
    """The next three surfacings: members as dots, regions, numbers."""
    entries = [entry for entry in summary["surfacings"][:3] if entry["place"]]
    if not entries:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no surfacing within the forecast", ha="center", va="center", transform=axes.transAxes)
        return
    points = [
        point for entry in entries for region in entry["regions"] for polygon in region["geometry"]["coordinates"]
        for point in polygon[0]
    ] + [[entry["place"]["longitude"], entry["place"]["latitude"]] for entry in entries]  # fmt: skip
    begin = summary["forecast"]["start_place"]
    places = np.array([*points, [begin["longitude"], begin["latitude"]]])
    ratio = _ZOOM[2] * _SIZE[0] / (_ZOOM[3] * _SIZE[1])
    limits = chart.limits_around(
        places[:, 1], unwrap_longitude(places[:, 0], reference), ratio=ratio, margin=0.12, least_km=0.5
    )
    chart.prepare(axes, limits)
    if bathymetry is not None:
        chart.draw_bathymetry(axes, bathymetry, limits)
    step = max(1, track.n // 400)
    axes.plot(float(unwrap_longitude(begin["longitude"], reference)), begin["latitude"], marker="^", markersize=10,
              color=chart.GREEN, markeredgecolor="white", zorder=7)  # fmt: skip
    for k, entry in enumerate(entries):
        colour = _SURFACING_COLOURS[k]
        axes.plot(
            unwrap_longitude(track.surfacing_longitude[::step, k], reference), track.surfacing_latitude[::step, k],
            ".", color=colour, markersize=1.6, alpha=0.5, zorder=3,
        )  # fmt: skip
        for region in entry["regions"]:
            inner = region["probability"] <= 0.5
            chart.draw_rings(
                axes, region["geometry"], reference, color=colour, linewidth=2.0 if inner else 1.1,
                linestyle="-" if inner else (0, (5, 2)), zorder=5,
            )  # fmt: skip
        axes.text(
            float(unwrap_longitude(entry["place"]["longitude"], reference)), entry["place"]["latitude"],
            str(entry["number"]), ha="center", va="center", fontsize=10, fontweight="bold", color=colour,
            path_effects=chart.HALO, zorder=8,
        )  # fmt: skip
    chart.draw_scale_bar(axes, limits)
    axes.tick_params(labelsize=7)
    axes.set_title("Next surfacings: 50 % (solid), 90 % (dashed)", fontsize=9.5, loc="left")


def _clock(text: str | None) -> str:
    """``2012-10-25T03:00:00Z`` as ``25 Oct 03:00Z``."""
    if not text:
        return "after the end"
    months = "Jan Feb Mar Apr May Jun Jul Aug Sep Oct Nov Dec".split()
    return f"{text[8:10]} {months[int(text[5:7]) - 1]} {text[11:16]}Z"


def _between(time: Mapping[str, str | None]) -> str:
    """The 90 % interval; the day is said once where both ends have the same."""
    first, last = _clock(time["p05"]), _clock(time["p95"])
    return f"{first} to {last[7:]}" if first[:6] == last[:6] else f"{first} to {last}"


def _write_words(figure: Figure, track: Track, summary: Mapping[str, Any], title: str | None) -> None:
    """Heading, the surfacings in words, outcomes, and what the picture was made from."""
    forecast = summary["forecast"]
    parts = [str(track.settings[key]) for key in ("mission", "vehicle") if track.settings.get(key)]
    name = title or ("Forecast: " + ", ".join(parts) if parts else "Glider ensemble forecast")
    figure.text(0.065, 0.958, drawn(name), fontsize=15, fontweight="bold", va="bottom")
    partial = "" if forecast["complete"] else " · PARTIAL, the run was interrupted"
    span = f"{forecast['horizon_h']:g} h" if forecast["horizon_h"] < 96 else f"{forecast['horizon_h'] / 24:g} days"
    heading = f"{span} from {forecast['start'][:16].replace('T', ' ')}Z · {forecast['members']:,} members{partial}"
    figure.text(0.065, 0.934, heading, fontsize=10.5, va="bottom", color="#333333")
    y = 0.405
    for k, entry in enumerate(summary["surfacings"][:3]):
        if not entry["place"]:
            continue
        time, area = entry["time"], {r["probability"]: r["area_km2"] for r in entry["regions"]}
        figure.text(
            0.700,
            y,
            f"{entry['number']}",
            color=_SURFACING_COLOURS[k],
            fontsize=13,
            fontweight="bold",
            va="top",
        )
        sizes = f"50 % {area[0.5]:.2g} km², 90 % {area[0.9]:.2g} km²" if area else "too few members for a region"
        share = "" if entry["probability"] > 0.9995 else f" · {entry['probability']:.1%} of members"
        place = entry["place"]
        words = (
            f"{_clock(time['median'])}   (90 %: {_between(time)})\n"
            f"{place['text']}   ({place['latitude']:.4f}, {place['longitude']:.4f})\n{sizes}{share}"
        )
        figure.text(0.717, y, words, fontsize=8.8, va="top", linespacing=1.35)
        y -= 0.083
    y -= 0.008
    outcomes = "\n".join(
        textwrap.fill(f"{entry['share']:.1%} {entry['sentence']}", 66, subsequent_indent="      ")
        for entry in summary["outcomes"][:4]
    )
    figure.text(0.700, y, "Members", fontsize=9, fontweight="bold", va="top")
    figure.text(0.700, y - 0.022, outcomes, fontsize=8.8, va="top", linespacing=1.35)
    made = summary["provenance"]
    inputs = ", ".join(Path(str(item)).name for item in made["inputs"]) or "not stated"
    caption = f"glider_jax {made['version']} · seed {made['seed']} · made {made['created']} · inputs: {inputs}"
    figure.text(0.065, 0.018, drawn(textwrap.shorten(caption, 190, placeholder=" ...")), fontsize=7.5,
                color="#555555", va="bottom")  # fmt: skip
