"""Twin of an underwater glider: MuJoCo physics, currents, control, sensors and the data schema."""
