"""From what training libraries write to what the farm takes; runs on the user's own machine, because reading it runs its code."""
