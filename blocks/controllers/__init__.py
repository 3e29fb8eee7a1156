"""Signal blocks: what a controller is made of."""
