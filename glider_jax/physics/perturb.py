"""Draws of uncertain parameters, one independent stream per name.

Imports JAX, NumPy and the configuration records. Means may be traced; sigmas and covariances are plain numbers.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from glider_jax.config import CovarianceBlock
from glider_jax.errors import ConfigError

_SMALLEST_SHARE = 0.01


def purpose(name: str) -> int:
    """A stable 31-bit number of a name, to fold into a member's key."""
    return zlib.crc32(name.encode()) & 0x7FFFFFFF


def standard_normal(key: Array, name: str, dtype: Any) -> Array:
    """The standard normal number that belongs to a name under a member's key."""
    return jax.random.normal(jax.random.fold_in(key, purpose(name)), (), dtype)


def factor(block: CovarianceBlock) -> np.ndarray:
    """Lower Cholesky factor of a covariance block; a variance of zero is allowed.

    Raises
    ------
    ConfigError : the matrix is not square, symmetric and positive semi-definite.
    """
    matrix = np.asarray(block.matrix, float)
    size = len(block.names)
    where = f"covariance of {', '.join(block.names)}"
    if matrix.shape != (size, size):
        raise ConfigError(f"{where}: expected a {size} x {size} matrix, found {matrix.shape}.")
    if not np.all(np.isfinite(matrix)) or not np.allclose(matrix, matrix.T, rtol=1e-6, atol=0.0):
        raise ConfigError(f"{where}: expected finite, symmetric numbers. Check the matrix.")
    sd = np.sqrt(np.clip(np.diag(matrix), 0.0, None))
    scale = np.where(sd > 0.0, sd, 1.0)
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    if values.min() < -1e-8 or np.any(np.diag(matrix) < 0.0):
        raise ConfigError(f"{where}: expected a positive semi-definite matrix. Check variances and signs.")
    root = vectors * np.sqrt(np.clip(values, 0.0, None))
    lower = np.linalg.qr(root.T, mode="r").T
    return scale[:, None] * lower * np.where(np.diag(lower) < 0.0, -1.0, 1.0)


def draw_parameters(
    *,
    means: Mapping[str, Array],
    sigmas: Mapping[str, float],
    positive: frozenset[str],
    blocks: tuple[CovarianceBlock, ...],
    normal: Callable[[str], Any],
    spread: float,
    xp: Any = jnp,
) -> dict[str, Array]:
    """Draw values for all names that are uncertain, by name.

    Parameters
    ----------
    means : centre of every parameter. sigmas : 1-sigma of the uncertain ones, same units.
    positive : names that must stay positive: log-normal with the stated mean and sigma when drawn alone, kept above
        a hundredth of the mean when drawn in a block.
    blocks : joint uncertainties; a name in a block is not drawn alone. Names without a mean are passed over.
    normal : gives the standard normal number of a name: a scalar for one member, or an array with one per member.
    spread : factor on all uncertainties. xp : ``jax.numpy``, or ``numpy`` for draws on the host.

    Returns
    -------
    name -> drawn value, of the shape that ``normal`` gives.
    """
    drawn: dict[str, Array] = {}
    for block in blocks:
        normals = xp.stack([normal(name) for name in block.names])
        offsets = spread * (xp.asarray(factor(block), normals.dtype) @ normals)
        for index, name in enumerate(block.names):
            if name in means:
                value = means[name] + offsets[index]
                drawn[name] = xp.maximum(value, _SMALLEST_SHARE * means[name]) if name in positive else value
    for name, sigma in sigmas.items():
        if name not in drawn and sigma > 0.0:
            law = log_normal if name in positive else _normal
            drawn[name] = law(means[name], spread * sigma, normal(name), xp)
    return drawn


def log_normal(mean: Array, sigma: Array | float, normal: Array, xp: Any = jnp) -> Array:
    """Log-normal value of the stated mean and standard deviation; the mean itself where it is not positive."""
    usable = mean > 0
    ratio = sigma / xp.where(usable, mean, xp.ones_like(mean))
    variance = xp.log1p(ratio * ratio)
    return xp.where(usable, mean * xp.exp(xp.sqrt(variance) * normal - 0.5 * variance), mean)


def _normal(mean: Array, sigma: Array | float, normal: Array, xp: Any = jnp) -> Array:
    return mean + sigma * normal
