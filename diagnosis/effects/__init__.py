"""The catalogue: effects, where they can act, and the sizes they start from."""
