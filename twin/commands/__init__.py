"""Subcommands of `twin`: a subcommand's module is imported only when it is called."""
