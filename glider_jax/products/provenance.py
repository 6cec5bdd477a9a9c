"""What every product says of its own making, taken from ``Track.settings``.

Keys read, all optional: ``version``, ``seed``, ``inputs`` (name -> SHA-256), ``terms`` (names of the active physics),
``created`` (ISO time), ``mission``, ``vehicle``, ``speed``. The whole mapping is written too, as JSON.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from glider_jax.errors import Outcome


def plain(value: Any) -> Any:
    """Bring a value to what JSON can hold: numbers that are not finite become None, unknown kinds their text."""
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted((plain(item) for item in value), key=str)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain({f.name: getattr(value, f.name) for f in dataclasses.fields(value)})
    if isinstance(value, Path):
        return value.as_posix()
    return str(value)


def creation_time(settings: Mapping[str, Any]) -> str:
    """When the product was made: the setting ``created``, else SOURCE_DATE_EPOCH, else now, as ISO text."""
    if settings.get("created"):
        return str(settings["created"])
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    moment = datetime.fromtimestamp(int(epoch), UTC) if epoch.isdigit() else datetime.now(UTC)
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def provenance(settings: Mapping[str, Any]) -> dict[str, Any]:
    """The part of the settings that identifies a forecast, ready for JSON."""
    return {
        "software": "glider_jax",
        "version": plain(settings.get("version")),
        "seed": plain(settings.get("seed")),
        "created": creation_time(settings),
        "inputs": plain(settings.get("inputs") or {}),
        "terms": plain(settings.get("terms") or []),
        "settings": plain(settings),
    }


def settings_text(settings: Mapping[str, Any]) -> str:
    """All settings as one line of JSON with sorted keys."""
    return json.dumps(plain(settings), sort_keys=True, ensure_ascii=False)


def outcome_sentence(code: int) -> str:
    """The sentence of an outcome code, also for a code this version does not know."""
    return Outcome(code).sentence if code in Outcome._value2member_map_ else f"ended with unknown code {code}"
