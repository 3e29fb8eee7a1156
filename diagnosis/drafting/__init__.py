"""Drafts of the `recordings:` section from log files: columns are matched with the nominal model."""
