"""The library as plain data, for the command line, reports and files.

Imports the physics layer. Numbers of priors are in the unit a report shows, next to the SI unit of the code.
"""

from __future__ import annotations

from typing import Any

from glider_jax.physics.library import LIBRARY, confusion_class
from glider_jax.physics.library.base import BASE
from glider_jax.physics.term import AbstractTerm, ParameterInfo, declared


def catalogue(*, include_base: bool = False) -> list[dict[str, Any]]:
    """Every term as a dictionary of text and numbers, in the library's order.

    Parameters
    ----------
    include_base : put the base model's own terms first.
    """
    return [describe(kind) for kind in ((*BASE, *LIBRARY) if include_base else LIBRARY)]


def describe(kind: type[AbstractTerm]) -> dict[str, Any]:
    """One term: id, title, sentences, equation, channels with units, and parameters with priors."""
    info = kind.info
    return {
        "id": info.id,
        "title": info.title,
        "plain": info.plain,
        "equation": info.equation,
        "channels": [{"name": c.name.lower(), "meaning": c.value[0], "unit": c.unit} for c in info.channels],
        "reads": list(info.reads),
        "parameters": [_parameter(p) for p in declared(kind).values()],
        "valid": info.valid,
        "reference": info.reference,
        "classes": list(confusion_class(info.id)),
        "confusable_with": list(info.confusable_with),
        "decided_by": info.decided_by,
    }


def _parameter(info: ParameterInfo) -> dict[str, Any]:
    factor = info.shown_per_si
    return {
        "name": info.name,
        "role": info.role,
        "text": info.text,
        "unit": info.unit,
        "shown": info.shown,
        "shown_per_si": factor,
        "prior": {
            "kind": type(info.prior).__name__,
            "centre": info.prior.centre * factor,
            "sd": info.prior.sd * factor,
        },
        "source": info.source,
        "quantity": info.quantity,
    }
