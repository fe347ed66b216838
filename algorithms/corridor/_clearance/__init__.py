"""Clearances from catenaries and points: distances, rules, sag in other states, results."""
