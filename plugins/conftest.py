"""Settings, fixtures and choices of all tests, for those of plugins."""

from conftest import own_variables, pytest_ignore_collect

__all__ = ["own_variables", "pytest_ignore_collect"]
