"""Surveys that do not fit into memory: cut into tiles, run with a halo, put together again."""
