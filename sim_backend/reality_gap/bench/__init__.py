"""Programs that measure the tool itself; no study needs them."""
