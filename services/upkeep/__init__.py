"""Housekeeping: old logs go, a farm's folder is copied, brought back and looked through."""
