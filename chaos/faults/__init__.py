"""The faults: each does its harm, brings the farm back to what it was, and says what it saw of it."""
