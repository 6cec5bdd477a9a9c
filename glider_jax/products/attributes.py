"""Global attributes of the forecast file: ACDD-1.3 discovery, CF, provenance and completion."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from glider_jax.products.coordinates import iso_time
from glider_jax.products.provenance import provenance, settings_text
from glider_jax.records import Track


def global_attributes(
    track: Track, members: int, extent: dict[str, list[float]], identifier: str
) -> dict[str, Any]:
    """Attributes for a finished or partial file.

    Parameters
    ----------
    track : carries times, settings, notes and completion; its members are not looked at.
    members : number written.
    extent : lowest and highest ``lat``, ``lon`` (degrees) and ``depth`` (m, positive down) in the file.
    identifier : name of the file without suffix.
    """
    made = provenance(track.settings)
    start, end = float(track.time[0]), float(track.time[-1])
    version = made["version"] or "unknown"
    title = "Ensemble forecast of an underwater glider mission"
    about = [f"{members} members", f"{(end - start) / 86400.0:.2f} days from {iso_time(start)}"]
    if not track.complete:
        about.append("PARTIAL: the forecast was interrupted")
    attributes: dict[str, Any] = {
        "Conventions": "CF-1.10, ACDD-1.3",
        "featureType": "trajectory",
        "title": title if track.complete else f"{title} (partial)",
        "summary": (
            "Positions, surfacings, battery and energy use of every member of a Monte Carlo forecast: "
            + "; ".join(about)
            + "."
        ),
        "keywords": "underwater glider, ensemble forecast, trajectory, surfacing, battery, ocean currents",
        "id": f"{identifier}_{iso_time(start).replace('-', '').replace(':', '')}",
        "naming_authority": "glider_jax",
        "source": f"glider_jax {version}, numerical simulation",
        "history": f"{made['created']} written by glider_jax {version}",
        "date_created": made["created"],
        "date_modified": made["created"],
        "date_metadata_modified": made["created"],
        "creator_name": str(track.settings.get("creator") or "glider_jax"),
        "creator_type": "group",
        "institution": str(track.settings.get("institution") or "not stated"),
        "project": str(track.settings.get("project") or "not stated"),
        "program": "glider_jax",
        "license": "The forecast is given without warranty; the licences of its input data apply.",
        "processing_level": "model output, not quality controlled",
        "standard_name_vocabulary": "CF Standard Name Table v93",
        "platform": "slocum glider",
        "platform_vocabulary": "not controlled",
        "product_version": version,
        "cdm_data_type": "Trajectory",
        "comment": " ".join(track.notes) or "No assumptions were reported.",
        "time_coverage_start": iso_time(start),
        "time_coverage_end": iso_time(end),
        "time_coverage_duration": f"PT{end - start:.0f}S",
        "time_coverage_resolution": f"PT{_step(track):.0f}S",
        "complete": np.int32(track.complete),
        "members_written": np.int32(members),
        "seed": str(made["seed"]),
        "software_version": version,
        "settings": settings_text(track.settings),
        "input_sha256": json.dumps(made["inputs"], sort_keys=True),
        "active_terms": ", ".join(map(str, made["terms"])) or "not stated",
        "surfacing_reasons": "; ".join(track.reasons) or "none",
    }
    return attributes | _geospatial(extent)


def _step(track: Track) -> float:
    return float(np.median(np.diff(track.time))) if track.time.size > 1 else 0.0


def _geospatial(extent: dict[str, list[float]]) -> dict[str, Any]:
    """Extents equal to what the file holds; absent while nothing was written."""
    found: dict[str, Any] = {}
    for key, stem, unit in (
        ("lat", "lat", "degrees_north"),
        ("lon", "lon", "degrees_east"),
        ("depth", "vertical", "m"),
    ):
        low, high = extent[key]
        if np.isfinite(low):
            found[f"geospatial_{stem}_min"], found[f"geospatial_{stem}_max"] = low, high
            found[f"geospatial_{stem}_units"] = unit
    if "geospatial_vertical_min" in found:
        found["geospatial_vertical_positive"] = "down"
    if "geospatial_lat_min" in found and "geospatial_lon_min" in found:
        south, north = found["geospatial_lat_min"], found["geospatial_lat_max"]
        west, east = found["geospatial_lon_min"], found["geospatial_lon_max"]
        corners = ((south, west), (south, east), (north, east), (north, west), (south, west))
        ring = ", ".join(f"{lat:.5f} {lon:.5f}" for lat, lon in corners)
        found["geospatial_bounds"], found["geospatial_bounds_crs"] = f"POLYGON (({ring}))", "EPSG:4326"
        found["geospatial_bounds_vertical_crs"] = "EPSG:5831"
    return found
