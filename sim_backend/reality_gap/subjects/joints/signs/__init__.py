"""What joints show without a fit, or by two columns that say the same: noise, steps, jumps, play, lateness."""
