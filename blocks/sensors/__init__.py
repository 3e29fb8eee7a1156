"""Sensors: from a motion to the signal that a controller or a recording gets."""
