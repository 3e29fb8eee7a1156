"""Formats of loggers that other libraries read, each an optional extra, in a child process (ADR 19)."""
