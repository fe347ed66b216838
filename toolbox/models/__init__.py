"""Models: chains of tools in a YAML file, read, checked, run and drawn."""
