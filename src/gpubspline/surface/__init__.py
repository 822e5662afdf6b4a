"""Closed triangle surfaces: files, checks, distances from them, and the region within."""
