"""Linear models for control design: operating points, families, describing functions, margins, uncertainty."""
