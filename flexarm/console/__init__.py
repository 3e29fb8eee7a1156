"""What commands share: arguments and options, completion, plain-text tables, progress, Ctrl-C."""
