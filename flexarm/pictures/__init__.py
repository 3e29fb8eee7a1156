"""Pictures of scenarios and models: the wiring as a block diagram, and the frequency response of a linear model."""
