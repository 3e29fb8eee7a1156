"""What drives a system: signals that come from nowhere."""
