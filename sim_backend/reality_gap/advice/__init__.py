"""Design of the next recording: the motions that separate the remaining causes."""
