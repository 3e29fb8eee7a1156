"""Shared test settings."""

from hypothesis import settings

# The first example of a property may compile a model, so examples have no time limit.
settings.register_profile("flexarm", deadline=None, max_examples=30, derandomize=True)
settings.load_profile("flexarm")
