"""What a run leaves in its folder, by name: for those, too, who do without torch."""

CHECKPOINT, RECORD = "checkpoint.pt", "record.json"
