"""One module per subcommand of `learn`; each is imported only when it is called."""
