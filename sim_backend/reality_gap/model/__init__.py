"""The extended model as files: physics that ``sim_backend`` loads, and plain MJCF."""
