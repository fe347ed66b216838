"""Runs: sources, targets, cached results, the report and the provenance records of products."""
