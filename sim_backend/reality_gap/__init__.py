"""Given measured data: show what the simulation gets wrong, name the physical cause, extend the model, measure the gain."""
