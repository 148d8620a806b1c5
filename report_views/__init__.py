"""Reports as text and as HTML, shared by command line and dashboard."""
