"""Bodies: rigid inertias and flexible links."""
