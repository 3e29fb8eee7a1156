"""Programs for those who work on flexarm: installation, locking, fits and figures of the documentation."""
