"""Clouds of positions that arrive in blocks: kept whole for few members, as counts on a grid for millions."""

from __future__ import annotations

import numpy as np

from glider_jax.products.coordinates import LocalFrame
from glider_jax.products.quantiles import Quantiles
from glider_jax.products.regions import CloudHistogram, Region, histogram_regions, regions_of_metres
from glider_jax.records import Array


class Cloud:
    """Positions of the members at one instant or event, in metres of ``frame``.

    Parameters
    ----------
    frame : local frame shared by all clouds of a forecast.
    limit : number of positions up to which all are kept.
    """

    def __init__(self, frame: LocalFrame, limit: int = 50_000) -> None:
        self.frame = frame
        self.limit = limit
        self.count = 0
        self._blocks: list[Array] = []
        self._histogram: CloudHistogram | None = None
        self._axes = Quantiles(2, limit)

    def add(self, latitude: Array, longitude: Array) -> None:
        """Add the positions of a block, (n,) degrees; NaN where there is none."""
        good = np.isfinite(latitude) & np.isfinite(longitude)
        metres = np.stack(self.frame.to_metres(latitude[good], longitude[good]), axis=1)
        if not len(metres):
            return
        self.count += len(metres)
        self._axes.add(metres)
        if self._histogram is not None:
            self._histogram.add(metres)
            return
        self._blocks.append(metres)
        if self.count > self.limit:
            kept = np.concatenate(self._blocks)
            self._histogram = CloudHistogram.over(kept, margin=0.15)
            self._histogram.add(kept)
            self._blocks = []

    def median(self) -> tuple[float, float] | None:
        """Latitude and longitude, degrees, of the medians east and north; None without positions."""
        if not self.count:
            return None
        east, north = self._axes.at((0.5,))[0]
        latitude, longitude = self.frame.to_degrees(east, north)
        return float(latitude), float(longitude)

    def regions(self, probabilities: tuple[float, ...] = (0.5, 0.9)) -> tuple[Region, ...]:
        """Highest-density regions, smallest probability first; empty with fewer than three positions."""
        if self._histogram is not None:
            return histogram_regions(self._histogram, self.frame, probabilities)
        if self.count < 3:
            return ()
        return regions_of_metres(np.concatenate(self._blocks), self.frame, probabilities)
