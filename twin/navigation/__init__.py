"""Navigation: where a vehicle is, estimated on board under way and from its record afterwards."""
