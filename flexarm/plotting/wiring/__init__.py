"""The wiring of a scenario as a block diagram: graph, layered layout, routing and drawing."""
