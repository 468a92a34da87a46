"""OG1.0: reader of the OceanGliders' common format."""
