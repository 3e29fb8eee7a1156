"""Scenario files, their schema, and the scenarios that come with flexarm."""
