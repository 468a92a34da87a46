"""The recipe: everything that decides the content of a store.

Flight: one mission from its parameters to its signals.
"""
