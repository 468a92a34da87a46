"""Commands: subcommands of `learn`, a module each, which is imported only when called."""
