"""Sweeps: a scenario over grids of values and draws within tolerances.

The package is not called ``sweep``, because `flexarm.sweep` is the function.
"""
