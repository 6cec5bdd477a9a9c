"""glider_jax: probabilistic mission forecasts for Slocum gliders, and explanations of what they missed.

Importing the package loads neither JAX nor xarray; the modules that need them import them.
"""

__version__ = "0.1.0"
