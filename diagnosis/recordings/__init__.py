"""Recordings read from files: columns, mappings, time axes and checks. No model is needed here."""
