"""Corridors of power lines: two plain kinds of scene, and presets as varied as the world."""
