"""Which cause of the cube or its tracker is at work in logs of pushes and rest."""
