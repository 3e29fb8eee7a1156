"""Periodic answers to sines, and frequency-response tables as experiments."""
