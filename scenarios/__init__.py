"""Scenario files, their schema, and the shipped scenarios. Part of flexarm."""
