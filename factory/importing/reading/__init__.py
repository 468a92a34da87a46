"""Reading: tables and arrays of log files, and the count of what was done to them."""
