"""A run: what it reads and writes, what it keeps, and how each product says where it comes from."""
