"""Pictures of layers, as PNG."""
