"""Uncertainty from evidence: a family of linear models from a fit's covariance, and what it leaves over as a weight.

Parameters are drawn from the normal distribution of the fit's search vector, whose covariance is that of
`diagnosis.estimation.covariance`. What recordings that were not fitted still leave over, beyond what the draws and the
noise predict, is covered by a weight W(s) of low order on each signal: measured = (1 + W D) predicted, with a D of gain
1 that nobody knows. The bound is to hold 95 % of the bins of a spectrum; it is calibrated on one part of the held-out
data and scored on another, never on the same.
"""
