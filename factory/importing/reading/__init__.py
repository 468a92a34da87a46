"""Reading: columns and channels of log files, and the tally of what was done to them."""
