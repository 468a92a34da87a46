"""What is looked at: figures, films, pages for browsers, and the look that they share."""
