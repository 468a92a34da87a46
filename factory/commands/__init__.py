"""One module per subcommand of `factory`; each is imported only when it is called."""
