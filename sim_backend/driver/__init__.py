"""How one speaks to a robot: commands in, measured states and tracked poses out, safety in between."""
