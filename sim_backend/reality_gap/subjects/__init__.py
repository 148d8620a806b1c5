"""What can be studied, each to a verdict of its own: joints, a cube with its tracker, tossed objects."""
