"""The faults: each injects a failure, undoes it and reports whether the failure was seen."""
