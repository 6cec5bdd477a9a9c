"""Small-sample statistics without SciPy: Student's t, and weighted least squares that outliers cannot
pull; NumPy only."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

_BISQUARE = 4.685
_FEW = 12


def normal_quantile(probability: float) -> float:
    """Quantile of the standard normal distribution."""
    return NormalDist().inv_cdf(probability)


def t_probability(value: float, dof: float) -> float:
    """Distribution function of Student's t by Simpson's rule, exact to 1e-8 for one degree of freedom and
    more."""
    upper = math.atan(value / math.sqrt(dof))
    angle = np.linspace(0.0, upper, 2001)
    height = np.cos(angle) ** (dof - 1.0)
    weight = np.ones(2001)
    weight[1:-1:2], weight[2:-1:2] = 4.0, 2.0
    area = float((weight * height).sum() * (upper / 2000) / 3.0)
    log_scale = math.lgamma((dof + 1) / 2) - math.lgamma(dof / 2) - 0.5 * math.log(math.pi)
    return 0.5 + math.exp(log_scale) * area


def t_quantile(probability: float, dof: float) -> float:
    """Quantile of Student's t; the normal's above a million degrees of freedom."""
    if dof > 1e6:
        return normal_quantile(probability)
    low, high = -1e4, 1e4
    for _ in range(80):
        middle = 0.5 * (low + high)
        if t_probability(middle, dof) < probability:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@dataclass(frozen=True)
class LineFit:
    """Result of :func:`robust_fit`.

    ``theta`` (parameter,) and ``covariance`` of it; ``scatter`` is the 1-sigma of single observations
    about the fit beyond
    their own ``sd``; ``residual`` and ``weight`` (observation,), weight 0 for an outlier and 1 in the
    middle; ``dof``
    effective degrees of freedom; ``leverage`` (observation,).
    """

    theta: NDArray[np.float64]
    covariance: NDArray[np.float64]
    scatter: float
    residual: NDArray[np.float64]
    weight: NDArray[np.float64]
    leverage: NDArray[np.float64]
    dof: float
    chi2: float

    def sigma(self) -> NDArray[np.float64]:
        """1-sigma of each parameter."""
        return np.sqrt(np.diag(self.covariance))

    def held_out(self) -> NDArray[np.float64]:
        """Error of predicting each observation from all others (leave one out)."""
        return self.residual / np.maximum(1.0 - self.leverage, 1e-6)


def robust_fit(
    design: NDArray[np.float64], observed: NDArray[np.float64], sd: NDArray[np.float64]
) -> LineFit:
    """Weighted linear least squares with an unknown scatter and Tukey's bisquare against outliers.

    Parameters
    ----------
    design : (observation, parameter). observed : (observation,). sd : (observation,) known 1-sigma of each.

    Notes
    -----
    The variance of an observation is ``sd**2 + scatter**2``. Scatter is found so that the robust scale of
    the scaled
    residuals is 1; if the residuals are smaller than ``sd`` says, scatter is 0 and the covariance stays at
    ``sd``.
    """
    count, parameters = design.shape
    scatter = 0.0
    weight = np.ones(count)
    theta = np.zeros(parameters)
    total = np.maximum(sd, 1e-12)
    start = _least_absolute(design, observed, total)
    residual = observed - design @ start
    for _ in range(40):
        scatter = _scatter(residual, sd, count, parameters)
        total = np.maximum(np.hypot(sd, scatter), 1e-12)
        scaled = residual / total
        weight = np.where(np.abs(scaled) < _BISQUARE, (1.0 - (scaled / _BISQUARE) ** 2) ** 2, 0.0)
        root = np.sqrt(weight) / total
        new = np.linalg.lstsq(design * root[:, None], observed * root, rcond=None)[0]
        residual = observed - design @ new
        moved = np.abs(new - theta).max() if parameters else 0.0
        theta = new
        if moved <= 1e-7 * max(1.0, float(np.abs(theta).max())):
            break
    scaled = residual / total
    inside = np.abs(scaled) < _BISQUARE
    ratio = np.where(inside, 1.0 - (scaled / _BISQUARE) ** 2, 0.0)
    influence = scaled * ratio**2
    slope = np.where(inside, ratio * (1.0 - 5.0 * (scaled / _BISQUARE) ** 2), 0.0)
    mean_slope = max(float(slope.mean()), 0.2)
    used = max(count - parameters, 1)
    # Huber's proposal for M-estimates, with his small-sample factor.
    factor = 1.0 + parameters / count * float(slope.var()) / mean_slope**2
    inflation = factor**2 * float((influence**2).sum()) / used / mean_slope**2
    if scatter == 0.0:
        inflation = max(inflation, 1.0)
    normal = np.linalg.pinv((design / total[:, None]).T @ (design / total[:, None]))
    leverage = np.einsum("ij,jk,ik->i", design, normal, design) / total**2
    return LineFit(
        theta=theta,
        covariance=normal * inflation,
        scatter=scatter,
        residual=residual,
        weight=weight,
        leverage=leverage,
        dof=max(float(weight.sum()) - parameters, 1.0),
        chi2=float((weight * scaled**2).sum()),
    )


def _least_absolute(
    design: NDArray[np.float64], observed: NDArray[np.float64], sd: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Least absolute residuals by reweighting: a start that a third of bad points cannot spoil."""
    weight = 1.0 / sd**2
    theta = np.zeros(design.shape[1])
    for _ in range(40):
        root = np.sqrt(weight)
        theta = np.linalg.lstsq(design * root[:, None], observed * root, rcond=None)[0]
        weight = 1.0 / (sd * np.maximum(np.abs(observed - design @ theta), 1e-3 * sd))
    return theta


def _scatter(residual: NDArray[np.float64], sd: NDArray[np.float64], count: int, parameters: int) -> float:
    """Extra 1-sigma that makes the robust scale of the residuals agree with their total sigma."""
    correction = (count / max(count - parameters, 1)) ** 0.5

    def scale(extra: float) -> float:
        # With so few a median is worth little, and outliers cannot be told from scatter.
        if count - parameters < _FEW:
            return correction * float(
                np.sqrt(np.mean((residual / np.maximum(np.hypot(sd, extra), 1e-12)) ** 2))
            )
        return (
            correction * 1.4826 * float(np.median(np.abs(residual) / np.maximum(np.hypot(sd, extra), 1e-12)))
        )

    if scale(0.0) <= 1.0:
        return 0.0
    low, high = 0.0, 4.0 * correction * float(np.abs(residual).max()) + 1e-12
    for _ in range(50):
        middle = 0.5 * (low + high)
        if scale(middle) > 1.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
