"""From what was found to what is said: causes with intervals, rivals, doubts, and the verdict."""
