"""What a user writes: scenario files, their schema, and the scenarios that come with flexarm."""
