"""Parameters, residuals and fits: what is free, what a recording says, and the one optimiser."""
