"""Compiled loops and what they share: sorting, threads, search trees, triangulation."""
