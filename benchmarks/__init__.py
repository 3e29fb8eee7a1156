"""Measurements of flexarm: speed, and the proof on concealed effects."""
