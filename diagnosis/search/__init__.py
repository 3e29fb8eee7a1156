"""The search for the missing effect: candidates are inserted, fitted and compared."""
