"""Damping from free decays."""
