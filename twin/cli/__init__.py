"""The command line: programs, options, text and JSON answers."""
