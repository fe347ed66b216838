"""Plots: layers drawn as PNG images."""
