"""Policies as files on this machine: weights with their manifest, folders of checkpoints."""
