"""Commands of `factory`; each command's module is imported only when the command runs."""
