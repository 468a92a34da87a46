"""An open benchmark of dead reckoning without a Doppler log: tiers, a scorer, rivals."""
