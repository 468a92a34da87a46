"""One module per subcommand of `twin`; each is imported only when it is called."""
