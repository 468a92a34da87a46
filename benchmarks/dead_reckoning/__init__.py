"""Dead reckoning without a Doppler log, an open benchmark: tiers, scoring, rivals."""
