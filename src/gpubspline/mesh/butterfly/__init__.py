"""Shafts, heads and fingers in five matched patches a section: a square in the middle and four blocks round it."""
