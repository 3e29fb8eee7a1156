"""Tools for developers of flexarm: installation, lock file, fits, and pages and figures of the documentation."""
