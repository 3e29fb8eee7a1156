"""Sources: signals that drive a system."""
