"""Splitting: a scenario as several FMUs and an SSP that wires them.

Where a shaft is cut, one side keeps the motion: it gives angle, speed and acceleration and takes the torque. The other
side follows the motion and gives the torque, and how the torque answers the motion: see `fmu.coupling`.
"""
