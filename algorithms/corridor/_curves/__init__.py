"""Curves from points: single wires are followed, fitted by catenaries and cut into arcs."""
