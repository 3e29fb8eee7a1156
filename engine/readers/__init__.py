"""Files of numbers that somebody else wrote: text tables, MATLAB and JSON files, read without trusting them."""
