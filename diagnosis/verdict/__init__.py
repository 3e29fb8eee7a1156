"""What the search found, in words, figures and files."""
