"""Cohorts: a manifest of subjects worked through by several processes, resumable, one table and one page of all."""
