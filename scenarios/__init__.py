"""What a user writes: scenario files, their schema, and the shipped scenarios. Part of flexarm."""
