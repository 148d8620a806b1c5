"""Reports as text and as a page, the same wherever one is shown."""
