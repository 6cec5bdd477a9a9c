"""Errors raised at the edges (readers, configuration, command line) and the outcome codes of ensemble members.

Imports nothing but the standard library. Inside a compiled step nothing is raised: a member that cannot go on
gets an :class:`Outcome`, is frozen, and the others fly on.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from enum import IntEnum


class GliderJaxError(Exception):
    """Base of every error that has an explanation for the user.

    The message says where, what was expected, what was found and what to do; the command line prints it
    without a traceback and exits with code 1.
    """


class DataError(GliderJaxError):
    """A file cannot be read, or does not hold what it should: variable, dimension, unit or values."""


class ConfigError(GliderJaxError):
    """A vehicle, mission or run setting is missing, unknown, of the wrong kind or out of range."""


class CoverageError(GliderJaxError):
    """A field does not cover the place or time it is asked for."""


class FitError(GliderJaxError):
    """The data cannot determine what a fit was asked for."""


class CaptureError(GliderJaxError):
    """A port or device cannot be opened, or stopped answering."""


class Outcome(IntEnum):
    """How a member's forecast ended; written to every product as a flag variable."""

    FLYING = 0
    ARRIVED = 1
    BATTERY_EMPTY = 2
    BATTERY_ABORT = 3
    LEFT_CURRENTS_AREA = 4
    LEFT_CURRENTS_TIME = 5
    LEFT_BATHYMETRY = 6
    AGROUND = 7
    STALLED = 8
    ABORTED = 9
    INVALID = 10

    @property
    def sentence(self) -> str:
        """What the code means, as a pilot would say it."""
        return _SENTENCES[self]


_SENTENCES = {
    Outcome.FLYING: "still flying at the end of the forecast",
    Outcome.ARRIVED: "completed the mission",
    Outcome.BATTERY_EMPTY: "emptied the battery",
    Outcome.BATTERY_ABORT: "aborted at the battery threshold of the mission",
    Outcome.LEFT_CURRENTS_AREA: "left the area of the current field",
    Outcome.LEFT_CURRENTS_TIME: "flew past the last time of the current field",
    Outcome.LEFT_BATHYMETRY: "left the area of the bathymetry",
    Outcome.AGROUND: "ran into water too shallow to dive",
    Outcome.STALLED: "could not glide: too little buoyancy, pitch or depth",
    Outcome.ABORTED: "aborted by a rule of the mission",
    Outcome.INVALID: "stopped at a number that was not finite",
}


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return " Did you mean 'x'?" for the nearest known name, or an empty string.

    Parameters
    ----------
    name : what the user wrote.
    known : the names that would have been accepted.
    """
    near = difflib.get_close_matches(name, list(known), n=1, cutoff=0.6)
    return f" Did you mean '{near[0]}'?" if near else ""
