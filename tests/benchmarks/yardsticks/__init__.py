"""The mission step of the bundled default in C and in numba, to measure the forecaster's speed against."""
