"""The recipe: everything that decides the content of a store."""
