"""Pictures of missions and logs: figures, films, pages for browsers, and their common look."""
