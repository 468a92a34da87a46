"""Records: what a mission was, in memory and in stores."""
