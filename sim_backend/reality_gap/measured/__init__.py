"""What was measured: logs of the farm and anybody's tables as recordings, their outliers, and the noise of sensors."""
