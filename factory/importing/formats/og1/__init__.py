"""OG1.0: files of the OceanGliders' common format."""
