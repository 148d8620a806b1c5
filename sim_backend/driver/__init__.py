"""The driver of a robot: commands in, measured states and tracked poses out, safety in between."""
