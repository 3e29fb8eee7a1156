"""What a controller or a recording sees of a motion."""
