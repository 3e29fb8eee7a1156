"""Diagnosability before the experiment: what the sensors and inputs at hand could tell apart."""
