"""Anyone's measured data, read as a study.toml says."""
