"""Water bodies: their shape, their shore, and what they hold."""
