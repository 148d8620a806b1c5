"""Between trials: the arena is cleared, motors cool, the robot tests itself."""
