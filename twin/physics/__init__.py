"""Physics: scenarios flown in MuJoCo, one or many."""
